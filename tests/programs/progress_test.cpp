// SPDX-License-Identifier: Apache-2.0
/// @file  The progress line of the programs fits its terminal, and long jobs are not silent.
#include <doctest/doctest.h>

#include "common/progress.hpp"
#include "support/contains.hpp"

#include <pty.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <string>
#include <thread>

namespace {

using namespace gsh::programs;

const std::string details = "step 1200  PSNR 31.42 dB  8.3 steps/s  loss 0.0214";

/// What a job shows on a terminal of 60 columns.
template <class Job>
std::string shown_on_terminal(const Job& job) {
    int terminal = -1, other = -1;
    const winsize size{.ws_row = 20, .ws_col = 60, .ws_xpixel = 0, .ws_ypixel = 0};
    REQUIRE(openpty(&terminal, &other, nullptr, nullptr, &size) == 0);
    const int before = dup(STDERR_FILENO);
    dup2(other, STDERR_FILENO);
    job();
    dup2(before, STDERR_FILENO);
    close(before);
    close(other);
    std::string shown;
    char bytes[4096];
    for (ssize_t count; (count = read(terminal, bytes, sizeof bytes)) > 0;)
        shown.append(bytes, static_cast<std::size_t>(count));
    close(terminal);
    return shown;
}

TEST_CASE("progress_line without a limit has everything") {
    CHECK(progress_line("training light", 0.5, details, 95.6, 0) ==
          "training light [############............]  50%  step 1200  PSNR 31.42 dB  8.3 steps/s  loss 0.0214  96 s "
          "left");
    CHECK(progress_line("animating", 0, "", {}, 0) == "animating [........................]   0%");
    CHECK(progress_line("animating", 1.2, "", 0.0, 0) == "animating [########################] 100%  0 s left");
}

TEST_CASE("progress_line leaves out the least important first") {
    CHECK(progress_line("training light", 0.5, details, 95.6, 99) ==
          "training light [#####.....]  50%  step 1200  PSNR 31.42 dB  8.3 steps/s  loss 0.0214  96 s left");
    CHECK(progress_line("training light", 0.5, details, 95.6, 79) ==
          "training light [#####.....]  50%  step 1200  PSNR 31.42 dB  96 s left");
    CHECK(progress_line("training light", 0.5, details, 95.6, 44) == "training light [#####.....]  50%  96 s left");
    CHECK(progress_line("training light", 0.5, details, 95.6, 39) == "training light  50%  96 s left");
    CHECK(progress_line("training light", 0.5, details, 95.6, 20) == "training light  50%");
    CHECK(progress_line("training light", 0.5, details, 95.6, 5) == "train");
}

TEST_CASE("elapsed_line leaves out the least important first") {
    CHECK(elapsed_line("reading walk.bvh", 12.3, 0) == "reading walk.bvh \u2026  12 s");
    CHECK(elapsed_line("reading walk.bvh", 12.3, 24) == "reading walk.bvh \u2026  12 s");
    CHECK(elapsed_line("reading walk.bvh", 12.3, 23) == "reading walk.bvh  12 s");
    CHECK(elapsed_line("reading walk.bvh", 12.3, 20) == "reading walk.bvh");
    CHECK(elapsed_line("reading walk.bvh", 12.3, 7) == "reading");
}

TEST_CASE("A job that reports nothing shows that it goes on, and a short one shows nothing") {
    const std::string shown = shown_on_terminal([] {
        const Progress progress("reading walk.bvh");
        std::this_thread::sleep_for(std::chrono::milliseconds(1200));
    });
    CHECK(shown == test::contains("reading walk.bvh \u2026  1 s"));
    CHECK(shown.ends_with("\r\n"));
    CHECK(shown_on_terminal([] { const Progress progress("reading walk.bvh"); }).empty());
}

TEST_CASE("A job that has reported is drawn again while it reports nothing more") {
    const std::string shown = shown_on_terminal([] {
        Progress progress("judging");
        progress.show(0.25, "first");
        progress.show(0.5, "second"); // less than a tenth of a second later: not drawn yet
        std::this_thread::sleep_for(std::chrono::milliseconds(1200));
    });
    CHECK(shown == test::contains("25%  first"));
    CHECK(shown == test::contains("50%  second"));
}

TEST_CASE("progress_line never exceeds its width, and never cuts a character in two") {
    for (std::size_t width = 1; width < 130; ++width)
        for (const std::string title : {"fitting test poses", "\u00e9valuation \u2026 na\u00efve"}) {
            const std::string line = progress_line(title, 0.37, details, 1234.0, width);
            CAPTURE(width);
            CAPTURE(line);
            CHECK(columns_of(line) <= width);
            std::size_t lacking = 0; // bytes that the last character still lacks
            for (const char c : line) {
                const auto byte = static_cast<unsigned char>(c);
                if (lacking > 0) {
                    CHECK((byte & 0xC0) == 0x80);
                    --lacking;
                } else {
                    CHECK((byte & 0xC0) != 0x80);
                    lacking = byte >= 0xE0 ? 2 : byte >= 0xC0 ? 1 : 0;
                }
            }
            CHECK(lacking == 0);
        }
}

} // namespace
