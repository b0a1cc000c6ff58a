// SPDX-License-Identifier: Apache-2.0
/// @file  Signals that end a program.
#pragma once

#include <atomic>
#include <csignal>

namespace gsh::programs {

/// Set by Ctrl-C (SIGINT) and SIGTERM after watch_interrupts() was called.
inline std::atomic<bool> interrupted{false};

/// From this call on, the first Ctrl-C only sets `interrupted`, so that the program can end in order. A second one ends
/// the program at once. SIGTERM does the same as the first, however often it comes: a scheduler sends it to a job and to
/// each process of the job, which may pass it on.
inline void watch_interrupts() {
    std::signal(SIGINT, [](int signal) {
        interrupted = true;
        std::signal(signal, SIG_DFL);
    });
    std::signal(SIGTERM, [](int) { interrupted = true; });
}

} // namespace gsh::programs
