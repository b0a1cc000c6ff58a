// SPDX-License-Identifier: Apache-2.0
#include "support/stage_process.hpp"

#include <gsh/core/error.hpp>

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <system_error>

namespace gsh::examples {

int run_stage(const std::vector<std::string>& words) {
    std::vector<std::string> copies = words;
    std::vector<char*> arguments;
    for (std::string& word : copies) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    std::fflush(stdout); // so that its lines come after ours
    pid_t id = 0;
    const int error = ::posix_spawnp(&id, arguments[0], nullptr, nullptr, arguments.data(), environ);
    if (error != 0) throw IoError(words[0] + ": cannot be started: " + std::strerror(error));
    int status = 0;
    while (::waitpid(id, &status, 0) < 0)
        if (errno != EINTR) throw IoError(words[0] + ": was lost: " + std::strerror(errno));
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

std::filesystem::path folder_of_programs() {
    std::error_code error;
    const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
    return error ? std::filesystem::path() : self.parent_path();
}

} // namespace gsh::examples
