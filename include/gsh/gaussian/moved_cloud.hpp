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

/// Moves a cloud by an affine map. The covariances are exact. The SH turn by the rotation nearest to the linear part,
/// which is exact if that is a rotation times a scale.
template <std::floating_point T>
void move_cloud(GaussianCloud<T>& cloud, const Affine<double>& map) {
    const mat3<double> R = polar_rotation(map.linear);
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        constexpr std::size_t basis = sh_basis_count(decltype(degree)::value);
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            cloud.means[i] = vec3<T>(map(vec3<double>(cloud.means[i])));
            move_shape(map.linear, cloud.quats[i], cloud.log_scales[i]);
            turn_sh<decltype(degree)::value>(R, cloud.sh.data() + i * basis);
        }
    });
}

} // namespace gsh
