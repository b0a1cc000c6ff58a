// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_regressor.hpp>

#include "io/temporary.hpp"

#include <gsh/core/rng.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

using namespace gsh;

namespace {

/// Points on a tube along y.
std::vector<vec3<double>> tube() {
    std::vector<vec3<double>> points;
    for (int ring = -10; ring <= 10; ++ring)
        for (int k = 0; k < 12; ++k)
            points.emplace_back(0.05 * std::cos(k * 0.5236), 0.02 * ring, 0.05 * std::sin(k * 0.5236));
    return points;
}

vec3<double> mean_of(const std::vector<RegressorEntry>& row, const std::vector<vec3<double>>& points) {
    vec3<double> sum(0);
    for (const RegressorEntry& entry : row) sum += points[static_cast<std::size_t>(entry.vertex)] * entry.weight;
    return sum;
}

} // namespace

TEST_CASE("vertices around a point lie on all sides of it, each the nearest in its direction") {
    const auto points = tube();
    std::vector<bool> allowed(points.size(), true);
    const vec3<double> inside(0.01, 0.03, 0);
    const std::vector<int> around = vertices_around(points, allowed, inside, 100);
    CHECK(around.size() > 30);
    CHECK(around.size() <= 100);
    CHECK(std::is_sorted(around.begin(), around.end()));
    for (const vec3<double>& side : {vec3<double>(1, 0, 0), {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}})
        CHECK(std::any_of(around.begin(), around.end(),
                          [&](int v) { return dot(points[static_cast<std::size_t>(v)] - inside, side) > 0.02; }));
    std::fill(allowed.begin(), allowed.begin() + 120, false); // the lower half
    for (const int v : vertices_around(points, allowed, inside, 100)) CHECK(v >= 120);
    allowed.assign(points.size(), true);
    CHECK(vertices_around(points, allowed, points[7], 100) == std::vector<int>{7});

    std::vector<vec3<double>> mirrored = points; // the same vertices on the other side
    for (auto& p : mirrored) p.x = -p.x;
    CHECK(vertices_around(mirrored, allowed, {-0.01, 0.03, 0}, 100) == around);
}

TEST_CASE("a fitted row is positive, sums to 1, and gives the joint in all shapes") {
    const auto points = tube();
    std::vector<int> candidates(points.size());
    for (std::size_t v = 0; v < points.size(); ++v) candidates[v] = static_cast<int>(v);
    // The joint of a true row, in shapes that stretch, bend and shift the tube.
    Rng rng(2);
    std::vector<RegressorEntry> truth;
    for (int k = 0; k < 5; ++k) truth.push_back({static_cast<int>(rng.below(points.size())), 0.2});
    std::vector<std::vector<vec3<double>>> shapes = {points};
    std::vector<vec3<double>> joint = {mean_of(truth, points)};
    for (int s = 0; s < 4; ++s) {
        std::vector<vec3<double>> moved;
        for (const auto& p : points)
            moved.emplace_back(s == 0   ? 0.1 * p.x
                               : s == 3 ? 0.02
                                        : 0.0,
                               s == 1 ? 0.1 * p.y : 0.0, s == 2 ? p.y * p.y : 0.0);
        joint.push_back(mean_of(truth, moved));
        shapes.push_back(std::move(moved));
    }
    const auto row = fitted_regressor_row<double>(candidates, shapes, joint);
    double sum = 0;
    for (const RegressorEntry& entry : row) {
        CHECK(entry.weight > 0);
        sum += entry.weight;
    }
    CHECK(sum == doctest::Approx(1));
    CHECK(length(mean_of(row, shapes[0]) - joint[0]) < 1e-6);
    for (std::size_t s = 1; s < shapes.size(); ++s) CHECK(length(mean_of(row, shapes[s]) - joint[s]) < 2e-4);
}

TEST_CASE("a joint outside of its candidates gets the nearest mean of them") {
    const std::vector<vec3<double>> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {5, 5, 5}};
    const auto row = fitted_regressor_row<double>({0, 1, 2}, {points}, {vec3<double>(0.5, 0.5, 1)});
    const vec3<double> mean = mean_of(row, points);
    CHECK(length(mean - vec3<double>(0.5, 0.5, 0)) < 1e-3);
    CHECK(fitted_regressor_row<double>({3}, {points}, {vec3<double>(0)})[0].weight == 1);
    CHECK_THROWS_AS((void)fitted_regressor_row<double>({}, {points}, {vec3<double>(0)}), ValueError);
    CHECK_THROWS_AS((void)fitted_regressor_row<double>({0}, {points}, {}), ShapeError);
}
