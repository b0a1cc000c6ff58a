// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/surface_fill.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

/// Points of a plane at z, a little displaced, on a grid of `side` by `side`.
std::vector<vec3<double>> sheet(int side, double step, double z, double left = 0) {
    test::Rng rng(5);
    std::vector<vec3<double>> points;
    for (int y = 0; y < side; ++y)
        for (int x = 0; x < side; ++x) {
            const vec3<double> off = rng.vecs(1, -0.2 * step, 0.2 * step)[0];
            points.push_back({left + x * step + off.x, y * step + off.y, z});
        }
    return points;
}

} // namespace

TEST_CASE("a hole in a linear function is filled with the function, and known points are not listed") {
    const int side = 40;
    const auto points = sheet(side, 0.005, 0, 0.1); // no point has a mirror image
    std::vector<std::uint8_t> known(points.size(), 1);
    std::vector<double> values;
    std::vector<std::size_t> hole;
    for (std::size_t i = 0; i < points.size(); ++i) {
        values.push_back(3 * points[i].x - 2 * points[i].y + 1);
        if (length(points[i] - vec3<double>(0.2, 0.1, 0)) < 0.04) known[i] = 0, hole.push_back(i);
    }
    REQUIRE(hole.size() > 100);
    for (const std::size_t i : hole) values[i] = 1e6; // not read
    const SurfaceFill fill(points, {}, known);
    CHECK(fill.filled() == hole);
    const std::vector<double> found = fill.fill(values);
    REQUIRE(found.size() == hole.size());
    for (std::size_t k = 0; k < hole.size(); ++k) {
        const vec3<double>& p = points[hole[k]];
        CHECK(std::abs(found[k] - (3 * p.x - 2 * p.y + 1)) < 0.02); // of 0.24 across the hole
    }
}

TEST_CASE("deep inside, the other side decides; near the edge, the surroundings; vectors are mirrored") {
    const int side = 60;
    std::vector<vec3<double>> points = sheet(side, 0.005, 0, 0.1); // 0.1 to 0.4
    const std::size_t half = points.size();
    for (std::size_t i = 0; i < half; ++i) points.push_back({-points[i].x, points[i].y, points[i].z});
    std::vector<std::uint8_t> known(points.size(), 1);
    std::vector<double> values(points.size());
    std::size_t middle = 0, edge = 0;
    const vec3<double> center(0.25, 0.15, 0);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const double distance = length(points[i] - center);
        values[i] = i < half ? 0.2 : 0.8;
        if (distance > 0.12) continue;
        known[i] = 0;
        if (distance < length(points[middle] - center)) middle = i;
        if (distance > 0.115 && edge == 0) edge = i;
    }
    REQUIRE(edge != 0);
    const SurfaceFill fill(points, {}, known);
    const auto at = [&](std::size_t i, double mirrored) {
        const auto& filled = fill.filled();
        const auto k = std::lower_bound(filled.begin(), filled.end(), i) - filled.begin();
        return fill.fill(values, mirrored)[static_cast<std::size_t>(k)];
    };
    CHECK(at(middle, 1) > 0.7);
    CHECK(at(edge, 1) < 0.35);
    CHECK(at(middle, -1) < -0.5);
    CHECK(at(edge, -1) > 0);
}

TEST_CASE("colours do not pass between surfaces that face each other; what no path reaches has the mean") {
    const int side = 30;
    std::vector<vec3<double>> points = sheet(side, 0.005, 0, 0.1), normals(points.size(), {0, 0, 1});
    const std::size_t half = points.size();
    for (const vec3<double>& p : sheet(side, 0.005, 0.002, 0.1)) points.push_back(p), normals.push_back({0, 0, -1});
    std::vector<std::uint8_t> known(points.size(), 1);
    std::vector<double> values(points.size(), 0.1);
    for (std::size_t i = half; i < points.size(); ++i) known[i] = 0; // the whole second sheet
    const std::vector<double> apart = SurfaceFill(points, normals, known).fill(values);
    REQUIRE(apart.size() == half);
    for (std::size_t i = 0; i < half / 2; ++i) values[i] = 0.3; // the mean is 0.2
    for (const double value : SurfaceFill(points, normals, known).fill(values)) CHECK(value == doctest::Approx(0.2));
    const std::vector<double> joined = SurfaceFill(points, {}, known).fill(values); // no normals: the nearest decide
    CHECK(joined.front() > 0.28);
    CHECK(joined.back() < 0.12);
}

TEST_CASE("a surface that is known everywhere or nowhere has nothing to fill; wrong sizes are refused") {
    const auto points = sheet(5, 0.01, 0);
    CHECK(SurfaceFill(points, {}, std::vector<std::uint8_t>(25, 1)).filled().empty());
    CHECK(SurfaceFill(points, {}, std::vector<std::uint8_t>(25, 0)).filled().empty());
    CHECK(SurfaceFill(points, {}, std::vector<std::uint8_t>(25, 0)).fill(std::vector<double>(25, 1)).empty());
    CHECK_THROWS_AS(SurfaceFill(points, {}, std::vector<std::uint8_t>(24, 1)), ShapeError);
    CHECK_THROWS_AS(SurfaceFill(points, sheet(4, 0.01, 0), std::vector<std::uint8_t>(25, 1)),
                    ShapeError);
    CHECK_THROWS_AS((void)SurfaceFill(points, {}, std::vector<std::uint8_t>(25, 1)).fill(std::vector<double>(3)),
                    ShapeError);
}
