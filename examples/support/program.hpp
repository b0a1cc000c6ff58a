// SPDX-License-Identifier: Apache-2.0
/// @file  What every program does the same: options, one clear message for what went wrong, exit codes.
#pragma once

#include <gsh/core/error.hpp>

#include <CLI/CLI.hpp>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <new>
#include <string>
#include <system_error>

namespace gsh::examples {

/// Exit codes. Bad input and a full disk are the user's to mend, so they share one.
enum Exit { exit_done = 0, exit_bad_input = 2, exit_interrupted = 130 };

/// Set by Ctrl-C (SIGINT) and SIGTERM once `watch_interrupts` was called.
inline std::atomic<bool> interrupted{false};

inline void watch_interrupts() {
    const auto note = [](int) { interrupted = true; };
    std::signal(SIGINT, note);
    std::signal(SIGTERM, note);
}

/// Parses the command line, runs the work, and turns every failure into one line on standard error.
template <class Work>
int run_program(CLI::App& app, int argc, char** argv, const Work& work) {
    std::signal(SIGXFSZ, SIG_IGN); // a limit on file sizes comes back as an error of write, with a message
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? exit_done : exit_bad_input;
    }
    try {
        return work();
    } catch (const std::bad_alloc&) {
        std::fprintf(stderr, "%s: out of memory\n", app.get_name().c_str());
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), error.what());
    }
    return exit_bad_input;
}

/// Creates a folder for results, or says why not.
inline void make_folder(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error || !std::filesystem::is_directory(folder))
        throw IoError(folder.string() + ": cannot be created: " + (error ? error.message() : "a file is in the way"));
}

inline void warn(const std::string& message) { std::fprintf(stderr, "warning: %s\n", message.c_str()); }

} // namespace gsh::examples
