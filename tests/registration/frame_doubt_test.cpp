// SPDX-License-Identifier: Apache-2.0
#include <gsh/registration/frame_doubt.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

TEST_CASE("a frame is believed less the farther it lies below the others and below a good fit") {
    const double nan = std::nan("");
    const std::vector<double> weights = frame_weights({12, 10, nan, 12, 6, 2, 13});
    REQUIRE(weights.size() == 7);
    for (const std::size_t t : {0, 1, 2, 3, 6}) CHECK(weights[t] == 1); // 2 dB below, or without a photograph
    const double limit = 12 - 3 * 1.4826 * 2; // the deviation, 2 dB times 1.4826, counts more than the gap of 3 dB
    CHECK(weights[4] == 1);
    CHECK(weights[5] == doctest::Approx(std::pow(10, 2 * (2 - limit) / 10)));
    CHECK(frame_weights({nan, nan}) == std::vector<double>{1, 1});
    CHECK(frame_weights({}).empty());
}

TEST_CASE("frames that are alike have a limit 3 dB below their median") {
    const std::vector<double> weights = frame_weights({10, 10.1, 10, 10, 9.8, 4, 0, 7.5});
    for (const std::size_t t : {0, 1, 2, 3, 4, 7}) CHECK(weights[t] == 1);
    CHECK(weights[5] == doctest::Approx(std::pow(10, -0.6)));
    CHECK(weights[6] == doctest::Approx(std::pow(10, -1.4)));
}

TEST_CASE("no frame of a capture that is explained well, or that has few frames, is doubted") {
    const std::vector<double> good = frame_weights({24, 25, 24.5, 13.5, 24, 25});
    CHECK(good == std::vector<double>(6, 1)); // 11 dB below the others, but well explained
    CHECK(frame_weights({11, 11, 2, 11}) == std::vector<double>(4, 1)); // three do not show what is usual
    CHECK(frame_weights({11, 11, 2, 11, 11})[2] < 0.25);
    CHECK(frame_weights({11, 2, 11}, {.frames = 3})[1] < 0.25);
}

} // namespace gsh
