// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/body/nearest_points.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {
namespace {

double brute_force(const std::vector<vec3<double>>& points, std::size_t i, std::size_t count) {
    std::vector<double> squared;
    for (std::size_t k = 0; k < points.size(); ++k)
        if (k != i) squared.push_back(dot(points[k] - points[i], points[k] - points[i]));
    std::sort(squared.begin(), squared.end());
    squared.resize(std::min(squared.size(), count));
    double sum = 0;
    for (double s : squared) sum += s;
    return squared.empty() ? 0 : sum / static_cast<double>(squared.size());
}

TEST_CASE("the grid finds what a search of everything finds") {
    test::Rng rng(1);
    std::vector<std::vector<vec3<double>>> sets{rng.vecs(1), rng.vecs(2), rng.vecs(4), rng.vecs(700)};
    auto flat = rng.vecs(300);
    for (auto& p : flat) p.z = 1;
    auto line = rng.vecs(100);
    for (auto& p : line) p.y = p.z = 0;
    auto clumps = rng.vecs(200, -0.001, 0.001);
    for (std::size_t i = 0; i < 20; ++i) clumps.push_back(rng.vec(5, 6));
    auto same = std::vector<vec3<double>>(9, vec3<double>(3));
    for (auto* set : {&flat, &line, &clumps, &same}) sets.push_back(*set);
    for (const auto& points : sets) {
        const NearestPoints nearest(points);
        for (std::size_t i = 0; i < points.size(); ++i)
            CHECK(nearest.mean_squared_distance(i, 3) == doctest::Approx(brute_force(points, i, 3)));
    }
    CHECK_NOTHROW(NearestPoints({}));
}

TEST_CASE("a place's nearest point is found inside the grid and far outside of it") {
    test::Rng rng(2);
    auto flat = rng.vecs(200);
    for (auto& p : flat) p.z = 1;
    for (const auto& points : {rng.vecs(1), rng.vecs(3), rng.vecs(500), flat}) {
        const NearestPoints nearest(points);
        auto places = rng.vecs(200, -1.5, 1.5);
        for (const auto& far : rng.vecs(50, -6, 6)) places.push_back(far);
        places.push_back(points.back());
        for (const auto& place : places) {
            double least = INFINITY;
            for (const auto& p : points) least = std::min(least, dot(p - place, p - place));
            CHECK(nearest.squared_distance(place) == least);
        }
    }
    CHECK(NearestPoints({}).squared_distance({0, 0, 0}) == INFINITY);
}

TEST_CASE("the nearest points of a place are found, nearest first") {
    test::Rng rng(12);
    const auto points = rng.vecs(400);
    const NearestPoints grid(points);
    for (int trial = 0; trial < 20; ++trial) {
        const vec3<double> place = rng.vec(-1.5, 1.5);
        std::vector<std::pair<double, std::size_t>> all;
        for (std::size_t i = 0; i < points.size(); ++i)
            all.push_back({dot(points[i] - place, points[i] - place), i});
        std::sort(all.begin(), all.end());
        const auto found = grid.nearest(place, 7);
        REQUIRE(found.size() == 7);
        for (std::size_t k = 0; k < 7; ++k) CHECK(found[k].second == all[k].second);
    }
    CHECK(grid.nearest({0, 0, 0}, 1000).size() == 400);
}

} // namespace
} // namespace gsh
