// SPDX-License-Identifier: Apache-2.0
/// @file  A progress line: redrawn on a terminal, as wide as it, and printed every ten seconds in a log.
#pragma once

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>

namespace gsh::examples {

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

/// Columns of the terminal on standard error; 80 if it does not tell.
[[nodiscard]] inline std::size_t terminal_width() {
    winsize size{};
    return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

/// Shows the progress of a long job. On a terminal, the line is redrawn ten times per second. Otherwise, a new line is
/// printed every ten seconds, so that logs stay short.
class Progress {
public:
    explicit Progress(std::string title) : title_(std::move(title)), terminal_(isatty(STDERR_FILENO) == 1) {}
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    ~Progress() { finish(); }

    /// `fraction` is in [0, 1]; `details` follow the percentage, in pieces as progress_line takes them.
    void show(double fraction, const std::string& details) {
        const auto now = Clock::now();
        const auto pause = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(10000);
        if (shown_ && fraction < 1 && now - last_ < pause) return;
        if (!shown_) start_ = now, first_ = fraction; // a resumed job does not begin at 0
        last_ = now;
        shown_ = true;
        const double seconds = std::chrono::duration<double>(now - start_).count(), covered = fraction - first_;
        std::optional<double> left;
        if (covered > 0) left = seconds * (1 - fraction) / covered;
        // The last column stays free: in it, some terminals already go to the next line.
        const std::string line = progress_line(title_, fraction, details, left,
                                               terminal_ ? std::max<std::size_t>(terminal_width(), 2) - 1 : 0);
        std::fprintf(stderr, "%s%s%s", terminal_ ? "\r\033[K" : "", line.c_str(), terminal_ ? "" : "\n");
        std::fflush(stderr);
    }

    void finish() {
        if (shown_ && terminal_) std::fputc('\n', stderr);
        shown_ = false;
    }

private:
    using Clock = std::chrono::steady_clock;

    std::string title_;
    bool terminal_;
    bool shown_ = false;
    double first_ = 0; // fraction when first shown
    Clock::time_point start_ = Clock::now(), last_ = start_;
};

} // namespace gsh::examples
