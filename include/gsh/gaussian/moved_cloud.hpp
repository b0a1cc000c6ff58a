// SPDX-License-Identifier: Apache-2.0
/// @file  A cloud of Gaussians under an affine map: means, shapes and view-dependent colours.
#pragma once

#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sh_rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>

namespace gsh {

/// Scale and quaternion of A F for the factor F = R S of a Gaussian: the principal axes, and the logarithms of their
/// lengths, of which none is below a micrometre.
template <std::floating_point T>
void move_shape(const mat3<double>& A, quat<T>& q, vec3<T>& log_scale) {
    const auto axes =
        principal_axes(A * covariance_factor(quat<double>{double(q.w), double(q.x), double(q.y), double(q.z)},
                                             vec3<double>(log_scale)));
    const quat<double> turned = quat_from_rotation(axes.R);
    q = {T(turned.w), T(turned.x), T(turned.y), T(turned.z)};
    for (int k = 0; k < 3; ++k) log_scale[k] = static_cast<T>(std::log(std::max(axes.lengths[k], 1e-6)));
}

/// Turns the coefficients sh [basis_count] by the rotation R, in place.
template <int Degree, std::floating_point T>
void turn_sh(const mat3<double>& R, vec3<T>* sh) {
    constexpr int count = sh_basis_count(Degree);
    vec3<double> before[count], after[count];
    for (int k = 0; k < count; ++k) before[k] = vec3<double>(sh[k]);
    ShRotation<Degree>::forward(before, R, after);
    for (int k = 0; k < count; ++k) sh[k] = vec3<T>(after[k]);
}

/// Moves a cloud by an affine map, which may mirror. The covariances are exact. The SH turn by the rotation nearest to
/// the linear part, which is exact if that is a rotation times a scale. A mirror is a turn after all directions were
/// reversed, which negates the SH of odd degree.
template <std::floating_point T>
void move_cloud(GaussianCloud<T>& cloud, const Affine<double>& map) {
    const bool mirrors = determinant(map.linear) < 0;
    const mat3<double> A = mirrors ? map.linear * -1.0 : map.linear, R = polar_rotation(A);
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        constexpr std::size_t basis = sh_basis_count(decltype(degree)::value);
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            cloud.means[i] = vec3<T>(map(vec3<double>(cloud.means[i])));
            move_shape(A, cloud.quats[i], cloud.log_scales[i]);
            vec3<T>* const sh = cloud.sh.data() + i * basis;
            for (std::size_t l = 1; mirrors && l * l < basis; l += 2)
                for (std::size_t k = l * l; k < (l + 1) * (l + 1); ++k) sh[k] = -sh[k];
            turn_sh<decltype(degree)::value>(R, sh);
        }
    });
}

} // namespace gsh
