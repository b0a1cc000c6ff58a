// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/rotation_increment.hpp>

#include "support/linear.hpp"

#include <numbers>

using namespace gsh;

TEST_CASE("the exponential's Jacobian agrees with small differences, and its inverse with it") {
    test::Rng rng(4);
    for (const double size : {0.0, 1e-9, 1e-3, 0.5, 1.0, 2.0, 3.1, std::numbers::pi}) {
        CAPTURE(size);
        const vec3<double> v = normalize(rng.vec()) * size, x = rng.vec();
        const ExponentialJacobian<double> J(v);
        const double h = 1e-6;
        const auto turn = [&](double step) {
            return axis_angle_from_rotation(transpose(rotation_from_axis_angle(v)) *
                                            rotation_from_axis_angle(v + x * step));
        };
        CHECK(length((turn(h) - turn(-h)) / (2 * h) - J.times(x)) < 1e-8);
        CHECK(length(J.inverse_times(J.times(x)) - x) < 1e-12);
        CHECK(length(J.inverse_transposed_times(J.transposed_times(x)) - x) < 1e-12);
        const vec3<double> y = rng.vec();
        CHECK(dot(y, J.times(x)) == doctest::Approx(dot(J.transposed_times(y), x)));
        CHECK(dot(y, J.inverse_times(x)) == doctest::Approx(dot(J.inverse_transposed_times(y), x)));
    }
}

TEST_CASE("turned composes rotations and keeps an untouched vector's bits") {
    test::Rng rng(6);
    for (int n = 0; n < 20; ++n) {
        const vec3<double> v = rng.vec(-3, 3), w = rng.vec();
        const vec3<double> r = turned(v, w);
        const mat3<double> expected = rotation_from_axis_angle(v) * rotation_from_axis_angle(w);
        CHECK(test::distance(rotation_from_axis_angle(r), expected) < 1e-12);
        CHECK(length(r) <= std::numbers::pi + 1e-12);
        CHECK(turned(v, vec3<double>(0.0)) == v);
    }
}

TEST_CASE("turned_backward is the gradient of turned and adds") {
    test::Rng rng(8);
    for (int n = 0; n < 6; ++n) {
        const vec3<double> v = rng.vec(), dL_dresult = rng.vec();
        vec3<double> w = rng.vec() * (n == 0 ? 0.0 : 1.0), dL_dw(0.0);
        const auto loss = [&] { return dot(turned(v, w), dL_dresult); };
        turned_backward(w, turned(v, w), dL_dresult, dL_dw);
        test::check_gradient(loss, test::scalars(w), test::scalars(dL_dw));
        const vec3<double> once = dL_dw;
        turned_backward(w, turned(v, w), dL_dresult, dL_dw);
        CHECK(dL_dw == once * 2.0);
    }
}

TEST_CASE("nearest_axis_angle keeps the rotation and stays beside the reference") {
    test::Rng rng(9);
    for (int n = 0; n < 20; ++n) {
        const vec3<double> reference = normalize(rng.vec()) * rng.uniform(0, 9);
        const vec3<double> principal = axis_angle_from_rotation(rotation_from_axis_angle(reference + rng.vec() * 0.01));
        const vec3<double> v = nearest_axis_angle(principal, reference);
        CHECK(test::distance(rotation_from_axis_angle(v), rotation_from_axis_angle(principal)) < 1e-12);
        const double angle = length(reference);
        if (std::abs(std::remainder(angle, 2 * std::numbers::pi)) > 0.3) CHECK(length(v - reference) < 1);
    }
    CHECK(nearest_axis_angle(vec3<double>(0.0), vec3<double>(1.0)) == vec3<double>(0.0));
}
