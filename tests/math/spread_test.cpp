// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/spread.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("the median and the deviation of few numbers") {
    CHECK(robust_spread({}).median == 0);
    CHECK(robust_spread({}).deviation == 0);
    CHECK(robust_spread({3}).median == 3);
    CHECK(robust_spread({3}).deviation == 0);
    CHECK(robust_spread({4, 1}).median == 4); // the upper of the middle two
    const Spread spread = robust_spread({7, 1, 2, 3, 100});
    CHECK(spread.median == 3);
    CHECK(spread.deviation == doctest::Approx(1.4826 * 2)); // distances 0, 1, 2, 4, 97
}

TEST_CASE("outliers move neither median nor deviation far") {
    test::Rng rng(3);
    std::vector<double> numbers;
    for (std::size_t i = 0; i < 4000; ++i) numbers.push_back(5 + 2 * rng.normal());
    const Spread clean = robust_spread(numbers);
    CHECK(clean.median == doctest::Approx(5).epsilon(0.02));
    CHECK(clean.deviation == doctest::Approx(2).epsilon(0.05));
    for (std::size_t i = 0; i < 400; ++i) numbers[10 * i] = 1e6;
    const Spread spoilt = robust_spread(numbers);
    CHECK(std::abs(spoilt.median - 5) < 0.5);
    CHECK(spoilt.deviation < 2.5);
}
