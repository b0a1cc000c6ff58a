// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/math/nonnegative.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

namespace gsh {

TEST_CASE("the minimum over numbers that are not negative has no gradient inside and none inwards at zero") {
    test::Rng rng(3);
    constexpr std::size_t K = 9, rows = 20;
    for (int trial = 0; trial < 20; ++trial) {
        std::vector<double> M(rows * K), A(K * K, 0), b(K), x(K, 1.0), gradient(K);
        for (double& value : M) value = rng.uniform(-1, 1);
        for (double& value : b) value = rng.uniform(-1, 1);
        for (std::size_t i = 0; i < K; ++i)
            for (std::size_t j = 0; j < K; ++j)
                for (std::size_t r = 0; r < rows; ++r) A[i * K + j] += M[r * K + i] * M[r * K + j];
        const auto slope = [&](std::size_t k) {
            double sum = -b[k];
            for (std::size_t j = 0; j < K; ++j) sum += A[k * K + j] * x[j];
            return sum;
        };
        for (std::size_t k = 0; k < K; ++k) gradient[k] = slope(k);
        descend_nonnegative<double>(A, gradient, x);
        std::size_t at_zero = 0;
        for (std::size_t k = 0; k < K; ++k) {
            CHECK(x[k] >= 0);
            at_zero += x[k] == 0;
            if (x[k] > 0) CHECK(std::abs(slope(k)) < 1e-6);
            else CHECK(slope(k) >= -1e-6);
        }
        CHECK(at_zero > 0); // otherwise the bound is not tested
    }
    std::vector<double> A(4, 1), two(2), three(3);
    CHECK_THROWS_AS(descend_nonnegative<double>(A, two, three), ShapeError);
    CHECK_THROWS_AS(descend_nonnegative<double>(A, three, two), ShapeError);
}

} // namespace gsh
