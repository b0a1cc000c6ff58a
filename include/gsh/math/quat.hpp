// SPDX-License-Identifier: Apache-2.0
/// @file  Quaternions as rotations, with adjoints.
#pragma once

#include <gsh/math/vec.hpp>

namespace gsh {

/// w + x i + y j + z k.
template <class T>
struct quat {
    T w = T(1), x = T(0), y = T(0), z = T(0);

    GSH_HD quat& operator+=(const quat& o) {
        w += o.w, x += o.x, y += o.y, z += o.z;
        return *this;
    }
};

template <Lane T>
[[nodiscard]] GSH_HD T dot(const quat<T>& a, const quat<T>& b) {
    return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}

/// q / |q|; q must not be zero.
template <Lane T>
[[nodiscard]] GSH_HD quat<T> normalize(const quat<T>& q) {
    const T s = T(1) / sqrt(dot(q, q));
    return {q.w * s, q.x * s, q.y * s, q.z * s};
}

/// Adjoint of normalize: dL_dq += (I - n nᵀ) dL_dn / |q|.
template <Lane T>
GSH_HD void normalize_backward(const quat<T>& q, const quat<T>& dL_dn, quat<T>& dL_dq) {
    const T s = T(1) / sqrt(dot(q, q));
    const quat<T> n{q.w * s, q.x * s, q.y * s, q.z * s};
    const T along = dot(n, dL_dn);
    dL_dq += quat<T>{(dL_dn.w - n.w * along) * s, (dL_dn.x - n.x * along) * s, (dL_dn.y - n.y * along) * s,
                     (dL_dn.z - n.z * along) * s};
}

/// The unit quaternion of the shortest rotation from +z to the unit vector n; half a turn about x where n is -z.
template <Lane T>
[[nodiscard]] GSH_HD quat<T> quat_from_z_axis(const vec3<T>& n) {
    // |(1 + n.z, -n.y, n.x)|² = 2 (1 + n.z). Near n.z = -1 this cancels, so the length comes from the vector part.
    const T sine = sqrt(n.x * n.x + n.y * n.y);
    const T real = select(n.z > T(0), T(1) + n.z, sine * sine / max(T(1) - n.z, T(1)));
    const MaskOf<T> opposite = real * real + sine * sine < T(1e-30);
    return normalize(quat<T>{real, select(opposite, T(1), -n.y), n.x, T(0)});
}

/// a b: for unit quaternions the rotation b, followed by a.
template <Lane T>
[[nodiscard]] GSH_HD quat<T> product(const quat<T>& a, const quat<T>& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}

/// The rotation matrix of a unit quaternion.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> rotation_matrix(const quat<T>& q) {
    const T two = T(2), one = T(1);
    const vec3<T> column0(one - two * (q.y * q.y + q.z * q.z), two * (q.x * q.y + q.w * q.z),
                          two * (q.x * q.z - q.w * q.y));
    const vec3<T> column1(two * (q.x * q.y - q.w * q.z), one - two * (q.x * q.x + q.z * q.z),
                          two * (q.y * q.z + q.w * q.x));
    const vec3<T> column2(two * (q.x * q.z + q.w * q.y), two * (q.y * q.z - q.w * q.x),
                          one - two * (q.x * q.x + q.y * q.y));
    return mat3<T>(column0, column1, column2);
}

/// Adjoint of rotation_matrix: w, x, y, z count as independent; normalize_backward covers the unit length.
template <Lane T>
GSH_HD void rotation_matrix_backward(const quat<T>& q, const mat3<T>& dL_dm, quat<T>& dL_dq) {
    const T two = T(2);
    // Sums and differences of mirrored entries g(row, column), which is dL_dm[column][row].
    const T s01 = dL_dm[1].x + dL_dm[0].y, s02 = dL_dm[2].x + dL_dm[0].z, s12 = dL_dm[2].y + dL_dm[1].z;
    const T d10 = dL_dm[0].y - dL_dm[1].x, d02 = dL_dm[2].x - dL_dm[0].z, d21 = dL_dm[1].z - dL_dm[2].y;
    const T g00 = dL_dm[0].x, g11 = dL_dm[1].y, g22 = dL_dm[2].z;
    dL_dq += quat<T>{two * (q.x * d21 + q.y * d02 + q.z * d10),
                     two * (q.y * s01 + q.z * s02 + q.w * d21 - two * q.x * (g11 + g22)),
                     two * (q.x * s01 + q.z * s12 + q.w * d02 - two * q.y * (g00 + g22)),
                     two * (q.x * s02 + q.y * s12 + q.w * d10 - two * q.z * (g00 + g11))};
}

} // namespace gsh
