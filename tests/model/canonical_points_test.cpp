// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/model/canonical_points.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

using namespace gsh;

namespace {

using PointsOnHost = CanonicalPoints<cpu::Serial, double>;

/// Least and largest number of an axis.
std::pair<double, double> range_of_axis(Span<const vec3<double>> points, int axis) {
    double low = 1e9, high = -1e9;
    for (const auto& p : points) low = std::min(low, p[axis]), high = std::max(high, p[axis]);
    return {low, high};
}

/// Points that fill a box of 1 m, 2 m and 4 m, its corners among them.
std::vector<vec3<double>> box_of_points() {
    test::Rng rng(3);
    std::vector<vec3<double>> points{{3, -1, 2}, {4, 1, 6}};
    for (int i = 0; i < 50; ++i) points.push_back({rng.uniform(3, 4), rng.uniform(-1, 1), rng.uniform(2, 6)});
    return points;
}

} // namespace

TEST_CASE("points lie in the unit cube, in the middle of it, as far from each other in every direction") {
    cpu::Serial backend;
    const auto positions = box_of_points();
    const PointsOnHost points(backend, positions, {}, {.bounds = FieldBounds::cube, .bounds_margin = 1.25});
    REQUIRE(points.size() == positions.size());
    for (std::size_t i = 0; i < positions.size(); ++i) CHECK(points.positions()[i] == positions[i]);
    const double edge = 4 * 1.25;
    for (int axis = 0; axis < 3; ++axis) {
        const auto [low, high] = range_of_axis(points.unit(), axis);
        CHECK(low + high == doctest::Approx(1));
        CHECK(high - low == doctest::Approx(std::vector<double>{1, 2, 4}[static_cast<std::size_t>(axis)] / edge));
    }
}

TEST_CASE("a box is stretched to the unit cube along each axis") {
    cpu::Serial backend;
    const PointsOnHost points(backend, box_of_points(), {}, {.bounds = FieldBounds::box, .bounds_margin = 1.25});
    for (int axis = 0; axis < 3; ++axis) {
        const auto [low, high] = range_of_axis(points.unit(), axis);
        CHECK(low == doctest::Approx(0.1));
        CHECK(high == doctest::Approx(0.9));
    }
}

TEST_CASE("a part of the points has the unit cube of the whole") {
    cpu::Serial backend;
    const auto positions = box_of_points();
    const CanonicalPriors priors{.region = std::vector<double>(positions.size(), 0.5),
                                 .features = std::vector<double>(3 * positions.size(), 2)};
    const std::vector<vec3<double>> some = thinned_rows(positions, 1, 4);
    const PointsOnHost all(backend, positions, priors), part(backend, some, thinned(priors, positions, 4));
    REQUIRE(part.size() == thinned_count(positions.size(), 4));
    CHECK(part.feature_count() == 3);
    CHECK(part.region().size() == part.size());
    for (std::size_t i = 0; i < part.size(); ++i) CHECK(part.unit()[i] == all.unit()[4 * i]);
    const PointsOnHost alone(backend, some);
    CHECK(alone.unit()[1] != all.unit()[4]);
    const CanonicalPriors twice = thinned(thinned(priors, positions, 2), thinned_rows(positions, 1, 2), 2);
    CHECK(twice.whole->high == box_of_points(positions).high);
    CHECK_THROWS_WITH_AS((void)box_of_points(Span<const vec3<double>>()), doctest::Contains("there are no points"),
                         ValueError);
}

TEST_CASE("points in a plane, on a line or at one place have a unit cube, too") {
    cpu::Serial backend;
    for (const auto& positions :
         {std::vector<vec3<double>>{{0, 0, 1}, {1, 0, 1}, {0, 2, 1}}, std::vector<vec3<double>>{{0, 0, 1}, {0, 0, 2}},
          std::vector<vec3<double>>{{5, 5, 5}}})
        for (const FieldBounds bounds : {FieldBounds::cube, FieldBounds::box}) {
            const PointsOnHost points(backend, positions, {}, {.bounds = bounds});
            for (const auto& p : points.unit())
                for (int axis = 0; axis < 3; ++axis) CHECK((p[axis] >= 0 && p[axis] <= 1));
        }
}

TEST_CASE("priors are kept, features scaled") {
    cpu::Serial backend;
    const std::vector<vec3<double>> positions{{0, 0, 0}, {1, 1, 1}};
    const PointsOnHost with(backend, positions, {{0.25, 1}, {1, 2, 3, 4, 5, 6}}, {.prior_scale = 0.5});
    CHECK(with.feature_count() == 3);
    CHECK(with.region()[0] == 0.25);
    CHECK(with.features().size() == 6);
    for (std::size_t i = 0; i < 6; ++i) CHECK(with.features()[i] == 0.5 * static_cast<double>(i + 1));
    const PointsOnHost without(backend, positions);
    CHECK(without.feature_count() == 0);
    CHECK(without.region().empty());
    CHECK(without.features().empty());
}

TEST_CASE("points and priors that do not fit are refused") {
    cpu::Serial backend;
    const std::vector<vec3<double>> two{{0, 0, 0}, {1, 1, 1}};
    CHECK_THROWS_AS(PointsOnHost(backend, {}), ValueError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {{0.5}, {}}), ShapeError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {{}, {1, 2, 3}}), ValueError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {}, {.bounds_margin = 0.9}), ValueError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {}, {.bounds_margin = std::numeric_limits<double>::infinity()}),
                    ValueError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {}, {.prior_scale = 0}), ValueError);
    CHECK_THROWS_AS(PointsOnHost(backend, two, {}, {.prior_scale = NAN}), ValueError);
}
