// SPDX-License-Identifier: Apache-2.0
/// @file  How many Gaussians a picture needs follows from the surface and from the camera.
#include <gsh/avatar/view_detail.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numbers>

using namespace gsh;

TEST_CASE("the surface of a tube has the area of the prism that it is") {
    RigData rig;
    rig.body = test::tube(4, 5, 100);
    rig.betas.assign(3, 0.0);
    const double radius = 0.2, sides = 100, half = std::numbers::pi / sides;
    const double expected = 2 * sides * radius * std::sin(half) * 1.6 +                    // the wall
                            2 * sides * radius * radius * std::sin(half) * std::cos(half); // both ends
    CHECK(surface_area(rig) == doctest::Approx(expected));
    for (vec3<double>& v : rig.body.v_template) v *= 3;
    CHECK(surface_area(rig) == doctest::Approx(9 * expected));
}

TEST_CASE("the size of a metre in a picture is that of its projection") {
    const Camera<double> camera = look_at<double>({1, 2, 5}, {0, 1, 0}, {0, 1, 0}, 0.5, 640, 480);
    const vec3<double> place(0.2, 0.8, 0.1), right = vec3<double>(1, 0, 0) * camera.R; // Rᵀ x
    const auto column = [&](const vec3<double>& p) {
        const vec3<double> q = to_camera(camera, p);
        return camera.fx * q.x / q.z;
    };
    CHECK(pixels_per_metre(camera, place) == doctest::Approx(column(place + right) - column(place)));
    CHECK(pixels_per_metre(camera, camera.center()) == 0);
    CHECK(pixels_per_metre(camera, {2, 3, 10}) == 0); // behind
}

TEST_CASE("a larger surface and a larger picture need more Gaussians") {
    CHECK(gaussians_for_view(2, 225) == 64500);
    CHECK(gaussians_for_view(1, 225) == 32250);
    CHECK(gaussians_for_view(2, 900) == 129000);
    CHECK(gaussians_for_view(0, 100) == 1);
    CHECK(gaussians_for_view(2, 0) == 1);
    constexpr double infinite = std::numeric_limits<double>::infinity();
    CHECK_THROWS_AS((void)gaussians_for_view(-1, 100), ValueError);
    CHECK_THROWS_AS((void)gaussians_for_view(1, -1), ValueError);
    CHECK_THROWS_AS((void)gaussians_for_view(infinite, 1), ValueError);
    CHECK_THROWS_AS((void)gaussians_for_view(1, std::nan("")), ValueError);
}
