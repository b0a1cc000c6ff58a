// SPDX-License-Identifier: Apache-2.0
/// @file  The progress line of the programs fits its terminal.
#include <doctest/doctest.h>

#include "support/progress.hpp"

#include <cstddef>
#include <string>

namespace {

using namespace gsh::examples;

const std::string details = "step 1200  PSNR 31.42 dB  8.3 steps/s  loss 0.0214";

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
