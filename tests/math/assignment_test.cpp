// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/assignment.hpp>

#include <gsh/core/rng.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

using namespace gsh;

namespace {

/// The cost of a choice: `none` for each row without a column.
double cost_of(const std::vector<double>& costs, std::size_t columns, double none, const std::vector<int>& choice) {
    double sum = 0;
    for (std::size_t r = 0; r < choice.size(); ++r)
        sum += choice[r] < 0 ? none : costs[r * columns + static_cast<std::size_t>(choice[r])];
    return sum;
}

/// The least cost of all choices, by trying out every one.
double least_cost(const std::vector<double>& costs, std::size_t rows, std::size_t columns, double none) {
    std::vector<int> choice(rows, -1);
    double least = none * static_cast<double>(rows);
    const auto try_out = [&](const auto& self, std::size_t row) -> void {
        if (row == rows) {
            least = std::min(least, cost_of(costs, columns, none, choice));
            return;
        }
        choice[row] = -1, self(self, row + 1);
        for (int c = 0; c < static_cast<int>(columns); ++c) {
            if (std::find(choice.begin(), choice.begin() + static_cast<std::ptrdiff_t>(row), c) !=
                choice.begin() + static_cast<std::ptrdiff_t>(row))
                continue;
            choice[row] = c, self(self, row + 1);
        }
        choice[row] = -1;
    };
    try_out(try_out, 0);
    return least;
}

} // namespace

TEST_CASE("the assignment is the cheapest of all, and gives no column twice") {
    Rng rng(3);
    for (const std::size_t rows : {0, 1, 2, 3, 5})
        for (const std::size_t columns : {0, 1, 3, 4, 6})
            for (int round = 0; round < 20; ++round) {
                std::vector<double> costs(rows * columns);
                for (double& cost : costs) cost = rng.uniform(-0.5, 2);
                const double none = rng.uniform(0, 2);
                const std::vector<int> choice = cheapest_assignment(costs, rows, columns, none);
                CAPTURE(rows);
                CAPTURE(columns);
                CAPTURE(round);
                REQUIRE(choice.size() == rows);
                std::vector<int> times(columns + 1, 0);
                for (const int c : choice) ++times[static_cast<std::size_t>(c + 1)];
                for (std::size_t c = 1; c < times.size(); ++c) CHECK(times[c] <= 1);
                CHECK(cost_of(costs, columns, none, choice) ==
                      doctest::Approx(least_cost(costs, rows, columns, none)).epsilon(1e-9));
            }
}

TEST_CASE("of equal choices the same is taken every time, and costs of another number are refused") {
    const std::vector<double> equal(9, 1.0);
    CHECK(cheapest_assignment(equal, 3, 3, 5) == cheapest_assignment(equal, 3, 3, 5));
    CHECK(cheapest_assignment(equal, 3, 3, 0.5) == std::vector<int>{-1, -1, -1});
    CHECK_THROWS_AS((void)cheapest_assignment(equal, 2, 3, 5), ShapeError);
}
