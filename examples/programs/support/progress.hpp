// SPDX-License-Identifier: Apache-2.0
/// @file  A progress line: redrawn on a terminal, printed every ten seconds in a log.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>

namespace gsh::examples {

/// Shows the progress of a long job. On a terminal, the line is redrawn ten times per second. Otherwise, a new line is
/// printed every ten seconds, so that logs stay short.
class Progress {
public:
    explicit Progress(std::string title) : title_(std::move(title)), terminal_(isatty(STDERR_FILENO) == 1) {}
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress() { finish(); }

    /// `fraction` is in [0, 1]; `details` is printed behind the percentage.
    void show(double fraction, const std::string& details) {
        const auto now = Clock::now();
        const auto pause = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(10000);
        if (shown_ && fraction < 1 && now - last_ < pause) return;
        if (!shown_) start_ = now, first_ = fraction; // a resumed job does not begin at 0
        last_ = now;
        shown_ = true;
        const double seconds = std::chrono::duration<double>(now - start_).count(), covered = fraction - first_;
        char left[32] = "";
        if (covered > 0)
            std::snprintf(left, sizeof left, "  %.0f s left", std::max(0.0, seconds * (1 - fraction) / covered));
        const int filled = static_cast<int>(std::min(fraction, 1.0) * bar_width);
        const std::string bar = std::string(static_cast<std::size_t>(filled), '#') +
                                std::string(static_cast<std::size_t>(bar_width - filled), '.');
        std::fprintf(stderr, "%s%s [%s] %3.0f%%  %s%s%s", terminal_ ? "\r\033[K" : "", title_.c_str(),
                     bar.c_str(), 100 * std::min(fraction, 1.0), details.c_str(), left, terminal_ ? "" : "\n");
        std::fflush(stderr);
    }

    void finish() {
        if (shown_ && terminal_) std::fputc('\n', stderr);
        shown_ = false;
    }

private:
    using Clock = std::chrono::steady_clock;
    static constexpr int bar_width = 24;

    std::string title_;
    bool terminal_;
    bool shown_ = false;
    double first_ = 0; // fraction when first shown
    Clock::time_point start_ = Clock::now(), last_ = start_;
};

} // namespace gsh::examples
