// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/low_rank.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

using namespace gsh;

namespace {

/// `count` rows around a base that vary in `rank` directions, each weaker than the one before by `decay`.
struct LowRankSample {
    std::vector<float> base, weights;
    std::vector<std::vector<float>> rows;

    LowRankSample(std::size_t size, std::size_t count, std::size_t rank, double decay) {
        test::Rng rng(3);
        const auto numbers = [&](std::size_t n) {
            std::vector<double> result(n);
            for (double& x : result) x = rng.uniform(-1, 1);
            return result;
        };
        std::vector<std::vector<double>> directions;
        for (std::size_t k = 0; k < rank; ++k) directions.push_back(numbers(size));
        for (std::size_t i = 0; i < size; ++i) {
            base.push_back(static_cast<float>(rng.uniform(0.5, 1)));
            weights.push_back(static_cast<float>(rng.uniform(0, 2)));
        }
        for (std::size_t t = 0; t < count; ++t) {
            const std::vector<double> shares = numbers(rank);
            std::vector<float>& row = rows.emplace_back(base);
            for (std::size_t i = 0; i < size; ++i)
                for (std::size_t k = 0; k < rank; ++k)
                    row[i] += static_cast<float>(shares[k] * std::pow(decay, k) * directions[k][i]);
        }
    }
    [[nodiscard]] LowRank product(const LowRankParams& params) const {
        LowRankRows maker(base, weights, params);
        for (const auto& row : rows) maker.add(row);
        return maker.finish();
    }
    /// Root of the weighted mean square of the difference between the rows and a product.
    [[nodiscard]] double error(const LowRank& p) const {
        double sum = 0, total = 0;
        for (std::size_t t = 0; t < rows.size(); ++t)
            for (std::size_t i = 0; i < base.size(); ++i) {
                auto value = static_cast<double>(base[i]);
                for (std::size_t k = 0; k < p.rank; ++k)
                    value += static_cast<double>(p.coefficients[t * p.rank + k] * p.basis[k * base.size() + i]);
                const auto weight = static_cast<double>(weights[i]);
                sum += weight * std::pow(static_cast<double>(rows[t][i]) - value, 2), total += weight;
            }
        return std::sqrt(sum / total);
    }
};

} // namespace

TEST_CASE("rows that vary in a few directions come back, with as many directions") {
    const LowRankSample sample(101, 30, 5, 1);
    const LowRank product = sample.product({.tolerance = 1e-5});
    CHECK(product.rank == 5);
    CHECK(product.basis.size() == 5 * 101);
    CHECK(product.coefficients.size() == 30 * 5);
    CHECK(sample.error(product) < 1e-5);
    CHECK(product.error < 1e-5);
}

TEST_CASE("the error stays within the tolerance, is the one that is stated, and one direction fewer is too few") {
    const LowRankSample sample(400, 60, 40, 0.75);
    std::size_t last = 41;
    for (const double tolerance : {1e-4, 1e-3, 1e-2, 1e-1}) {
        INFO(tolerance);
        const LowRank product = sample.product({.tolerance = tolerance});
        CHECK(product.rank < last);
        last = product.rank;
        CHECK(product.error <= tolerance);
        CHECK(sample.error(product) == doctest::Approx(product.error).epsilon(0.01));
        const LowRank fewer = sample.product({.tolerance = tolerance, .most_rank = product.rank - 1});
        CHECK(fewer.rank == product.rank - 1);
        CHECK(fewer.error > tolerance);
        CHECK(sample.error(fewer) == doctest::Approx(fewer.error).epsilon(0.01));
    }
}

TEST_CASE("numbers of weight 0 do not count, and the scale of the weights does not matter") {
    LowRankSample sample(50, 20, 3, 1);
    for (std::size_t i = 25; i < 50; ++i) sample.weights[i] = 0;
    test::Rng rng(4);
    for (auto& row : sample.rows)
        for (std::size_t i = 25; i < 50; ++i) row[i] = static_cast<float>(rng.uniform(0, 1));
    CHECK(sample.product({.tolerance = 1e-4}).rank == 3);
    const LowRank before = sample.product({});
    for (float& w : sample.weights) w *= 4;
    const LowRank after = sample.product({});
    CHECK(after.rank == before.rank);
    CHECK(after.error == doctest::Approx(before.error));
}

TEST_CASE("no rows, no numbers, rows that are the base") {
    CHECK(LowRankRows({1, 2}, {1, 1}).finish().rank == 0);
    LowRankRows none({}, {});
    none.add({});
    CHECK(none.finish().rank == 0);
    CHECK(none.finish().error == 0);
    LowRankRows still({1, 2}, {1, 1});
    still.add(std::vector<float>{1, 2});
    CHECK(still.finish().rank == 0);
    CHECK(still.finish().coefficients.empty());
}

TEST_CASE("sizes and numbers are checked") {
    const float infinity = std::numeric_limits<float>::infinity();
    CHECK_THROWS_AS(LowRankRows({1, 2}, {1}), ShapeError);
    CHECK_THROWS_AS(LowRankRows({1, 2}, {1, -1}), ValueError);
    CHECK_THROWS_AS(LowRankRows({1, 2}, {1, infinity}), ValueError);
    CHECK_THROWS_AS(LowRankRows({1, infinity}, {1, 1}), ValueError);
    LowRankRows maker({1, 2}, {1, 1});
    CHECK_THROWS_AS(maker.add(std::vector<float>{1}), ShapeError);
    CHECK_THROWS_AS(maker.add(std::vector<float>{1, infinity}), ValueError);
}
