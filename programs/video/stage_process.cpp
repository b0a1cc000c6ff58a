// SPDX-License-Identifier: Apache-2.0
#include "video/stage_process.hpp"

#include "common/exit_codes.hpp"

#include <gsh/core/error.hpp>

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>

namespace gsh::programs {

namespace {

volatile std::sig_atomic_t running = 0; ///< the process of the stage

void end_stage(int signal) {
    if (running > 0) ::kill(static_cast<pid_t>(running), signal);
}

/// While it exists, Ctrl-C is left to the stage, which the terminal interrupts, too, and SIGTERM is passed on to it.
class LeftToStage {
public:
    LeftToStage() : interrupt_(std::signal(SIGINT, SIG_IGN)), termination_(std::signal(SIGTERM, end_stage)) {}
    LeftToStage(const LeftToStage&) = delete;
    LeftToStage& operator=(const LeftToStage&) = delete;
    ~LeftToStage() {
        std::signal(SIGINT, interrupt_);
        std::signal(SIGTERM, termination_);
        running = 0;
    }

private:
    void (*interrupt_)(int);
    void (*termination_)(int);
};

/// The exit code of a program, or 128 and the signal that ended it.
int code_of(const std::vector<std::string>& words) {
    std::vector<std::string> copies = words;
    std::vector<char*> arguments;
    for (std::string& word : copies) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    const LeftToStage signals;
    posix_spawnattr_t attributes;
    posix_spawnattr_init(&attributes);
    sigset_t usual; // signals that are ignored here would be ignored there
    sigemptyset(&usual);
    sigaddset(&usual, SIGINT);
    posix_spawnattr_setsigdefault(&attributes, &usual);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
    pid_t id = 0;
    const int error = ::posix_spawnp(&id, arguments[0], nullptr, &attributes, arguments.data(), environ);
    posix_spawnattr_destroy(&attributes);
    running = static_cast<std::sig_atomic_t>(error == 0 ? id : 0);
    if (error != 0) throw IoError(words[0] + ": cannot be started: " + std::strerror(error));
    int status = 0;
    while (::waitpid(id, &status, 0) < 0)
        if (errno != EINTR) throw IoError(words[0] + ": was lost: " + std::strerror(errno));
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

} // namespace

void announce_stage(const char* title) {
    std::printf("== %s\n", title);
    std::fflush(stdout); // so that progress and the lines of another program come after it
}

int run_stage(const char* title, const std::vector<std::string>& words, const std::vector<int>& accepted) {
    announce_stage(title);
    const int code = code_of(words);
    if (std::find(accepted.begin(), accepted.end(), code) != accepted.end()) return code;
    if (code == exit_interrupted || code == 128 + SIGINT || code == 128 + SIGTERM) std::exit(exit_interrupted);
    throw Error("the stage '" + std::string(title) + "' ended with code " + std::to_string(code) +
                "; its message stands above. The same command goes on from here");
}

std::filesystem::path folder_of_programs() {
    std::error_code error;
    const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
    return error ? std::filesystem::path() : self.parent_path();
}

} // namespace gsh::programs
