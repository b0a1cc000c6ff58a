// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/dual_quat.hpp>

#include "support/linear.hpp"

#include <gsh/math/polar.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace gsh;

namespace {

double inner(const dual_quat<double>& a, const dual_quat<double>& b) {
    return dot(a.real, b.real) + dot(a.dual, b.dual);
}

dual_quat<double> random_dual_quat(test::Rng& rng) {
    const auto real = rng.quat(), dual = rng.quat();
    return {real, dual};
}

constexpr double pi = std::numbers::pi;
constexpr double screw_angles[] = {0, 1e-9, 1e-4, 0.3, 1.5, pi / 2, 2, 3, pi - 1e-3, pi + 1e-3, 4, 2 * pi, 7};

} // namespace

TEST_CASE("a rigid map survives the way to a dual quaternion of any length or sign and back") {
    test::Rng rng(1);
    for (const double angle : screw_angles) {
        const Affine<double> rigid{rotation_from_axis_angle(normalize(rng.vec()) * angle), rng.vec(-3, 3)};
        const auto unit = dual_quat_from_rigid(rigid);
        CHECK(dot(unit.real, unit.real) == doctest::Approx(1).epsilon(1e-14));
        CHECK(std::abs(dot(unit.real, unit.dual)) < 1e-15);
        for (const double scale : {1.0, -1.0, 0.01, 30.0}) {
            auto scaled = dual_quat<double>::zero();
            scaled.add_scaled(unit, scale);
            CHECK(test::distance(rigid_from_dual_quat(scaled), rigid) < 1e-14);
        }
    }
}

TEST_CASE("the even blend of two motions is the screw halfway; a part of the dual along the real changes nothing") {
    test::Rng rng(2);
    for (int n = 0; n < 20; ++n) {
        const auto axis = normalize(rng.vec()), point = rng.vec();
        const double angle = rng.uniform(-3, 3), slide = rng.uniform(-1, 1);
        const auto screw = [&](double share) {
            const mat3<double> R = rotation_from_axis_angle(axis * (angle * share));
            return Affine<double>{R, point - R * point + axis * (slide * share)};
        };
        auto blended = dual_quat<double>::zero();
        blended.add_scaled(dual_quat_from_rigid(screw(0)), 0.5);
        blended.add_scaled(dual_quat_from_rigid(screw(1)), 0.5);
        CHECK(test::distance(rigid_from_dual_quat(blended), screw(0.5)) < 1e-13);
        const auto& r = blended.real;
        blended.dual += quat<double>{0.3 * r.w, 0.3 * r.x, 0.3 * r.y, 0.3 * r.z};
        CHECK(test::distance(rigid_from_dual_quat(blended), screw(0.5)) < 1e-13);
    }
}

TEST_CASE("rigid_from_dual_quat_backward is the gradient with respect to all eight numbers") {
    test::Rng rng(3);
    for (int n = 0; n < 20; ++n) {
        auto b = random_dual_quat(rng), dL_db = dual_quat<double>::zero();
        const auto dL_dmap = test::random_affine(rng);
        const auto loss = [&] { return test::inner(rigid_from_dual_quat(b), dL_dmap); };
        rigid_from_dual_quat_backward(b, dL_dmap, dL_db);
        test::check_gradient(loss, test::scalars(b), test::scalars(dL_db), {.tolerance = 1e-5});
        // The result does not depend on the length.
        CHECK(std::abs(inner(dL_db, b)) < 1e-12 * (1 + inner(dL_db, dL_db)));
        const auto once = dL_db;
        rigid_from_dual_quat_backward(b, dL_dmap, dL_db);
        for (std::size_t k = 0; k < 8; ++k) {
            auto copy = once;
            CHECK(test::scalars(dL_db)[k] == doctest::Approx(2 * test::scalars(copy)[k]));
        }
    }
}

TEST_CASE_TEMPLATE("nothing to normalise gives the identity and no gradient", T, float, double) {
    auto dL_db = dual_quat<T>::zero();
    for (const T dual : {T(0), T(1)}) {
        const dual_quat<T> b{{0, 0, 0, 0}, {dual, dual, dual, dual}};
        const auto map = rigid_from_dual_quat(b);
        CHECK(map.linear == mat3<T>(T(1)));
        CHECK(map.translation == vec3<T>(T(0)));
        rigid_from_dual_quat_backward(b, {mat3<T>(T(2)), vec3<T>(T(1))}, dL_db);
        CHECK(dot(dL_db.real, dL_db.real) + dot(dL_db.dual, dL_db.dual) == T(0));
    }
}

TEST_CASE("dual_quat_from_rigid_backward carries the right gradient to an axis-angle vector and a translation") {
    test::Rng rng(4);
    for (const double angle : screw_angles) {
        if (std::abs(angle - pi) < 1e-2) continue; // there q changes to -q, see the next case
        INFO("angle " << angle);
        vec3<double> v = normalize(rng.vec()) * angle, t = rng.vec(), dL_dv(0);
        const auto weight = random_dual_quat(rng);
        const auto rigid = [&] { return Affine<double>{rotation_from_axis_angle(v), t}; };
        const auto loss = [&] { return inner(dual_quat_from_rigid(rigid()), weight); };
        Affine<double> dL_drigid = Affine<double>::zero();
        dual_quat_from_rigid_backward(rigid(), dual_quat_from_rigid(rigid()), weight, dL_drigid);
        rotation_from_axis_angle_backward(v, dL_drigid.linear, dL_dv);
        test::check_gradient(loss, test::scalars(v), test::scalars(dL_dv));
        test::check_gradient(loss, test::scalars(t), test::scalars(dL_drigid.translation));
    }
}

TEST_CASE("at half a turn, where the sign is a matter of taste, the motion's gradient goes through") {
    test::Rng rng(5);
    for (const double angle : screw_angles) {
        INFO("angle " << angle);
        vec3<double> v = normalize(rng.vec()) * angle, t = rng.vec(), dL_dv(0);
        const auto weight = test::random_affine(rng);
        const auto rigid = [&] { return Affine<double>{rotation_from_axis_angle(v), t}; };
        const auto loss = [&] { return test::inner(rigid_from_dual_quat(dual_quat_from_rigid(rigid())), weight); };
        const auto value = dual_quat_from_rigid(rigid());
        auto dL_dvalue = dual_quat<double>::zero();
        Affine<double> dL_drigid = Affine<double>::zero();
        rigid_from_dual_quat_backward(value, weight, dL_dvalue);
        dual_quat_from_rigid_backward(rigid(), value, dL_dvalue, dL_drigid);
        rotation_from_axis_angle_backward(v, dL_drigid.linear, dL_dv);
        test::check_gradient(loss, test::scalars(v), test::scalars(dL_dv));
        test::check_gradient(loss, test::scalars(t), test::scalars(dL_drigid.translation));
    }
}

TEST_CASE("off the rotations its nine numbers are the gradient at the nearest rotation") {
    test::Rng rng(6);
    for (int n = 0; n < 20; ++n) {
        Affine<double> rigid{rotation_from_axis_angle(rng.vec(-1.2, 1.2)), rng.vec()};
        Affine<double> dL_drigid = Affine<double>::zero();
        const auto weight = random_dual_quat(rng);
        const auto loss = [&] {
            return inner(dual_quat_from_rigid(Affine<double>{polar_rotation(rigid.linear), rigid.translation}), weight);
        };
        dual_quat_from_rigid_backward(rigid, dual_quat_from_rigid(rigid), weight, dL_drigid);
        test::check_gradient(loss, test::scalars(rigid), test::scalars(dL_drigid));
        const Affine<double> once = dL_drigid;
        dual_quat_from_rigid_backward(rigid, dual_quat_from_rigid(rigid), weight, dL_drigid);
        for (int c = 0; c < 3; ++c) CHECK(length(dL_drigid.linear[c] - once.linear[c] * 2.0) < 1e-14);
        CHECK(length(dL_drigid.translation - once.translation * 2.0) < 1e-14);
    }
}
