// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

using namespace gsh;

TEST_CASE_TEMPLATE("Wide does in every lane what the scalar does", S, float, double) {
    using W = Wide<S>;
    test::Rng rng(3);
    for (int repeat = 0; repeat < 200; ++repeat) {
        S a[W::width], b[W::width];
        for (std::size_t i = 0; i < W::width; ++i) {
            a[i] = static_cast<S>(rng.uniform(-8, 8));
            b[i] = static_cast<S>(rng.uniform(0.1, 9));
        }
        const W x = W::load(a), y = W::load(b);
        const W sum = x + y, product = x * y, quotient = x / y, root = sqrt(y), power = exp(x), least = min(x, y),
                most = max(x, y), size = abs(x), chosen = select(x < y, x, y);
        for (std::size_t i = 0; i < W::width; ++i) {
            CHECK(sum[i] == a[i] + b[i]);
            CHECK(product[i] == a[i] * b[i]);
            CHECK(quotient[i] == a[i] / b[i]);
            CHECK(root[i] == std::sqrt(b[i]));
            CHECK(least[i] == std::min(a[i], b[i]));
            CHECK(most[i] == std::max(a[i], b[i]));
            CHECK(size[i] == std::abs(a[i]));
            CHECK(chosen[i] == (a[i] < b[i] ? a[i] : b[i]));
            const double exact = std::exp(static_cast<double>(a[i]));
            CHECK(std::abs(static_cast<double>(power[i]) - exact) <=
                  4 * static_cast<double>(std::numeric_limits<S>::epsilon()) * exact);
        }
        CHECK(any(x < y) == [&] {
            for (std::size_t i = 0; i < W::width; ++i)
                if (a[i] < b[i]) return true;
            return false;
        }());
    }
}

TEST_CASE("the exponential of a Wide keeps to the scalar's ends") {
    const Wide<float> low(-200.0f), high(200.0f), zero(0.0f);
    CHECK(exp(low)[0] == doctest::Approx(0.0f));
    CHECK(exp(high)[0] > 1e38f);
    CHECK(exp(zero)[0] == 1.0f);
}
