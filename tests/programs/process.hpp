// SPDX-License-Identifier: Apache-2.0
/// @file  Runs gsh's programs as processes, for tests of their exit codes, output and files.
#pragma once

#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/input_file.hpp>

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace gsh::test {

/// The outcome of a program: its exit code, or minus the signal that killed it, and its output.
struct Outcome {
    int code = 0;
    std::string out, err;
};

/// Sets a variable of the environment, which programs inherit, as long as this exists.
class Variable {
public:
    Variable(const char* name, const std::string& value) : name_(name) {
        if (const char* before = ::getenv(name)) before_ = before;
        ::setenv(name, value.c_str(), 1);
    }
    Variable(const Variable&) = delete;
    Variable& operator=(const Variable&) = delete;
    ~Variable() {
        if (before_)
            ::setenv(name_, before_->c_str(), 1);
        else
            ::unsetenv(name_);
    }

private:
    const char* name_;
    std::optional<std::string> before_;
};

/// A running program.
class Process {
public:
    /// `words` are the program's name and its arguments. `before` is what a shell has before them: with "ulimit -f 20 &&
    /// exec", files hold at most 20 blocks of 512 bytes, as on a full disk; "cat FILE |" is a pipe.
    explicit Process(std::vector<std::string> words, const std::string& before = {}) : name_(words[0]) {
        words[0] = std::string(GSH_PROGRAM_DIR "/") + name_;
        if (!before.empty()) words.insert(words.begin(), {"/bin/sh", "-c", before + " \"$0\" \"$@\""});
        std::vector<char*> arguments;
        for (std::string& word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);

        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        const auto to_file = [&](int descriptor, const char* file) {
            const std::string path = said_ / file;
            posix_spawn_file_actions_addopen(&actions, descriptor, path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
        };
        to_file(STDOUT_FILENO, "out");
        to_file(STDERR_FILENO, "err");
        const int error = posix_spawn(&id_, arguments[0], &actions, nullptr, arguments.data(), environ);
        posix_spawn_file_actions_destroy(&actions);
        REQUIRE(error == 0);
    }
    Process(const Process&) = delete;
    Process& operator=(const Process&) = delete;
    ~Process() {
        if (id_ <= 0) return;
        ::kill(id_, SIGKILL);
        ::waitpid(id_, nullptr, 0);
    }

    [[nodiscard]] pid_t id() const { return id_; }
    void send(int signal) const { REQUIRE(::kill(id_, signal) == 0); }

    /// Calls `happened` every `interval` microseconds until it returns true. Returns false if the program ends before,
    /// or after some minutes.
    [[nodiscard]] bool wait_until(const std::function<bool()>& happened, int interval = 10'000, int minutes = 1) const {
        const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(minutes);
        while (std::chrono::steady_clock::now() < end) {
            if (happened()) return true;
            siginfo_t info{};
            if (::waitid(P_PID, static_cast<id_t>(id_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == id_)
                return false;
            std::this_thread::sleep_for(std::chrono::microseconds(interval));
        }
        return false;
    }

    [[nodiscard]] std::string err() const { return read_file(said_ / "err"); }
    [[nodiscard]] std::string out() const { return read_file(said_ / "out"); }

    [[nodiscard]] Outcome wait() {
        int status = 0;
        REQUIRE(::waitpid(id_, &status, 0) == id_);
        id_ = 0;
        return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), out(), err()};
    }

private:
    Temporary said_;
    std::string name_;
    pid_t id_ = 0;
};

[[nodiscard]] inline Outcome run(std::vector<std::string> words, const std::string& before = {}) {
    return Process(std::move(words), before).wait();
}

/// Checks that the program succeeded and printed no error or warning. Progress is allowed.
inline void check_done(const Outcome& outcome) {
    INFO(outcome.err);
    CHECK(outcome.code == 0);
    CHECK(outcome.err != gsh::test::contains("warning"));
}

/// Checks that the program exited with 2 and printed one line that begins with its name and contains all words.
inline void check_refused(const Outcome& outcome, const std::string& program,
                          std::initializer_list<std::string_view> words) {
    INFO(outcome.err);
    CHECK(outcome.code == 2);
    CHECK(outcome.err.starts_with(program + ": "));
    CHECK(outcome.err.ends_with("\n"));
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    for (const std::string_view word : words) {
        INFO("looking for '" << std::string(word) << "'");
        CHECK(outcome.err == gsh::test::contains(word));
    }
}

} // namespace gsh::test
