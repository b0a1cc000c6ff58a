// SPDX-License-Identifier: Apache-2.0
/// @file  The covariance of a Gaussian from its quaternion and log-scales.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sym.hpp>

namespace gsh {

/// F = R diag(exp s), whose gram F Fᵀ is the covariance. A linear map M of space turns F into M F.
///
/// Shapes  q [4] of any length but zero, log_scale [3].
/// Units   log_scale: logarithm of metres; F: metres.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023, equation 6.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> covariance_factor(const quat<T>& q, const vec3<T>& log_scale) {
    const mat3<T> R = rotation_from_quat(q);
    return mat3<T>(R[0] * exp(log_scale.x), R[1] * exp(log_scale.y), R[2] * exp(log_scale.z));
}

/// Adjoint of covariance_factor: adds to dL_dq and dL_dlog_scale.
template <Lane T>
GSH_HD void covariance_factor_backward(const quat<T>& q, const vec3<T>& log_scale, const mat3<T>& dL_dfactor,
                                       quat<T>& dL_dq, vec3<T>& dL_dlog_scale) {
    const mat3<T> R = rotation_from_quat(q);
    mat3<T> dL_dR;
    for (int k = 0; k < 3; ++k) {
        const T scale = exp(log_scale[k]);
        exp_backward(scale, dot(R[k], dL_dfactor[k]), dL_dlog_scale[k]);
        dL_dR[k] = dL_dfactor[k] * scale;
    }
    rotation_from_quat_backward(q, dL_dR, dL_dq);
}

/// R S Sᵀ Rᵀ with R from the normalised q and S = diag(exp(log_scale)); square metres.
template <Lane T>
[[nodiscard]] GSH_HD sym3<T> covariance(const quat<T>& q, const vec3<T>& log_scale) {
    return gram(covariance_factor(q, log_scale));
}

/// Adjoint of covariance, dL_dcovariance with respect to the packed numbers: adds to dL_dq and dL_dlog_scale.
template <Lane T>
GSH_HD void covariance_backward(const quat<T>& q, const vec3<T>& log_scale, const sym3<T>& dL_dcovariance,
                                quat<T>& dL_dq, vec3<T>& dL_dlog_scale) {
    mat3<T> dL_dfactor(T(0));
    gram_backward(covariance_factor(q, log_scale), dL_dcovariance, dL_dfactor);
    covariance_factor_backward(q, log_scale, dL_dfactor, dL_dq, dL_dlog_scale);
}

} // namespace gsh
