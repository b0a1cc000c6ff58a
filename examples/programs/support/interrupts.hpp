// SPDX-License-Identifier: Apache-2.0
/// @file  How somebody asks a program to end.
#pragma once

#include <atomic>
#include <csignal>

namespace gsh::examples {

/// Set by Ctrl-C (SIGINT) and SIGTERM once `watch_interrupts` was called.
inline std::atomic<bool> interrupted{false};

/// From here on the first Ctrl-C asks the program to end in good order; a second one ends it at once.
inline void watch_interrupts() {
    const auto note = [](int signal) {
        interrupted = true;
        std::signal(signal, SIG_DFL);
    };
    std::signal(SIGINT, note);
    std::signal(SIGTERM, note);
}

} // namespace gsh::examples
