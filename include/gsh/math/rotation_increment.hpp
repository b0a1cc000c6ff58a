// SPDX-License-Identifier: Apache-2.0
/// @file  Composition of an axis-angle rotation with a small rotation, with adjoints.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>

namespace gsh {

/// The Jacobian of the exponential map in the turned frame, exp(v + dv) = exp(v) exp(J dv) to first order:
/// J(v) = I - c2 [v]x + c3 [v]x², and its inverse J⁻¹ = I + [v]x/2 + (c3 - 2 c4)/(2 c2) [v]x². Since J(v)ᵀ = J(-v),
/// the transposes are the same functions of -v.
///
/// Errors  none, this is kernel code. J is singular where |v| is a multiple of 2 pi other than 0; keep |v| <= pi.
/// Source  Chirikjian, "Stochastic Models, Information Theory, and Lie Groups" 2, 2012, §10.6 ("right" Jacobian).
template <Lane T>
struct ExponentialJacobian {
    vec3<T> v;
    T first, second;  ///< J x = x - first v×x + second v×(v×x)
    T inverse_second; ///< J⁻¹ x = x + v×x / 2 + inverse_second v×(v×x)

    GSH_HD explicit ExponentialJacobian(const vec3<T>& vector) : v(vector) {
        const detail::Stumpff<T> c(dot(v, v));
        first = c.c2, second = c.c3;
        inverse_second = (c.c3 - T(2) * c.c4) / (T(2) * c.c2);
    }

    [[nodiscard]] GSH_HD vec3<T> times(const vec3<T>& x) const { return combine(x, -first, second); }
    [[nodiscard]] GSH_HD vec3<T> transposed_times(const vec3<T>& x) const { return combine(x, first, second); }
    [[nodiscard]] GSH_HD vec3<T> inverse_times(const vec3<T>& x) const { return combine(x, T(0.5), inverse_second); }
    [[nodiscard]] GSH_HD vec3<T> inverse_transposed_times(const vec3<T>& x) const {
        return combine(x, T(-0.5), inverse_second);
    }

private:
    [[nodiscard]] GSH_HD vec3<T> combine(const vec3<T>& x, T once, T twice) const {
        const vec3<T> vx = cross(v, x);
        return x + vx * once + cross(v, vx) * twice;
    }
};

/// The axis-angle vector of exp(v) exp(increment), of length at most pi. If the increment is zero, the result is v, bit
/// for bit.
template <std::floating_point T>
[[nodiscard]] GSH_HD vec3<T> turned(const vec3<T>& v, const vec3<T>& increment) {
    if (increment.x == T(0) && increment.y == T(0) && increment.z == T(0)) return v;
    return axis_angle_from_rotation(rotation_from_axis_angle(v) * rotation_from_axis_angle(increment));
}

/// Adjoint of turned with respect to the increment, given its result: adds to dL_dincrement.
///
/// A first-order change x of the increment rotates the result by J(increment) x, which changes its axis-angle vector by
/// J(result)⁻¹ J(increment) x.
template <Lane T>
GSH_HD void turned_backward(const vec3<T>& increment, const vec3<T>& result, const vec3<T>& dL_dresult,
                            vec3<T>& dL_dincrement) {
    const vec3<T> dL_dturn = ExponentialJacobian<T>(result).inverse_transposed_times(dL_dresult);
    dL_dincrement += ExponentialJacobian<T>(increment).transposed_times(dL_dturn);
}

/// The axis-angle vector of the same rotation as v that is nearest to `reference`: v plus a multiple of 2 pi along its
/// axis. A sequence of vectors made this way is continuous wherever its rotations are.
template <std::floating_point T>
[[nodiscard]] GSH_HD vec3<T> nearest_axis_angle(const vec3<T>& v, const vec3<T>& reference) {
    const T angle = length(v), whole = T(6.283185307179586);
    if (!(angle > T(0))) return v;
    const vec3<T> axis = v * (T(1) / angle);
    return v + axis * (whole * floor((dot(axis, reference) - angle) / whole + T(0.5)));
}

} // namespace gsh
