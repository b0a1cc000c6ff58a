// SPDX-License-Identifier: Apache-2.0
/// @file  The covariance of a Gaussian from its quaternion and log-scales, with adjoint.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

namespace gsh {

namespace detail {

/// The terms that the covariance and its adjoint share: F = R S and its factors (three exponentials, one square root).
template <Lane T>
struct CovarianceFactor {
    quat<T> unit;
    vec3<T> scale;
    mat3<T> R, F;

    GSH_HD CovarianceFactor(const quat<T>& q, const vec3<T>& log_scale)
        : unit(normalize(q)), scale(exp(log_scale.x), exp(log_scale.y), exp(log_scale.z)), R(rotation_matrix(unit)),
          F(R[0] * scale.x, R[1] * scale.y, R[2] * scale.z) {}

    /// The derivative of column k of F with respect to log-scale k is the column itself.
    GSH_HD void backward(const quat<T>& q, const mat3<T>& dL_dF, quat<T>& dL_dq, vec3<T>& dL_dlog_scale) const {
        dL_dlog_scale += vec3<T>(dot(F[0], dL_dF[0]), dot(F[1], dL_dF[1]), dot(F[2], dL_dF[2]));
        quat<T> dL_dunit{T(0), T(0), T(0), T(0)};
        rotation_matrix_backward(unit, mat3<T>(dL_dF[0] * scale.x, dL_dF[1] * scale.y, dL_dF[2] * scale.z), dL_dunit);
        normalize_backward(q, dL_dunit, dL_dq);
    }
};

} // namespace detail

/// F = R diag(scale) with R from the normalised q, for scales that are not logarithms; the covariance is F Fᵀ.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> scaled_rotation(const quat<T>& q, const vec3<T>& scale) {
    const mat3<T> R = rotation_matrix(normalize(q));
    return mat3<T>(R[0] * scale.x, R[1] * scale.y, R[2] * scale.z);
}

/// Adjoint of scaled_rotation: adds to dL_dq and dL_dscale.
template <Lane T>
GSH_HD void scaled_rotation_backward(const quat<T>& q, const vec3<T>& scale, const mat3<T>& dL_dF, quat<T>& dL_dq,
                                     vec3<T>& dL_dscale) {
    const quat<T> unit = normalize(q);
    const mat3<T> R = rotation_matrix(unit);
    dL_dscale += vec3<T>(dot(R[0], dL_dF[0]), dot(R[1], dL_dF[1]), dot(R[2], dL_dF[2]));
    quat<T> dL_dunit{T(0), T(0), T(0), T(0)};
    rotation_matrix_backward(unit, mat3<T>(dL_dF[0] * scale.x, dL_dF[1] * scale.y, dL_dF[2] * scale.z), dL_dunit);
    normalize_backward(q, dL_dunit, dL_dq);
}

/// F = R diag(exp s); the covariance is F Fᵀ. A linear map M of space turns F into M F.
///
/// Shapes  q [4] of any length but zero, log_scale [3].
/// Units   log_scale: logarithm of metres; F: metres.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023, equation 6.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> covariance_factor(const quat<T>& q, const vec3<T>& log_scale) {
    return detail::CovarianceFactor<T>(q, log_scale).F;
}

/// Adjoint of covariance_factor: adds to dL_dq and dL_dlog_scale.
template <Lane T>
GSH_HD void covariance_factor_backward(const quat<T>& q, const vec3<T>& log_scale, const mat3<T>& dL_dfactor,
                                       quat<T>& dL_dq, vec3<T>& dL_dlog_scale) {
    detail::CovarianceFactor<T>(q, log_scale).backward(q, dL_dfactor, dL_dq, dL_dlog_scale);
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
    const detail::CovarianceFactor<T> factor(q, log_scale);
    factor.backward(q, full_gradient(dL_dcovariance) * factor.F * T(2), dL_dq, dL_dlog_scale);
}

} // namespace gsh
