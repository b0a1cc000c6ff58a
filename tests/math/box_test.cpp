// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/box.hpp>

#include <doctest/doctest.h>

#include <vector>

using namespace gsh;

TEST_CASE("the box of points touches the outermost along each axis") {
    const std::vector<vec3<double>> points{{3, -1, 2}, {4, 1, 2.5}, {3.5, 0, 6}};
    const Box box = box_of_points(points);
    CHECK(box.low == vec3<double>(3, -1, 2));
    CHECK(box.high == vec3<double>(4, 1, 6));
    const Box one = box_of_points(Span<const vec3<double>>(points).subspan(1, 1));
    CHECK(one.low == points[1]);
    CHECK(one.high == points[1]);
    CHECK_THROWS_WITH_AS((void)box_of_points(Span<const vec3<double>>()), doctest::Contains("there are no points"),
                         ValueError);
}
