// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/error.hpp>

#include <doctest/doctest.h>

#include <limits>
#include <vector>

using namespace gsh;

TEST_CASE("check_size names the place, the argument, both numbers and the way out") {
    CHECK_NOTHROW(check_size("here", "values", 3, 3));
    CHECK_THROWS_WITH_AS(check_size("Rasterizer::forward", "opacities", 79, 80, "store one opacity per mean"),
                         "Rasterizer::forward: opacities has 79 elements, expected 80; store one opacity per mean",
                         ShapeError);
    CHECK_THROWS_WITH_AS(check_size("f", "x", 0, 1), "f: x has 0 elements, expected 1", ShapeError);
}

TEST_CASE("check_value and check_finite throw ValueError") {
    CHECK_NOTHROW(check_value(true, "f", "fine"));
    CHECK_THROWS_WITH_AS(check_value(false, "f", "K is singular"), "f: K is singular", ValueError);

    std::vector<double> values{1, 2, 3};
    CHECK_NOTHROW(check_finite<double>("f", "values", values));
    values[1] = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_WITH_AS(check_finite<double>("f", "values", values), "f: values[1] is nan, expected a finite number",
                         ValueError);
    values[1] = 0, values[2] = -std::numeric_limits<double>::infinity();
    CHECK_THROWS_WITH_AS(check_finite<double>("f", "values", values), "f: values[2] is -inf, expected a finite number",
                         ValueError);
    CHECK_NOTHROW(check_finite<float>("f", "nothing", {}));
}

TEST_CASE("everything gsh throws is an Error") {
    CHECK_THROWS_AS(throw IoError("x"), Error);
    CHECK_THROWS_AS(throw DeviceError("x"), Error);
    CHECK_THROWS_AS(throw ShapeError("x"), std::runtime_error);
}
