// SPDX-License-Identifier: Apache-2.0
/// Rotations in all forms, spherical harmonics under rotations, rigid and affine maps of clouds: what group theory says.
#include "properties/properties.hpp"
#include "support/gradient.hpp"

#include <gsh/gaussian/axis_turn.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/sh_rotation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <vector>

using namespace gsh;
using namespace gsh::test;

namespace {

constexpr double turn_pi = std::numbers::pi;

double distance(const mat3<double>& a, const mat3<double>& b) {
    double largest = 0;
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(a[c][r] - b[c][r]));
    return largest;
}
double size_of_matrix(const mat3<double>& a) {
    return distance(a, mat3<double>(0.0));
}

void require_near(const mat3<double>& found, const mat3<double>& expected, double tolerance, const char* what) {
    require(distance(found, expected) <= tolerance, // false for NaN
            [&] { return std::string(what) + ": differs by " + digits(distance(found, expected)); });
}
void require_near(const vec3<double>& found, const vec3<double>& expected, double tolerance, const char* what) {
    require(length(found - expected) <= tolerance,
            [&] { return std::string(what) + ": differs by " + digits(length(found - expected)); });
}

/// An axis-angle vector: none, tiny, about half a turn, a whole turn or any.
vec3<double> any_turn() {
    const vec3<double> v = around(vec3<double>(0), 4);
    if (!rarely(3) || length(v) == 0) return v;
    return v *
           (one_of({1e-3, 1e-9, 1e-200, turn_pi, turn_pi * (1 - 1e-9), turn_pi * (1 + 1e-9), 2 * turn_pi}) / length(v));
}

/// A matrix with columns of very different lengths, sometimes singular.
mat3<double> any_matrix() {
    mat3<double> M;
    for (int c = 0; c < 3; ++c) M[c] = around(vec3<double>(0), 2) * one_of({1.0, 1e-3, 1e3, 1e-9});
    M[0].x += 1;
    if (rarely(6)) M[2] = M[1];
    if (rarely(6)) M = any_rotation() * (rarely(2) ? -1.0 : 1.0);
    return M;
}

template <std::size_t Count>
std::vector<vec3<double>> any_sh() {
    return gsh::test::Rng(below(1000)).vecs(Count);
}

GaussianCloud<double> any_cloud(int degree) {
    GaussianCloud<double> cloud(1 + up_to(4), degree);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        cloud.means[i] = around(vec3<double>(0), 3);
        cloud.quats[i] = any_quat();
        cloud.log_scales[i] = around(vec3<double>(-3), 4); // none is near a micrometre, the least length of move_shape
        cloud.opacity_logits[i] = around(0, 5);
    }
    cloud.sh = gsh::test::Rng(below(1000)).vecs(cloud.sh.size());
    return cloud;
}

mat3<double> covariance_matrix(const GaussianCloud<double>& cloud, std::size_t i) {
    return full_matrix(covariance(cloud.quats[i], cloud.log_scales[i]));
}

template <int Degree>
vec3<double> seen(const GaussianCloud<double>& cloud, std::size_t i, const vec3<double>& direction) {
    return SHEval<Degree>::forward(&cloud.sh[i * (Degree + 1) * (Degree + 1)], direction);
}

template <int Degree>
void check_harmonics() {
    constexpr std::size_t count = (Degree + 1) * (Degree + 1);
    const auto sh = any_sh<count>();
    const mat3<double> R = any_rotation(), Q = any_rotation();
    const vec3<double> d = any_rotation()[2];
    std::vector<vec3<double>> turned(count), twice(count), both(count), back(count);
    using Turn = ShRotation<Degree>;
    Turn::forward(sh.data(), R, turned.data());
    using SH = SHEval<Degree>;
    require_near(SH::forward(turned.data(), R * d), SH::forward(sh.data(), d), 1e-12,
                 "seen along the turned direction");
    Turn::forward(turned.data(), Q, twice.data()), Turn::forward(sh.data(), Q * R, both.data());
    Turn::forward(turned.data(), transpose(R), back.data());
    for (std::size_t k = 0; k < count; ++k) {
        require_near(twice[k], both[k], 1e-12, "one turn after another");
        require_near(back[k], sh[k], 1e-12, "there and back");
    }
    std::vector<vec3<double>> mirrored = sh;
    for (std::size_t l = 0; l <= Degree; ++l) {
        double before = 0, after = 0;
        for (std::size_t k = l * l; k < (l + 1) * (l + 1); ++k) {
            before += dot(sh[k], sh[k]), after += dot(turned[k], turned[k]);
            if (l % 2) mirrored[k] = -mirrored[k];
        }
        require(std::abs(before - after) <= 1e-12 * (1 + before), [] { return "a turn changes the norm of a degree"; });
    }
    require_near(SH::forward(mirrored.data(), d), SH::forward(sh.data(), -d), 1e-13, "parity");
}

} // namespace

TEST_CASE("a quaternion, its negative and its multiples are the same rotation") {
    check_property([] {
        const quat<double> q = any_quat(), minus{-q.w, -q.x, -q.y, -q.z}, more{4 * q.w, 4 * q.x, 4 * q.y, 4 * q.z};
        const mat3<double> R = rotation_from_quat(q);
        require(rotation_from_quat(minus) == R && rotation_from_quat(more) == R, [] { return "the matrices differ"; });
        require_near(transpose(R) * R, mat3<double>(1.0), 1e-14, "orthogonal");
        require(std::abs(determinant(R) - 1) < 1e-14, [] { return "the determinant is not 1"; });
        const vec3<double> log_scale = around(vec3<double>(-3), 10);
        require(full_matrix(covariance(q, log_scale)) == full_matrix(covariance(minus, log_scale)),
                [] { return "the covariances differ"; });
        const quat<double> unit = normalize(q), found = quat_from_rotation(R);
        require(std::abs(std::abs(dot(unit, found)) - 1) < 1e-14 && found.w >= 0,
                [] { return "quat_from_rotation gives another rotation"; });
        const quat<double> p = normalize(any_quat());
        require_near(rotation_matrix(product(unit, p)), R * rotation_matrix(p), 1e-14, "the product");
    });
}

TEST_CASE("the shortest turn from z to a direction leads there, and its axis is perpendicular to z") {
    check_property([] {
        vec3<double> n = any_rotation()[2];
        if (rarely(2))
            n = normalize(vec3<double>(one_of({0.0, 1e-9, 1e-20}), one_of({0.0, -1e-8}), one_of({1.0, -1.0})));
        const quat<double> q = quat_from_z_axis(n);
        require_near(rotation_matrix(q)[2], n, 1e-14, "the turned z axis");
        require(q.z == 0 && q.w >= 0, [] { return "another turn would be shorter"; });
    });
}

TEST_CASE("an axis-angle vector, its rotation and the vector of that agree") {
    check_property([] {
        const vec3<double> v = any_turn(), w = any_turn();
        const mat3<double> R = rotation_from_axis_angle(v), Q = rotation_from_axis_angle(w);
        require_near(transpose(R) * R, mat3<double>(1.0), 1e-14, "orthogonal");
        require_near(R * v, v, 1e-14 * (1 + length(v)), "the axis");
        require(std::abs(R[0].x + R[1].y + R[2].z - 1 - 2 * std::cos(length(v))) < 1e-14,
                [] { return "the trace is not that of the angle"; });
        const vec3<double> log = axis_angle_from_rotation(R);
        require(length(log) <= turn_pi * (1 + 1e-15), [] { return "a longer vector than pi"; });
        require_near(rotation_from_axis_angle(log), R, 1e-14, "there and back");
        require_near(rotation_from_axis_angle(turned(v, w)), R * Q, 4e-14, "one turn after another");
        const vec3<double> near = nearest_axis_angle(v, w);
        if (std::abs(length(v)) > 1e-8) require_near(rotation_from_axis_angle(near), R, 1e-13, "plus whole turns");
        require(length(near - w) <= length(v - w) * (1 + 1e-12) + 1e-14, [] { return "not the nearest"; });
    });
}

TEST_CASE("Euler angles of any order are three turns, and the product of the single ones") {
    check_property([] {
        const vec3<double> angles = around(vec3<double>(0), 7);
        const int order = int(below(6));
        const int axes[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
        mat3<double> expected(1.0);
        for (int k = 0; k < 3; ++k) {
            vec3<double> v(0);
            v[axes[order][k]] = angles[k];
            expected = expected * rotation_from_axis_angle(v);
        }
        require_near(rotation_from_euler(angles, EulerOrder(order)), expected, 1e-14, "the product");
    });
}

TEST_CASE("no rotation is nearer to a matrix than its polar rotation, which turns and scales with it") {
    check_property([] {
        const mat3<double> M = any_matrix(), R = polar_rotation(M), Q = any_rotation();
        const vec3<double> s = principal_axes(M).lengths;
        const double largest = std::max({s.x, s.y, s.z}), smallest = std::min({s.x, s.y, s.z});
        const double others = s.x + s.y + s.z - largest - (determinant(M) < 0 ? 2 * smallest : 0);
        // Nearly of rank one, a matrix has many rotations about as near, and polar_rotation gives one of them.
        const double tolerance = others > 0.05 * largest ? 1e-12 * largest : 0.02 * largest + 1e-15;
        require(is_rotation(R, 1e-13), [] { return "not a rotation"; });
        const auto fit = [](const mat3<double>& a, const mat3<double>& b) {
            return dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2]);
        };
        const mat3<double> beside = rotation_from_axis_angle(around(vec3<double>(0), 0.02)) * R;
        for (const mat3<double>& other : {Q, beside})
            require(fit(R, M) >= fit(other, M) - tolerance,
                    [&] { return "another one is nearer by " + digits(fit(other, M) - fit(R, M)); });
        // tr(Rᵀ M) is largest for the nearest rotation: the singular values, the smallest of them with det M's sign.
        require(std::abs(fit(R, M) - largest - others) <= tolerance,
                [&] { return digits(fit(R, M)) + ", expected " + digits(largest + others); });
        require(std::abs(fit(polar_rotation(Q * M * 8.0), Q * M) - fit(R, M)) <= tolerance,
                [] { return "a turned and scaled matrix has another distance"; });
    });
}

TEST_CASE("principal axes are those of M Mᵀ") {
    check_property([] {
        const mat3<double> M = any_matrix();
        const PrincipalAxes<double> axes = principal_axes(M);
        const double size = size_of_matrix(M);
        require(is_rotation(axes.R, 1e-13), [] { return "not a rotation"; });
        mat3<double> scaled = axes.R;
        double volume = 1;
        for (int k = 0; k < 3; ++k) {
            require(axes.lengths[k] >= 0, [] { return "a negative length"; });
            scaled[k] *= axes.lengths[k], volume *= axes.lengths[k];
        }
        require_near(scaled * transpose(scaled), M * transpose(M), 1e-13 * size * size, "the product");
        require(std::abs(volume - std::abs(determinant(M))) <= 1e-13 * length(M[0]) * length(M[1]) * length(M[2]),
                [&] { return "the volume is " + digits(volume) + ", expected " + digits(determinant(M)); });
    });
}

TEST_CASE("spherical harmonics turn as functions do") {
    check_property([] {
        check_harmonics<0>(), check_harmonics<1>(), check_harmonics<2>(), check_harmonics<3>(), check_harmonics<4>();
    });
}

TEST_CASE("a dual quaternion is its rigid map, whatever its sign and length") {
    check_property([] {
        const Affine<double> A(any_rotation(), around(vec3<double>(0), one_of({1.0, 1e3, 1e-6})));
        const dual_quat<double> b = dual_quat_from_rigid(A);
        const double reach = 1 + length(A.translation);
        for (const double factor : {1.0, -1.0, 3.7, -1e-3}) {
            dual_quat<double> scaled = dual_quat<double>::zero();
            scaled.add_scaled(b, factor);
            const Affine<double> back = rigid_from_dual_quat(scaled);
            require_near(back.linear, A.linear, 1e-13, "the rotation");
            require_near(back.translation, A.translation, 1e-13 * reach, "the translation");
        }
    });
}

TEST_CASE("a moved cloud has the moved means and covariances, and shows the same from turned directions") {
    check_property([] {
        const GaussianCloud<double> cloud = any_cloud(2);
        GaussianCloud<double> moved = cloud;
        mat3<double> A = any_rotation() * one_of({1.0, 0.5, 20.0});
        if (rarely(2)) A = A * -1.0;
        const bool rigid = !rarely(2);
        if (!rigid)
            for (int c = 0; c < 3; ++c) A[c] += around(vec3<double>(0), 0.3);
        const Affine<double> map(A, around(vec3<double>(0), 5));
        move_cloud(moved, map);
        const vec3<double> d = any_rotation()[0];
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            require_near(moved.means[i], map(cloud.means[i]), 1e-13 * (10 + length(map(cloud.means[i]))), "mean");
            const mat3<double> expected = A * covariance_matrix(cloud, i) * transpose(A);
            require_near(covariance_matrix(moved, i), expected, 1e-12 * size_of_matrix(expected) + 1e-11, "covariance");
            if (rigid) require_near(seen<2>(moved, i, normalize(A * d)), seen<2>(cloud, i, d), 1e-12, "colour");
        }
    });
}

TEST_CASE("turned axes are an orthogonal map, and turned back they are the same") {
    check_property([] {
        const GaussianCloud<double> cloud = any_cloud(3);
        mat3<double> A = any_rotation();
        if (rarely(2)) A = A * -1.0;
        if (rarely(3))
            A = mat3<double>(vec3<double>(-1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, one_of({1.0, -1.0})));
        GaussianCloud<double> turned = cloud;
        turn_axes(turned, A);
        const vec3<double> d = any_rotation()[1];
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            require_near(turned.means[i], A * cloud.means[i], 1e-13, "mean");
            const mat3<double> expected = A * covariance_matrix(cloud, i) * transpose(A);
            require_near(covariance_matrix(turned, i), expected, 1e-12 * size_of_matrix(expected), "covariance");
            require_near(seen<3>(turned, i, A * d), seen<3>(cloud, i, d), 1e-12, "colour");
        }
        turn_axes(turned, transpose(A));
        for (std::size_t i = 0; i < cloud.size(); ++i)
            require_near(covariance_matrix(turned, i), covariance_matrix(cloud, i),
                         1e-12 * size_of_matrix(covariance_matrix(cloud, i)), "there and back");
    });
}
