// SPDX-License-Identifier: Apache-2.0
/// @file  Rotation matrices from axis-angle vectors, Euler angles and quaternions, with adjoints, and their inverses.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <concepts>

namespace gsh {

namespace detail {

/// The Stumpff functions c_k(u) = sum_n (-u)^n / (2n + k)! at u = angle², u >= 0: c1 = sin(a)/a, c2 = (1 - cos a)/a².
///
/// They are smooth at 0, satisfy c_k = 1/k! - u c_(k+2), and their derivatives are combinations of each other:
/// c1' = (c3 - c2)/2, c2' = c4 - c3/2. The series is used below one radian, the closed forms above.
///
/// Source  Stumpff, "Himmelsmechanik" I, 1959.
template <Lane T>
struct Stumpff {
    T c1, c2, c3, c4;

    GSH_HD explicit Stumpff(T u) {
        const T s = min(u, T(1)), one = T(1);
        // c3 = 1/3! (1 - u/(4·5) (1 - u/(6·7) (…))), c4 = 1/4! (1 - u/(5·6) (1 - u/(7·8) (…))); error 3e-18 at u = 1.
        T series3 = one, series4 = one;
        for (int k = 18; k >= 4; k -= 2) {
            series3 = one - s * T(ScalarOf<T>(1) / ScalarOf<T>(k * (k + 1))) * series3;
            series4 = one - s * T(ScalarOf<T>(1) / ScalarOf<T>((k + 1) * (k + 2))) * series4;
        }
        series3 = series3 * T(ScalarOf<T>(1) / 6);
        series4 = series4 * T(ScalarOf<T>(1) / 24);

        const T large = max(u, one), angle = sqrt(large);
        const T closed1 = sin(angle) / angle, closed2 = (one - cos(angle)) / large;
        const MaskOf<T> small = u < one;
        c1 = select(small, one - s * series3, closed1);
        c2 = select(small, T(0.5) - s * series4, closed2);
        c3 = select(small, series3, (one - closed1) / large);
        c4 = select(small, series4, (T(0.5) - closed2) / large);
    }
};

/// Twice the axial vector of m's skew part: <m, [v]x> = dot(axial(m), v).
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> axial(const mat3<T>& m) {
    return {m[1].z - m[2].y, m[2].x - m[0].z, m[0].y - m[1].x};
}

} // namespace detail

/// R = I + c1 [v]x + c2 [v]x², the rotation by |v| radians about v; exact and smooth at v = 0.
///
/// Source  Rodrigues, 1840; c1 = sin(a)/a and c2 = (1 - cos a)/a² as functions of a² = v·v.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> rotation_from_axis_angle(const vec3<T>& v) {
    const T u = dot(v, v);
    const detail::Stumpff<T> c(u);
    const vec3<T> s = v * c.c1, b = v * c.c2; // [v]x² = v vᵀ - u I
    const T diagonal = T(1) - c.c2 * u;
    return mat3<T>(vec3<T>(diagonal + b.x * v.x, b.x * v.y + s.z, b.x * v.z - s.y),
                   vec3<T>(b.x * v.y - s.z, diagonal + b.y * v.y, b.y * v.z + s.x),
                   vec3<T>(b.x * v.z + s.y, b.y * v.z - s.x, diagonal + b.z * v.z));
}

/// Adjoint of rotation_from_axis_angle: adds to dL_dv.
template <Lane T>
GSH_HD void rotation_from_axis_angle_backward(const vec3<T>& v, const mat3<T>& dL_dR, vec3<T>& dL_dv) {
    const T u = dot(v, v), half = T(0.5);
    const detail::Stumpff<T> c(u);
    const vec3<T> skew = detail::axial(dL_dR), forth = dL_dR * v, back = transposed_times(dL_dR, v);
    const T trace = dL_dR[0].x + dL_dR[1].y + dL_dR[2].z;
    const T dL_dc1 = dot(skew, v), dL_dc2 = dot(v, forth) - u * trace;
    const T dL_du = dL_dc1 * half * (c.c3 - c.c2) + dL_dc2 * (c.c4 - half * c.c3) - c.c2 * trace;
    dL_dv += skew * c.c1 + (forth + back) * c.c2 + v * (T(2) * dL_du);
}

/// J with rotation_from_axis_angle(v + dv) = rotation_from_axis_angle(J dv) rotation_from_axis_angle(v) to first order:
/// the turn, in the frame that v rotates into, per change of v. The left Jacobian of SO(3).
///
/// Source  Solà et al., "A micro Lie theory for state estimation in robotics", 2018, equation 145.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> axis_angle_jacobian(const vec3<T>& v) {
    const T u = dot(v, v);
    const detail::Stumpff<T> c(u);
    const vec3<T> s = v * c.c2, b = v * c.c3; // J = I + c2 [v]x + c3 [v]x²
    const T diagonal = T(1) - c.c3 * u;
    return mat3<T>(vec3<T>(diagonal + b.x * v.x, b.x * v.y + s.z, b.x * v.z - s.y),
                   vec3<T>(b.x * v.y - s.z, diagonal + b.y * v.y, b.y * v.z + s.x),
                   vec3<T>(b.x * v.z + s.y, b.y * v.z - s.x, diagonal + b.z * v.z));
}

/// The order of the factors: xyz means R = Rx(angles[0]) Ry(angles[1]) Rz(angles[2]), intrinsic rotations from left to
/// right. The same rotations about fixed axes have the reversed order and the reversed angles.
enum class EulerOrder { xyz, xzy, yxz, yzx, zxy, zyx };

namespace detail {

/// The axes of an order, first factor first.
struct EulerAxes {
    int axis[3];

    GSH_HD constexpr explicit EulerAxes(EulerOrder order) : axis{0, 0, 0} {
        const int first = static_cast<int>(order) / 2, flipped = static_cast<int>(order) % 2;
        const int low = first == 0 ? 1 : 0, high = first == 2 ? 1 : 2;
        axis[0] = first;
        axis[1] = flipped ? high : low;
        axis[2] = flipped ? low : high;
    }
};

/// The rotation by `angle` about a coordinate axis.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> axis_rotation(int axis, T angle) {
    const int a = (axis + 1) % 3, b = (axis + 2) % 3;
    const T c = cos(angle), s = sin(angle);
    mat3<T> m = mat3<T>(T(1));
    m[a][a] = c, m[b][b] = c;
    m[a][b] = s, m[b][a] = -s;
    return m;
}

} // namespace detail

/// Rotation from three angles in radians, in the order of the factors.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> rotation_from_euler(const vec3<T>& angles, EulerOrder order) {
    const detail::EulerAxes axes(order);
    return detail::axis_rotation(axes.axis[0], angles.x) * detail::axis_rotation(axes.axis[1], angles.y) *
           detail::axis_rotation(axes.axis[2], angles.z);
}

/// Adjoint of rotation_from_euler: adds to dL_dangles.
///
/// A small turn about the first factor's axis e multiplies R by I + da [e]x from the left, so dL_da = <dL_dR Rᵀ, [e]x>.
/// The later axes are rotated by the factors before them.
template <Lane T>
GSH_HD void rotation_from_euler_backward(const vec3<T>& angles, EulerOrder order, const mat3<T>& dL_dR,
                                         vec3<T>& dL_dangles) {
    const detail::EulerAxes axes(order);
    const mat3<T> first = detail::axis_rotation(axes.axis[0], angles.x);
    const mat3<T> both = first * detail::axis_rotation(axes.axis[1], angles.y);
    const mat3<T> R = both * detail::axis_rotation(axes.axis[2], angles.z);
    const vec3<T> torque = detail::axial(dL_dR * transpose(R));
    dL_dangles += vec3<T>(torque[axes.axis[0]], dot(torque, first[axes.axis[1]]), dot(torque, both[axes.axis[2]]));
}

/// Rotation of a quaternion of any length but zero.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> rotation_from_quat(const quat<T>& q) {
    return rotation_matrix(normalize(q));
}

/// Adjoint of rotation_from_quat: adds to dL_dq.
template <Lane T>
GSH_HD void rotation_from_quat_backward(const quat<T>& q, const mat3<T>& dL_dR, quat<T>& dL_dq) {
    quat<T> dL_dn{T(0), T(0), T(0), T(0)};
    rotation_matrix_backward(normalize(q), dL_dR, dL_dn);
    normalize_backward(q, dL_dn, dL_dq);
}

/// The unit quaternion of a rotation matrix, w >= 0.
///
/// Source  Shepperd, "Quaternion from rotation matrix", 1978: divide by the largest of the four components.
template <std::floating_point T>
[[nodiscard]] GSH_HD quat<T> quat_from_rotation(const mat3<T>& R) {
    const T trace = R[0].x + R[1].y + R[2].z;
    quat<T> q;
    if (trace > R[0].x && trace > R[1].y && trace > R[2].z) {
        const vec3<T> skew = detail::axial(R);
        q = {T(1) + trace, skew.x, skew.y, skew.z};
    } else {
        const int i = R[0].x >= R[1].y && R[0].x >= R[2].z ? 0 : R[1].y >= R[2].z ? 1 : 2;
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        T v[3];
        v[i] = T(1) + R[i][i] - R[j][j] - R[k][k];
        v[j] = R[i][j] + R[j][i];
        v[k] = R[i][k] + R[k][i];
        q = {R[j][k] - R[k][j], v[0], v[1], v[2]};
    }
    const T scale = (q.w < T(0) ? T(-1) : T(1)) / std::sqrt(dot(q, q));
    return {q.w * scale, q.x * scale, q.y * scale, q.z * scale};
}

/// The logarithm of a rotation matrix: its axis-angle vector, of length at most pi. This is the inverse of
/// rotation_from_axis_angle. At length pi, v and -v give the same rotation, and the function returns one of them.
template <std::floating_point T>
[[nodiscard]] GSH_HD vec3<T> axis_angle_from_rotation(const mat3<T>& R) {
    const quat<T> q = quat_from_rotation(R);
    const vec3<T> v(q.x, q.y, q.z);
    const T sine = length(v); // of half the angle
    // 2 atan2(s, w) / s tends to 2/w. Below the square root of the machine epsilon the two are equal after rounding.
    const T scale = sine > T(1e-8) ? T(2) * std::atan2(sine, q.w) / sine : T(2) / q.w;
    return v * scale;
}

/// Whether the columns of A are orthonormal within `tolerance` and right-handed.
template <std::floating_point T>
[[nodiscard]] bool is_rotation(const mat3<T>& A, T tolerance) {
    bool rotation = determinant(A) > T(0);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) rotation = rotation && std::abs(dot(A[i], A[j]) - T(i == j)) < tolerance;
    return rotation;
}

} // namespace gsh
