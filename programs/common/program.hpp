// SPDX-License-Identifier: Apache-2.0
/// @file  Shared by all programs: common options, one message per error, exit codes.
#pragma once

#include "common/backend_option.hpp"
#include "common/exit_codes.hpp"
#include "common/interrupts.hpp"
#include "common/memory_reserve.hpp"
#include "common/messages.hpp"
#include "common/reports.hpp"
#include "common/version.hpp"

#include <gsh/core/error.hpp>

#include <CLI/CLI.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <new>
#include <string>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace gsh::programs {

/// Tells glibc to give freed arrays of more than 1 MB back to the system at once. By default it keeps them for later
/// requests that often do not fit, which cost a reconstruction 80 of 970 MB.
inline void return_freed_arrays() {
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, 1 << 20);
#endif
}

/// Memory is set aside before main(), because the options are made outside of run_program, which reports errors.
inline const bool memory_is_set_aside = (set_memory_aside(), true);

/// Opens /dev/null in the place of standard streams that are closed. A file that is written would take their number,
/// and messages would go into it.
inline void open_standard_streams() {
    for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
        if (::fcntl(stream, F_GETFD) < 0) (void)!::open("/dev/null", stream == STDIN_FILENO ? O_RDONLY : O_WRONLY);
}

/// Reads the command line into the options of `app`, to which --version is added.
///
/// Errors  CLI::ParseError, also for --help and --version.
inline void parse_command_line(CLI::App& app, int argc, char** argv) {
    app.set_version_flag("--version", version_line(app.get_name()), "print the version");
    app.parse(argc, argv);
}

/// The exit code where main ends without memory before run_program can tell so.
inline int refuse_without_memory(const char* program) {
    std::fprintf(stderr, "%s: out of memory\n", program);
    return exit_bad_input;
}

/// Parses the command line, runs the work, and turns every failure into one line on standard error.
template <class Work>
int run_program(CLI::App& app, int argc, char** argv, const Work& work) {
    const auto refuse = [&](const std::string& message, const char* error) {
        send_report({"error", error, message});
        std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), one_line(message).c_str());
        return exit_bad_input;
    };
    open_standard_streams();
    return_freed_arrays();
    set_memory_aside(); // anew, if it was needed
    std::signal(SIGXFSZ, SIG_IGN); // a limit on file sizes then becomes an error of write, which has a message
    try {
        parse_command_line(app, argc, argv);
        return work();
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error); // --help, --version
        return refuse(std::string(error.what()) + "; --help lists all options", "ValueError");
    } catch (const std::bad_alloc&) {
        return refuse("out of memory", "bad_alloc");
    } catch (const ShapeError& error) {
        return refuse(error.what(), "ShapeError");
    } catch (const ValueError& error) {
        return refuse(error.what(), "ValueError");
    } catch (const IoError& error) {
        return refuse(error.what(), "IoError");
    } catch (const std::exception& error) {
        return refuse(error.what(), "Error");
    }
}

/// Accepts the numbers for which `fits` returns true; `expected` describes them in the message.
template <class Condition>
CLI::Validator numbers(const Condition& fits, const std::string& expected) {
    const auto complaint = [=](std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        const bool good = end != text.c_str() && *end == '\0' && fits(value);
        return good ? std::string() : "'" + text + "' is not " + expected;
    };
    return {complaint, ""};
}

inline CLI::Validator above_zero() {
    return numbers([](double value) { return value > 0; }, "a number above 0");
}
inline CLI::Validator not_negative() {
    return numbers([](double value) { return value >= 0; }, "0 or more");
}

/// The option --threads; 0 means all threads of the machine.
inline void add_threads(CLI::App& app, std::size_t& threads) {
    app.add_option("--threads", threads, "CPU threads (default: all)")->check(CLI::Range(1, 1024));
}

/// The options --backend, --device, --precision and --threads.
inline void add_backend(CLI::App& app, BackendOption& option) {
    app.add_option("--backend", option.backend,
                   "where to compute: threads (the CPU, the default) or cuda (an NVIDIA GPU)")
        ->check(CLI::IsMember({"threads", "cuda"}));
    app.add_option("--device", option.device, "with --backend cuda: number of the GPU (default 0)")
        ->check(not_negative());
    app.add_option(
           "--precision", option.precision,
           "arithmetic of the fields' networks: fp32 (default) or mixed (products of bf16, sums in float; faster "
           "on tensor cores and AMX)")
        ->check(CLI::IsMember({"fp32", "mixed"}));
    add_threads(app, option.threads);
}

/// The option --background r g b.
inline void add_background(CLI::App& app, std::array<double, 3>& background, const std::string& by_default) {
    app.add_option("--background", background, "red,green,blue in [0, 1] (default " + by_default + ")")
        ->delimiter(',')
        ->check(numbers([](double value) { return value >= 0 && value <= 1; }, "from 0 to 1"));
}

} // namespace gsh::programs
