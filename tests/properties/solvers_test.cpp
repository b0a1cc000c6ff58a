// SPDX-License-Identifier: Apache-2.0
/// Small solvers against their definitions: the best of all possibilities, or the conditions of a minimum.
#include "properties/properties.hpp"

#include <gsh/camera/distortion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/color.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/assignment.hpp>
#include <gsh/math/nonnegative.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::test;

TEST_CASE("no assignment is cheaper than the cheapest") {
    check_property([] {
        const std::size_t rows = up_to(5), columns = up_to(5);
        std::vector<double> costs(rows * columns);
        for (double& c : costs) c = rarely(2) ? one_of({0.0, 1.0, -1.0, 1e9}) : around(0, 5);
        const double none = around(1, 4);
        const std::vector<int> found = cheapest_assignment(costs, rows, columns, none);
        require(found.size() == rows, [] { return "a column for each row, or -1"; });
        double sum = 0;
        std::vector<bool> used(columns);
        for (std::size_t r = 0; r < rows; ++r) {
            if (found[r] < 0) {
                sum += none;
                continue;
            }
            const auto c = static_cast<std::size_t>(found[r]);
            require(c < columns && !used[c], [] { return "a column is used twice"; });
            used[c] = true, sum += costs[r * columns + c];
        }
        std::vector<bool> taken(columns);
        const std::function<double(std::size_t)> best = [&](std::size_t r) -> double {
            if (r == rows) return 0;
            double least = none + best(r + 1);
            for (std::size_t c = 0; c < columns; ++c) {
                if (taken[c]) continue;
                taken[c] = true;
                least = std::min(least, costs[r * columns + c] + best(r + 1));
                taken[c] = false;
            }
            return least;
        };
        const double least = best(0);
        require(std::abs(sum - least) <= 1e-6 * (1 + std::abs(least)),
                [&] { return "it costs " + digits(sum) + ", the cheapest " + digits(least); });
    });
}

TEST_CASE("a quadratic function over numbers that are not negative meets the conditions of its minimum") {
    check_property([] {
        const std::size_t K = 1 + up_to(5);
        std::vector<double> F(K * K), A(K * K, 0), b(K), x(K), gradient(K);
        for (double& v : F) v = around(0, 1);
        for (std::size_t i = 0; i < K; ++i) {
            for (std::size_t j = 0; j < K; ++j)
                for (std::size_t k = 0; k < K; ++k) A[i * K + j] += F[i * K + k] * F[j * K + k];
            A[i * K + i] += 0.3;
        }
        for (double& v : b) v = around(0, 3);
        for (double& v : x) v = std::abs(around(0, 2));
        const auto gradient_at = [&](std::size_t i) {
            double sum = -b[i];
            for (std::size_t j = 0; j < K; ++j) sum += A[i * K + j] * x[j];
            return sum;
        };
        for (std::size_t i = 0; i < K; ++i) gradient[i] = gradient_at(i);
        descend_nonnegative<double>(A, gradient, x);
        for (std::size_t i = 0; i < K; ++i) {
            const double g = gradient_at(i);
            require(x[i] >= 0, [] { return "a negative number"; });
            require(g >= -1e-6, [&] { return "a larger number is better: gradient " + digits(g); });
            require(x[i] == 0 || std::abs(g) <= 1e-6, [&] { return "not a minimum: gradient " + digits(g); });
        }
    });
}

TEST_CASE("curves and their inverses") {
    check_property([] {
        const double s = std::abs(around(0.5, 0.5)), p = std::clamp(s, 1e-6, 1 - 1e-6);
        const double linear = srgb_to_linear(s);
        require(std::abs(linear_to_srgb(linear) - s) <= 1e-6,
                [&] { return "sRGB: " + digits(linear_to_srgb(linear)); });
        require(linear >= 0 && linear <= s, [] { return "light is below the curve's diagonal"; });
        require(std::abs(sigmoid(logit(p)) - p) <= 1e-14, [] { return "logit"; });
        const double x = around(0, one_of({5.0, 800.0})), y = sigmoid(x);
        require(y >= 0 && y <= 1 && std::abs(y + sigmoid(-x) - 1) <= 1e-15,
                [] { return "sigmoid(x) + sigmoid(-x) = 1"; });
    });
}

TEST_CASE("a lens distorts an undistorted point back to where it was, or says that it cannot") {
    check_property([] {
        Distortion<double> d;
        d.k1 = around(0, 0.3), d.k2 = around(0, 0.1), d.p1 = around(0, 0.01), d.p2 = around(0, 0.01),
        d.k3 = around(0, 0.05);
        const vec2<double> p(around(0, 1), around(0, 1));
        vec2<double> found;
        try {
            found = undistort_checked(d, p);
        } catch (const ValueError&) {
            return;
        }
        const vec2<double> back = distort(d, found);
        require(std::hypot(back.x - p.x, back.y - p.y) <= 1e-6, [] { return "another point"; });
    });
}
