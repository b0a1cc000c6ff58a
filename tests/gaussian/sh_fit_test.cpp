// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/sh_fit.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("colours that SH can show are found") {
    test::Rng rng(1);
    const auto truth = rng.vecs(16);
    const std::vector<vec3<double>> prior(16, vec3<double>(0.0));
    ShFit<3> fit(prior.data());
    for (int i = 0; i < 60; ++i) {
        const vec3<double> dir = normalize(rng.vec());
        fit.add(dir, SHEval<3>::forward(truth.data(), dir) + vec3<double>(0.5), rng.uniform(0.5, 2));
    }
    std::vector<vec3<double>> found(16);
    fit.solve(1e-12, found.data());
    for (std::size_t k = 0; k < 16; ++k) CHECK(length(found[k] - truth[k]) < 1e-8);
}

TEST_CASE("the result minimises the sum of squares and the ridge") {
    test::Rng rng(2);
    const auto prior = rng.vecs(9), colors = rng.vecs(5), noise = rng.vecs(5);
    std::vector<double> weights = rng.numbers(5, 0.1, 1);
    std::vector<vec3<double>> dirs;
    ShFit<2> fit(prior.data());
    for (std::size_t i = 0; i < 5; ++i) {
        dirs.push_back(normalize(noise[i]));
        fit.add(dirs[i], colors[i], weights[i]);
    }
    constexpr double ridge = 0.05;
    std::vector<vec3<double>> found(9);
    fit.solve(ridge, found.data());
    const auto cost = [&] {
        double sum = 0, total = 0;
        for (std::size_t i = 0; i < 5; ++i) {
            const vec3<double> r = SHEval<2>::forward(found.data(), dirs[i]) + vec3<double>(0.5) - colors[i];
            sum += weights[i] * dot(r, r), total += weights[i];
        }
        for (std::size_t k = 0; k < 9; ++k) sum += ridge * total * dot(found[k] - prior[k], found[k] - prior[k]);
        return sum;
    };
    const double least = cost();
    for (double& number : test::scalars(found)) {
        const double kept = number;
        number = kept + 1e-4;
        const double above = cost();
        number = kept - 1e-4;
        const double below = cost();
        number = kept;
        CHECK(above > least);
        CHECK(below > least);
        CHECK(std::abs(above - below) < 1e-12);
    }
}

TEST_CASE("without colours the result is the prior") {
    test::Rng rng(3);
    const auto prior = rng.vecs(4);
    std::vector<vec3<double>> found(4);
    ShFit<1> fit(prior.data());
    fit.solve(0.1, found.data());
    CHECK(found == prior);
    fit.add({0, 0, 1}, {1, 1, 1}, 0);
    fit.solve(0.1, found.data());
    CHECK(found == prior);
}
