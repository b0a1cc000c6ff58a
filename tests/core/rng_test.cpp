// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/rng.hpp>

#include <doctest/doctest.h>

using namespace gsh;

TEST_CASE("mix_bits is SplitMix64") {
    // The first outputs of the published generator for seed 0: state 0 and 0x9E3779B97F4A7C15.
    CHECK(mix_bits(0) == 0xE220A8397B1DCDAFull);
    CHECK(mix_bits(0x9E3779B97F4A7C15ull) == 0x6E789E6AA1B965F4ull);
}

TEST_CASE("draws depend on seed and counter alone") {
    Rng rng(42);
    for (std::uint64_t i = 0; i < 5; ++i) CHECK(rng.bits() == random_bits(42, i));
    Rng resumed(rng.state());
    CHECK(resumed.uniform() == rng.uniform());
    CHECK(Rng(1).bits() != Rng(2).bits());
}

TEST_CASE("uniform and normal draws have their moments") {
    Rng rng(3);
    constexpr int count = 20000;
    double sum = 0, sum_normal = 0, squares_normal = 0;
    for (int i = 0; i < count; ++i) {
        const double u = rng.uniform(-1, 3), n = rng.normal();
        CHECK_UNARY(u >= -1 && u < 3);
        sum += u, sum_normal += n, squares_normal += n * n;
    }
    CHECK(sum / count == doctest::Approx(1).epsilon(0.03));
    CHECK(std::abs(sum_normal / count) < 0.03);
    CHECK(squares_normal / count == doctest::Approx(1).epsilon(0.03));
}

TEST_CASE("below stays below and reaches every value") {
    Rng rng(4);
    int seen[5] = {};
    for (int i = 0; i < 500; ++i) ++seen[rng.below(5)];
    for (const int times : seen) CHECK(times > 50);
    CHECK(rng.below(1) == 0);
}
