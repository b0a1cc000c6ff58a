// SPDX-License-Identifier: Apache-2.0
/// @file  A headless Chromium that opens an address, for tests of pages.
#pragma once

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace gsh::test {

/// The path of Chromium, or an empty one.
[[nodiscard]] inline std::filesystem::path chromium() {
    const char* const folders = std::getenv("PATH");
    std::istringstream list(folders ? folders : "");
    for (std::string folder; std::getline(list, folder, ':');)
        for (const char* name : {"chromium", "chromium-browser", "google-chrome"}) {
            std::error_code ignored;
            const std::filesystem::path path = std::filesystem::path(folder) / name;
            if (std::filesystem::exists(path, ignored)) return path;
        }
    return {};
}

/// A browser with WebGL by software, until the destructor ends it and all of its processes.
class Browser {
public:
    explicit Browser(const std::string& address, const std::vector<std::string>& more = {}) {
        std::vector<std::string> words{chromium().string(),
                                       "--headless=new",
                                       "--no-sandbox",
                                       "--use-angle=swiftshader",
                                       "--enable-unsafe-swiftshader",
                                       "--no-first-run",
                                       "--disable-extensions",
                                       "--disable-background-networking",
                                       "--disable-sync",
                                       "--mute-audio",
                                       "--window-size=900,700",
                                       "--user-data-dir=" + (profile_ / "profile").string()};
        words.insert(words.end(), more.begin(), more.end());
        words.push_back(address);
        std::vector<char*> arguments;
        for (std::string& word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        const std::string log = profile_ / "log";
        for (const int descriptor : {STDOUT_FILENO, STDERR_FILENO})
            posix_spawn_file_actions_addopen(&actions, descriptor, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
        posix_spawnattr_t attributes;
        posix_spawnattr_init(&attributes);
        posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP); // a group of its own
        posix_spawnattr_setpgroup(&attributes, 0);
        const int error = posix_spawn(&id_, arguments[0], &actions, &attributes, arguments.data(), environ);
        posix_spawn_file_actions_destroy(&actions);
        posix_spawnattr_destroy(&attributes);
        REQUIRE(error == 0);
    }
    Browser(const Browser&) = delete;
    Browser& operator=(const Browser&) = delete;
    ~Browser() {
        if (id_ <= 0) return;
        ::kill(-id_, SIGKILL);
        ::waitpid(id_, nullptr, 0);
    }
    /// What it printed, for messages.
    [[nodiscard]] std::string log() const { return read_file(profile_ / "log"); }

private:
    Temporary profile_;
    pid_t id_ = 0;
};

} // namespace gsh::test
