// SPDX-License-Identifier: Apache-2.0
/// The curves of a training stay short, whatever its length, and keep the first step.
#include <gsh/reconstruct/training_record.hpp>

#include <doctest/doctest.h>

#include <cstdint>

using namespace gsh;

TEST_CASE("curves have the first step and every tenth, and thin themselves out when they become long") {
    TrainingRecord record;
    const auto add_until = [&](std::uint64_t from, std::uint64_t to) {
        for (std::uint64_t step = from; step <= to; ++step)
            record.add({.step = step, .loss = 1 / static_cast<double>(step), .psnr = static_cast<double>(step)});
    };
    add_until(1, 5980);
    REQUIRE(record.loss.size() == 599);
    CHECK(record.interval == 10);
    CHECK(record.loss[1] == std::pair(10.0, 0.1));
    add_until(5981, 5990); // the 600th sample
    CHECK(record.interval == 20);
    REQUIRE(record.psnr.size() == 300);
    CHECK(record.psnr[0] == std::pair(1.0, 1.0));
    CHECK(record.psnr[1] == std::pair(20.0, 20.0));
    CHECK(record.psnr.back().first == 5980);
    add_until(5991, 6000);
    CHECK(record.psnr.back().first == 6000);
}
