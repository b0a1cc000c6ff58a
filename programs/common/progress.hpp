// SPDX-License-Identifier: Apache-2.0
/// @file  A progress line: redrawn on a terminal, as wide as it, and printed every ten seconds in a log.
#pragma once

#include "common/reports.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdio>
#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

namespace gsh::programs {

/// Characters of a UTF-8 text, each taken as one column of a terminal.
[[nodiscard]] inline std::size_t columns_of(const std::string& text) {
    return static_cast<std::size_t>(
        std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

/// Title, bar, percentage, details and seconds left, in at most `width` columns; 0 means without a limit.
///
/// The details are pieces that are separated by two blanks, the most important one first. Where the line is too long, the
/// bar becomes shorter; then pieces are left out from the last one on; then the bar and the time; the title is cut last.
[[nodiscard]] inline std::string progress_line(const std::string& title, double fraction, std::string details,
                                               std::optional<double> seconds_left, std::size_t width) {
    fraction = std::clamp(fraction, 0.0, 1.0);
    char percent[16], left[32] = "";
    std::snprintf(percent, sizeof percent, " %3.0f%%", 100 * fraction);
    if (seconds_left) std::snprintf(left, sizeof left, "  %.0f s left", std::max(0.0, *seconds_left));
    const auto with_bar = [&](std::size_t size) {
        const auto filled = static_cast<std::size_t>(fraction * static_cast<double>(size));
        return title + " [" + std::string(filled, '#') + std::string(size - filled, '.') + "]" + percent +
               (details.empty() ? "" : "  " + details) + left;
    };
    while (true) {
        for (const std::size_t size : {24, 10})
            if (std::string line = with_bar(size); width == 0 || columns_of(line) <= width) return line;
        if (details.empty()) break;
        const auto piece = details.rfind("  ");
        details.erase(piece == std::string::npos ? 0 : piece);
    }
    for (std::string line : {title + percent + left, title + percent})
        if (columns_of(line) <= width) return line;
    std::string line = title + percent;
    while (columns_of(line) > width) line.pop_back(); // bytes of a character go before its first one
    return line;
}

/// Title and seconds, in at most `width` columns; 0 means without a limit.
[[nodiscard]] inline std::string elapsed_line(const std::string& title, double seconds, std::size_t width) {
    char elapsed[32];
    std::snprintf(elapsed, sizeof elapsed, "  %.0f s", seconds);
    for (std::string line : {title + " \u2026" + elapsed, title + elapsed})
        if (width == 0 || columns_of(line) <= width) return line;
    std::string line = title;
    while (columns_of(line) > width) line.pop_back();
    return line;
}

/// Columns of the terminal on standard error; 80 if it does not tell.
[[nodiscard]] inline std::size_t terminal_width() {
    winsize size{};
    return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

/// Shows the progress of a long job, so that no program is silent for long. On a terminal, the line is redrawn ten times
/// per second at most, and once a second while nothing is reported. Otherwise, a new line is printed every ten seconds,
/// so that logs stay short. A job that reports nothing shows its title and the seconds that it has taken, in a log every
/// half minute; one that ends within the first second, nothing.
class Progress {
public:
    explicit Progress(std::string title)
        : title_(std::move(title)), terminal_(isatty(STDERR_FILENO) == 1) {
        send_report({"progress", title_, "", ""}, WhenFull::drop);
        try {
            ticker_ = std::thread([this] { tick(); }); // last: no destructor joins it after an error here
        } catch (const std::system_error&) {
            // The system has no more threads: the line appears when the job reports.
        }
    }
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress() { finish(); }

    /// `fraction` is in [0, 1]; `details` follow the percentage, in pieces as progress_line takes them.
    void show(double fraction, const std::string& details) {
        send_report({"progress", title_, std::to_string(fraction), details}, WhenFull::drop);
        const std::lock_guard lock(mutex_);
        const auto now = Clock::now();
        if (!fraction_) {
            first_ = now, first_fraction_ = fraction; // a resumed job does not begin at 0
            wake_.notify_one();                       // lines come more often from now on
        }
        fraction_ = fraction, reported_ = now, details_ = details;
        if (shown_ && fraction < 1 && now - last_ < (terminal_ ? Clock::duration(tenth) : Clock::duration(log_pause)))
            return;
        print(now);
    }

    /// Ends the line.
    void finish() {
        {
            const std::lock_guard lock(mutex_);
            finished_ = true;
        }
        wake_.notify_one();
        if (ticker_.joinable()) ticker_.join();
        if (shown_ && terminal_) std::fputc('\n', stderr);
        shown_ = false;
    }

private:
    using Clock = std::chrono::steady_clock;
    static constexpr std::chrono::milliseconds tenth{100};
    static constexpr std::chrono::seconds log_pause{10}, silent_pause{30};

    std::string title_, details_;
    bool terminal_, shown_ = false, finished_ = false;
    std::optional<double> fraction_; // the last one reported
    double first_fraction_ = 0;
    Clock::time_point start_ = Clock::now(), first_ = start_, reported_ = start_, last_ = start_;
    std::mutex mutex_; // of all above
    std::condition_variable wake_;
    std::thread ticker_; // last: it uses the others; or none

    static double seconds(Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

    void print(Clock::time_point now) {
        last_ = now;
        shown_ = true;
        // The last column stays free: in it, some terminals already go to the next line.
        const std::size_t width = terminal_ ? std::max<std::size_t>(terminal_width(), 2) - 1 : 0;
        std::string line;
        if (fraction_) {
            const double covered = *fraction_ - first_fraction_;
            std::optional<double> left;
            if (covered > 0) left = seconds(reported_ - first_) * (1 - *fraction_) / covered - seconds(now - reported_);
            line = progress_line(title_, *fraction_, details_, left, width);
        } else {
            line = elapsed_line(title_, seconds(now - start_), width);
        }
        std::fprintf(stderr, "%s%s%s", terminal_ ? "\r\033[K" : "", line.c_str(), terminal_ ? "" : "\n");
        std::fflush(stderr);
    }

    /// Shows that the job goes on while it reports nothing.
    void tick() {
        std::unique_lock lock(mutex_);
        const auto pause = [&] { return terminal_ ? std::chrono::seconds(1) : fraction_ ? log_pause : silent_pause; };
        while (!finished_) {
            wake_.wait_until(lock, last_ + pause());
            if (const auto now = Clock::now(); !finished_ && now - last_ >= pause()) try {
                    print(now);
                } catch (const std::bad_alloc&) { // the next line may have memory
                    last_ = now;
                }
        }
    }
};

} // namespace gsh::programs
