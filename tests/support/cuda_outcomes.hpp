// SPDX-License-Identifier: Apache-2.0
/// @file  Comparison of runs on the CUDA backend with those on cpu::Serial, and with each other.
#pragma once

#include "support/small_runs.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>

namespace gsh::test {

/// PSNR of two pictures in [0, 1].
inline double psnr_of(const Image<float>& a, const Image<float>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i) {
        const double d = static_cast<double>(a.data[i]) - static_cast<double>(b.data[i]);
        sum += d * d;
    }
    return -10 * std::log10(sum / static_cast<double>(a.data.size()) + 1e-20);
}

/// Pictures of at least 60 dB, and losses (or poses) that differ by a few thousandths at most.
inline void check_near(const Outcome& found, const Outcome& expected) {
    REQUIRE(found.pictures.size() == expected.pictures.size());
    for (std::size_t i = 0; i < found.pictures.size(); ++i) {
        CAPTURE(i);
        CHECK(psnr_of(found.pictures[i], expected.pictures[i]) >= 60);
    }
    REQUIRE(found.losses.size() == expected.losses.size());
    for (std::size_t i = 0; i < found.losses.size(); ++i) {
        CAPTURE(i);
        CHECK(found.losses[i] == doctest::Approx(expected.losses[i]).epsilon(3e-3).scale(1));
    }
    CHECK(found.learned.size() == expected.learned.size());
}

/// The same bits.
inline void check_same(const Outcome& a, const Outcome& b) {
    REQUIRE(a.pictures.size() == b.pictures.size());
    for (std::size_t i = 0; i < a.pictures.size(); ++i) CHECK(a.pictures[i].data == b.pictures[i].data);
    CHECK(a.losses == b.losses);
    CHECK(a.learned == b.learned);
}

} // namespace gsh::test
