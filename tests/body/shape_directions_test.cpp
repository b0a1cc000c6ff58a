// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/shape_directions.hpp>

#include "io/temporary.hpp"

#include <gsh/core/rng.hpp>

#include <cmath>
#include <vector>

using namespace gsh;

namespace {

struct Problem {
    std::vector<std::vector<float>> targets; // [T][3 V]
    std::vector<double> weights, covariance;
    std::vector<double> shapes; // [3 V, 3 V] covariance of what the targets make
};

/// T targets of 2000 numbers, more than one block of rows, with correlated coefficients.
Problem make_problem(std::size_t T, std::size_t V) {
    Rng rng(3);
    Problem p;
    for (std::size_t t = 0; t < T; ++t) {
        p.targets.emplace_back();
        for (std::size_t i = 0; i < 3 * V; ++i) p.targets[t].push_back(static_cast<float>(rng.normal()));
    }
    for (std::size_t v = 0; v < V; ++v) p.weights.push_back(rng.uniform(0.1, 2));
    std::vector<double> root(T * T);
    for (double& x : root) x = rng.normal();
    p.covariance.assign(T * T, 0);
    for (std::size_t t = 0; t < T; ++t)
        for (std::size_t u = 0; u < T; ++u)
            for (std::size_t k = 0; k < T; ++k) p.covariance[t * T + u] += root[t * T + k] * root[u * T + k];
    return p;
}

} // namespace

TEST_CASE("products of targets are weighted sums over vertices") {
    const Problem p = make_problem(5, 700);
    const auto products = target_products(p.targets, p.weights);
    for (std::size_t t = 0; t < 5; ++t)
        for (std::size_t u = 0; u < 5; ++u) {
            double expected = 0;
            for (std::size_t i = 0; i < 2100; ++i)
                expected +=
                    p.weights[i / 3] * static_cast<double>(p.targets[t][i]) * static_cast<double>(p.targets[u][i]);
            CHECK(products[t * 5 + u] == doctest::Approx(expected));
        }
    CHECK_THROWS_AS((void)target_products({{1, 2}}, p.weights), ShapeError);
    CHECK(target_products({}, p.weights).empty());
}

TEST_CASE("principal mixtures are orthogonal directions with the covariance of the shapes") {
    constexpr std::size_t T = 4, V = 7;
    const Problem p = make_problem(T, V);
    const auto products = target_products(p.targets, p.weights);
    const ShapeMixture mixture = principal_mixture<double>(products, p.covariance, T, 9);
    REQUIRE(mixture.count == T); // there are no more
    std::vector<std::vector<double>> directions(T, std::vector<double>(3 * V, 0.0));
    for (std::size_t k = 0; k < T; ++k)
        for (std::size_t t = 0; t < T; ++t)
            for (std::size_t i = 0; i < 3 * V; ++i)
                directions[k][i] += mixture.mixing[t * T + k] * static_cast<double>(p.targets[t][i]);
    for (std::size_t k = 0; k < T; ++k)
        for (std::size_t l = 0; l < T; ++l) {
            double product = 0;
            for (std::size_t i = 0; i < 3 * V; ++i) product += p.weights[i / 3] * directions[k][i] * directions[l][i];
            CHECK(product == doctest::Approx(k == l ? mixture.variances[k] : 0).scale(mixture.variances[0]));
        }
    for (std::size_t k = 1; k < T; ++k) CHECK(mixture.variances[k] <= mixture.variances[k - 1]);
    for (std::size_t i = 0; i < 3 * V; ++i)
        for (std::size_t j = 0; j < 3 * V; ++j) {
            double expected = 0, found = 0;
            for (std::size_t t = 0; t < T; ++t)
                for (std::size_t u = 0; u < T; ++u)
                    expected += static_cast<double>(p.targets[t][i]) * p.covariance[t * T + u] *
                                static_cast<double>(p.targets[u][j]);
            for (std::size_t k = 0; k < T; ++k) found += directions[k][i] * directions[k][j];
            CHECK(found == doctest::Approx(expected).scale(100));
        }

    const ShapeMixture first = principal_mixture<double>(products, p.covariance, T, 2);
    REQUIRE(first.count == 2);
    for (std::size_t k = 0; k < 2; ++k) CHECK(first.variances[k] == doctest::Approx(mixture.variances[k]));
    CHECK(principal_mixture<double>(products, p.covariance, T, 0).count == 0);
}

TEST_CASE("coefficients that do not vary add no direction") {
    const std::vector<double> products = {1, 0, 0, 1}, covariance = {4, 0, 0, 0};
    const ShapeMixture mixture = principal_mixture<double>(products, covariance, 2, 2);
    CHECK(mixture.variances[0] == doctest::Approx(4));
    CHECK(mixture.variances[1] == doctest::Approx(0));
    CHECK(std::abs(mixture.mixing[0]) == doctest::Approx(2));
    test::check_throws<ShapeError>([&] { (void)principal_mixture<double>(products, covariance, 3, 2); },
                                   {"principal_mixture", "gram", "9"});
}
