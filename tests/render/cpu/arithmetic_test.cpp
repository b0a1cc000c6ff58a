// SPDX-License-Identifier: Apache-2.0
#include <gsh/render/cpu/arithmetic.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

using namespace gsh::cpu;

TEST_CASE_TEMPLATE("exp2_minus is 2^-x to two units in the last place", T, float, double) {
    double largest = 0;
    const T end = sizeof(T) == 4 ? T(125) : T(1020);
    for (T x = 0; x < end; x += T(0.00371))
        largest = std::max(largest, std::abs(static_cast<double>(exp2_minus(x) / std::exp2(-x)) - 1));
    CHECK(largest <= 2 * std::numeric_limits<T>::epsilon());
    CHECK(exp2_minus(T(0)) == T(1));
}

TEST_CASE("a rough root") {
    double rough = 0;
    for (double x = 1e-12; x < 1e25; x *= 1.37) {
        const float f = static_cast<float>(x);
        rough = std::max(rough, std::abs(static_cast<double>(rough_sqrt(f)) / std::sqrt(static_cast<double>(f)) - 1));
    }
    CHECK(rough <= 1e-5);
    CHECK(rough_sqrt(0.0f) == 0);
}

TEST_CASE("positive numbers compare as integers") {
    CHECK(max_positive(0.0f, 1e-36f) == 1e-36f);
    CHECK(max_positive(0.5, 0.25) == 0.5);
    CHECK(min_positive(0.5f, 0.25f) == 0.25f);
    CHECK(min_positive(2.0, 0.99) == 0.99);
}
