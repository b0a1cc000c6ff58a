// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/rotation.hpp>

#include "support/linear.hpp"

#include <limits>
#include <numbers>

using namespace gsh;

namespace {

/// Angles at which a division by the angle would be wrong, and both sides of the change of formula at 1.
constexpr double delicate_angles[] = {0,   1e-300, 1e-9, 1e-4, 0.3, 1 - 1e-9, 1 + 1e-9, 2,
                             std::numbers::pi - 1e-6, std::numbers::pi, std::numbers::pi + 0.1, 7};

} // namespace

TEST_CASE("rotation_from_axis_angle agrees with the half-angle quaternion") {
    test::Rng rng(1);
    const vec3<double> axis = normalize(rng.vec());
    for (const double angle : delicate_angles) {
        INFO("angle " << angle);
        const double s = std::sin(angle / 2);
        const mat3<double> expected =
            rotation_matrix(quat<double>{std::cos(angle / 2), axis.x * s, axis.y * s, axis.z * s});
        const mat3<double> R = rotation_from_axis_angle(axis * angle);
        CHECK(test::distance(R, expected) < 4e-16 * std::max(1.0, angle));
        CHECK(test::distance(transpose(R) * R, mat3<double>(1.0)) < 2e-15);
        CHECK(determinant(R) == doctest::Approx(1).epsilon(1e-14));
    }
}

TEST_CASE("the skew part keeps its relative accuracy at tiny angles") {
    for (const double angle : {1e-300, 1e-30, 1e-9, 1e-4}) {
        const mat3<double> R = rotation_from_axis_angle(vec3<double>(0, 0, angle));
        CHECK(R[0].y == doctest::Approx(std::sin(angle)).epsilon(1e-15));
        CHECK(R[1].x == doctest::Approx(-std::sin(angle)).epsilon(1e-15));
    }
}

TEST_CASE("rotation_from_axis_angle_backward is the gradient at every angle") {
    test::Rng rng(2);
    for (const double angle : delicate_angles) {
        INFO("angle " << angle);
        vec3<double> v = normalize(rng.vec()) * angle, dL_dv(0.0);
        const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
        const auto loss = [&] { return test::inner(rotation_from_axis_angle(v), weight); };
        rotation_from_axis_angle_backward(v, weight, dL_dv);
        test::check_gradient(loss, test::scalars(v), test::scalars(dL_dv), {.tolerance = 1e-9});

        const vec3<double> once = dL_dv;
        rotation_from_axis_angle_backward(v, weight, dL_dv);
        CHECK(length(dL_dv - once * 2.0) < 1e-12);
    }
}

TEST_CASE("at rest the adjoint is exactly the skew part") {
    const mat3<double> g(vec3<double>(1, 2, 3), vec3<double>(5, 7, 11), vec3<double>(13, 17, 19));
    vec3<double> dL_dv(0.0);
    rotation_from_axis_angle_backward(vec3<double>(0.0), g, dL_dv);
    CHECK(dL_dv == vec3<double>(11 - 17, 13 - 3, 2 - 5)); // (g21 - g12, g02 - g20, g10 - g01)
}

TEST_CASE("the adjoint in float stays close to double, tiny angles included") {
    test::Rng rng(3);
    for (const double angle : delicate_angles) {
        const vec3<double> v = normalize(rng.vec()) * angle;
        const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
        vec3<double> dL_dv(0.0);
        vec3<float> dL_dv_float(0.0f);
        rotation_from_axis_angle_backward(v, weight, dL_dv);
        rotation_from_axis_angle_backward(vec3<float>(v), mat3<float>(weight), dL_dv_float);
        CHECK(length(vec3<double>(dL_dv_float) - dL_dv) < 2e-5);
    }
}

TEST_CASE("Euler angles multiply in the order of their name") {
    using detail::axis_rotation;
    const vec3<double> a(0.3, -0.7, 1.1);
    const auto product = [&](int i, int j, int k) {
        return axis_rotation(i, a.x) * axis_rotation(j, a.y) * axis_rotation(k, a.z);
    };
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::xyz), product(0, 1, 2)) == 0);
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::xzy), product(0, 2, 1)) == 0);
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::yxz), product(1, 0, 2)) == 0);
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::yzx), product(1, 2, 0)) == 0);
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::zxy), product(2, 0, 1)) == 0);
    CHECK(test::distance(rotation_from_euler(a, EulerOrder::zyx), product(2, 1, 0)) == 0);
    for (int axis = 0; axis < 3; ++axis) {
        vec3<double> v(0.0);
        v[axis] = 0.9;
        CHECK(test::distance(axis_rotation(axis, 0.9), rotation_from_axis_angle(v)) < 1e-15);
    }
}

TEST_CASE("rotation_from_euler_backward is the gradient in every order") {
    test::Rng rng(4);
    for (const auto order : {EulerOrder::xyz, EulerOrder::xzy, EulerOrder::yxz, EulerOrder::yzx, EulerOrder::zxy,
                             EulerOrder::zyx}) {
        INFO("order " << static_cast<int>(order));
        vec3<double> a = rng.vec(-3, 3), dL_da(0.0);
        const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
        rotation_from_euler_backward(a, order, weight, dL_da);
        test::check_gradient([&] { return test::inner(rotation_from_euler(a, order), weight); }, test::scalars(a),
                             test::scalars(dL_da));
        const vec3<double> once = dL_da;
        rotation_from_euler_backward(a, order, weight, dL_da);
        CHECK(length(dL_da - once * 2.0) < 1e-12);
    }
}

TEST_CASE("rotation_from_quat ignores the length and has a gradient") {
    test::Rng rng(5);
    quat<double> q = rng.quat(), dL_dq{0, 0, 0, 0};
    const quat<double> longer{3 * q.w, 3 * q.x, 3 * q.y, 3 * q.z};
    CHECK(test::distance(rotation_from_quat(q), rotation_from_quat(longer)) < 1e-15);
    const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
    rotation_from_quat_backward(q, weight, dL_dq);
    const auto loss = [&] { return test::inner(rotation_from_quat(q), weight); };
    test::check_gradient(loss, test::scalars(q), test::scalars(dL_dq));
    CHECK(std::abs(dot(q, dL_dq)) < 1e-12); // no component along q
}

TEST_CASE("axis_angle_from_rotation undoes rotation_from_axis_angle up to pi") {
    test::Rng rng(6);
    for (const double angle : {0.0, 1e-12, 1e-9, 1e-7, 1e-4, 0.5, 1.5, 2.5, 3.1, std::numbers::pi - 1e-7}) {
        for (int trial = 0; trial < 8; ++trial) {
            const vec3<double> v = normalize(rng.vec()) * angle;
            INFO("angle " << angle << ", trial " << trial);
            CHECK(length(axis_angle_from_rotation(rotation_from_axis_angle(v)) - v) <=
                  1e-15 + 4e-9 * (angle > 3.14) + 1e-14 * angle);
        }
    }
    // At pi both signs are correct.
    const vec3<double> v = normalize(vec3<double>(-1, 2, -0.5)) * std::numbers::pi;
    const mat3<double> R = rotation_from_axis_angle(v);
    CHECK(test::distance(rotation_from_axis_angle(axis_angle_from_rotation(R)), R) < 1e-14);
    for (int axis = 0; axis < 3; ++axis) {
        mat3<double> half_turn(-1.0);
        half_turn[axis][axis] = 1;
        const vec3<double> back = axis_angle_from_rotation(half_turn);
        CHECK(std::abs(back[axis]) == doctest::Approx(std::numbers::pi));
    }
}

TEST_CASE("quat_from_rotation undoes rotation_matrix in all four branches") {
    for (const quat<double> q : {quat<double>{0.9, 0.1, 0.2, 0.3}, quat<double>{0.1, 0.9, 0.2, 0.3},
                                 quat<double>{0.1, 0.2, 0.9, 0.3}, quat<double>{0.1, 0.2, 0.3, 0.9},
                                 quat<double>{-0.1, 0.2, 0.3, 0.9}, quat<double>{0, 0, 1, 0}}) {
        const quat<double> n = normalize(q), back = quat_from_rotation(rotation_matrix(n));
        CHECK(std::abs(dot(n, back)) == doctest::Approx(1).epsilon(1e-15));
        CHECK(back.w >= 0);
    }
}

TEST_CASE("a matrix is a rotation if it is orthonormal and right-handed") {
    const mat3<double> turn = rotation_from_axis_angle(vec3<double>(0.4, -1.1, 0.7));
    CHECK(is_rotation(turn, 1e-12));
    CHECK(!is_rotation(turn * 1.001, 1e-3));
    CHECK(is_rotation(turn * 1.0001, 1e-3));
    CHECK(!is_rotation(turn * mat3<double>(vec3<double>(-1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1)), 0.1));
    CHECK(!is_rotation(turn * std::numeric_limits<double>::quiet_NaN(), 0.1));
}

TEST_CASE("axis_angle_jacobian is the turn per change of the axis-angle vector") {
    test::Rng rng(9);
    for (const double angle : {0.0, 1e-7, 0.3, 1.2, 2.9}) {
        const vec3<double> v = normalize(rng.vec()) * angle;
        const mat3<double> J = axis_angle_jacobian(v), R = rotation_from_axis_angle(v);
        for (int k = 0; k < 3; ++k) {
            constexpr double h = 1e-5;
            vec3<double> more = v, less = v;
            more[k] += h, less[k] -= h;
            const vec3<double> turn = axis_angle_from_rotation(rotation_from_axis_angle(more) * transpose(R)) -
                                      axis_angle_from_rotation(rotation_from_axis_angle(less) * transpose(R));
            CAPTURE(angle);
            CHECK(length(turn / (2 * h) - J[k]) < 1e-9);
        }
    }
}
