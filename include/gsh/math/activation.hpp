// SPDX-License-Identifier: Apache-2.0
/// @file  Activation functions, and their adjoints, which take the activated value from the forward pass.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

namespace gsh {

/// 1 / (1 + e^-x). Returns exactly 0 or 1 where rounding reaches it.
template <Lane T>
[[nodiscard]] GSH_HD T sigmoid(T x) {
    return T(1) / (T(1) + exp(-x));
}

/// Adjoint of y = sigmoid(x), given y: dL_dx += y (1 - y) dL_dy.
template <Lane T>
GSH_HD void sigmoid_backward(T y, T dL_dy, T& dL_dx) {
    dL_dx += y * (T(1) - y) * dL_dy;
}

/// The inverse of sigmoid, log(p / (1 - p)); p in (0, 1).
template <Lane T>
[[nodiscard]] GSH_HD T logit(T p) {
    return log(p / (T(1) - p));
}

/// Adjoint of logit(p), given p: dL_dp += dL_dx / (p (1 - p)).
template <Lane T>
GSH_HD void logit_backward(T p, T dL_dx, T& dL_dp) {
    dL_dp += dL_dx / (p * (T(1) - p));
}

/// Adjoint of y = exp(x), given y: dL_dx += y dL_dy.
template <Lane T>
GSH_HD void exp_backward(T y, T dL_dy, T& dL_dx) {
    dL_dx += y * dL_dy;
}

} // namespace gsh
