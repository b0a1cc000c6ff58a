// SPDX-License-Identifier: Apache-2.0
/// @file  Packed symmetric matrices: covariances and conics.
///
/// Gradients are taken with respect to the packed numbers. An off-diagonal number stands for two matrix entries, so
/// its gradient is the sum of both entries' gradients.
#pragma once

#include <gsh/math/vec.hpp>

namespace gsh {

/// Symmetric 2x2 matrix [xx xy; xy yy].
template <class T>
struct sym2 {
    T xx, xy, yy;
};

/// Symmetric 3x3 matrix, upper triangle by rows.
template <class T>
struct sym3 {
    T xx, xy, xz, yy, yz, zz;

    GSH_HD sym3& operator+=(const sym3& o) {
        xx += o.xx, xy += o.xy, xz += o.xz, yy += o.yy, yz += o.yz, zz += o.zz;
        return *this;
    }
};

template <Lane T>
[[nodiscard]] GSH_HD T determinant(const sym2<T>& s) {
    return s.xx * s.yy - s.xy * s.xy;
}

template <Lane T>
[[nodiscard]] GSH_HD mat3<T> full_matrix(const sym3<T>& s) {
    return mat3<T>(vec3<T>(s.xx, s.xy, s.xz), vec3<T>(s.xy, s.yy, s.yz), vec3<T>(s.xz, s.yz, s.zz));
}

/// The symmetric matrix G of dL = <G, dS> for a packed gradient: each off-diagonal entry is half the packed number.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> full_gradient(const sym3<T>& dL_ds) {
    const T half = T(0.5);
    return full_matrix(sym3<T>{dL_ds.xx, half * dL_ds.xy, half * dL_ds.xz, dL_ds.yy, half * dL_ds.yz, dL_ds.zz});
}

/// M Mᵀ.
template <Lane T>
[[nodiscard]] GSH_HD sym3<T> gram(const mat3<T>& m) {
    const mat3<T> rows = transpose(m);
    return {dot(rows[0], rows[0]), dot(rows[0], rows[1]), dot(rows[0], rows[2]),
            dot(rows[1], rows[1]), dot(rows[1], rows[2]), dot(rows[2], rows[2])};
}

/// Adjoint of gram: dL_dm += 2 G m.
template <Lane T>
GSH_HD void gram_backward(const mat3<T>& m, const sym3<T>& dL_dgram, mat3<T>& dL_dm) {
    dL_dm += full_gradient(dL_dgram) * m * T(2);
}

/// A S Aᵀ.
template <Lane T>
[[nodiscard]] GSH_HD sym3<T> congruence(const mat3<T>& a, const sym3<T>& s) {
    const mat3<T> rows = transpose(a), half = transpose(a * full_matrix(s)); // rows of A, rows of A S
    return {dot(half[0], rows[0]), dot(half[0], rows[1]), dot(half[0], rows[2]),
            dot(half[1], rows[1]), dot(half[1], rows[2]), dot(half[2], rows[2])};
}

/// Adjoint of congruence: dL_da += 2 G A S, dL_ds += Aᵀ G A.
template <Lane T>
GSH_HD void congruence_backward(const mat3<T>& a, const sym3<T>& s, const sym3<T>& dL_dresult, mat3<T>& dL_da,
                                sym3<T>& dL_ds) {
    const mat3<T> g = full_gradient(dL_dresult);
    dL_da += g * a * full_matrix(s) * T(2);
    const mat3<T> back = transpose(a) * g * a;
    dL_ds += sym3<T>{back[0].x, T(2) * back[0].y, T(2) * back[0].z, back[1].y, T(2) * back[1].z, back[2].z};
}

} // namespace gsh
