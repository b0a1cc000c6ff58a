// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/synthetic/signed_distance.hpp>

using namespace gsh;
using detail::Point;

TEST_CASE("a ball's distance is exact, an ellipsoid's vanishes on its surface") {
    CHECK(detail::ellipsoid({0, 3, 0}, {2, 2, 2}) == doctest::Approx(1));
    CHECK(detail::ellipsoid({0, 0, 0}, {2, 3, 4}) == -2);
    for (const Point& p : {Point(2, 0, 0), Point(0, -3, 0), Point(0, 0, 4)})
        CHECK(detail::ellipsoid(p, {2, 3, 4}) == doctest::Approx(0));
    CHECK(detail::ellipsoid({0, 0, 4.01}, {2, 3, 4}) == doctest::Approx(0.01).epsilon(0.01));
}

TEST_CASE("a capsule's radius goes from one end to the other") {
    const auto d = [](const Point& p) { return detail::capsule(p, {0, 0, 0}, {2, 0, 0}, 0.5, 0.3); };
    CHECK(d({0, 0.5, 0}) == doctest::Approx(0));
    CHECK(d({1, 0, 0.4}) == doctest::Approx(0));
    CHECK(d({2.3, 0, 0}) == doctest::Approx(0));
    CHECK(d({-1, 0, 0}) == doctest::Approx(0.5));
}

TEST_CASE("a loft passes through its stations, and its caps close it") {
    const detail::Station stations[] = {{0, 0, 0, 1, 1}, {1, 0.2, 0, 0.6, 0.8}, {3, 0, 0.1, 0.5, 0.5}};
    for (const auto& s : stations) {
        CHECK(detail::loft(stations, 0.2, s.s, s.u + s.a, s.v) == doctest::Approx(0));
        CHECK(detail::loft(stations, 0.2, s.s, s.u, s.v - s.b) == doctest::Approx(0));
    }
    CHECK(detail::loft(stations, 0.2, -0.2, 0, 0) == doctest::Approx(0));
    CHECK(detail::loft(stations, 0.2, 3.2, 0, 0.1) == doctest::Approx(0));
    CHECK(detail::loft(stations, 0.2, 1.9, 0.1, 0) < 0);
}

TEST_CASE("smooth operations are the sharp ones away from the seam") {
    CHECK(detail::smooth_union(1, 2, 0.5) == 1);
    CHECK(detail::smooth_union(2, 1, 0.5) == 1);
    CHECK(detail::smooth_union(1, 1, 0.4) == doctest::Approx(0.9));
    CHECK(detail::smooth_difference(-1, 2, 0.5) == -1);
    CHECK(detail::smooth_difference(-1, -0.2, 0.5) == doctest::Approx(0.2));
    CHECK(detail::smooth_step(2, 1, 1.0) == 1);
    CHECK(detail::smooth_step(2, 1, 3.0) == 0);
}
