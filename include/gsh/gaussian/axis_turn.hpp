// SPDX-License-Identifier: Apache-2.0
/// @file  A cloud of Gaussians in other axes: turned or mirrored, with places, shapes and view-dependent colours.
#pragma once

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Changes the signs of axes, each entry of `signs` 1 or -1: no number is rounded, and twice is nothing. (1, -1, -1) is
/// half a turn about x, which leads from axes with y up to those of a camera, and back.
///
/// A quaternion q becomes that of F R F. The covariance F R S² Rᵀ F is the same with it as with F R, since S is
/// diagonal, and F R F is a rotation where F mirrors, too.
template <std::floating_point T>
void flip_axes(GaussianCloud<T>& cloud, const vec3<T>& signs) {
    for (vec3<T>& mean : cloud.means) mean = mean * signs;
    for (quat<T>& q : cloud.quats) q = {q.w, q.x * signs.y * signs.z, q.y * signs.x * signs.z, q.z * signs.x * signs.y};
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    for (std::size_t i = 0; i < cloud.sh.size(); ++i) {
        const std::size_t k = i % basis;
        std::size_t l = 0;
        while ((l + 1) * (l + 1) <= k) ++l;
        // m = k - l² - l. Y is odd in z for odd l + m, odd in y for m < 0, and odd in x for the rest of its degree l.
        const bool odd_z = (k - l * l) % 2, odd_y = k < l * l + l, odd_x = l % 2 != (odd_z != odd_y);
        const T sign = (odd_x ? signs.x : T(1)) * (odd_y ? signs.y : T(1)) * (odd_z ? signs.z : T(1));
        cloud.sh[i] = cloud.sh[i] * sign;
    }
}

/// Moves a cloud to other axes: x' = A x for an orthogonal A, whose rows are the new axes in the old ones. A may
/// mirror. Where A only changes signs, nothing is rounded.
template <std::floating_point T>
void turn_axes(GaussianCloud<T>& cloud, const mat3<double>& A) {
    if (A[0].y == 0 && A[0].z == 0 && A[1].x == 0 && A[1].z == 0 && A[2].x == 0 && A[2].y == 0)
        return flip_axes(cloud, vec3<T>(T(A[0].x), T(A[1].y), T(A[2].z)));
    mat3<double> R = A;
    if (determinant(A) < 0) { // A = R F, where F mirrors x
        flip_axes(cloud, vec3<T>(T(-1), T(1), T(1)));
        R[0] = -R[0];
    }
    const quat<double> r = quat_from_rotation(R);
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        constexpr std::size_t basis = sh_basis_count(decltype(degree)::value);
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            cloud.means[i] = vec3<T>(R * vec3<double>(cloud.means[i]));
            const quat<T> q = cloud.quats[i];
            const quat<double> turned = product(r, quat<double>{q.w, q.x, q.y, q.z});
            cloud.quats[i] = {T(turned.w), T(turned.x), T(turned.y), T(turned.z)};
            turn_sh<decltype(degree)::value>(R, cloud.sh.data() + i * basis);
        }
    });
}

} // namespace gsh
