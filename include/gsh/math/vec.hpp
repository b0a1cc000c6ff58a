// SPDX-License-Identifier: Apache-2.0
/// @file  Small vectors and matrices over a lane type: GLM's storage with our own products and adjoints.
///
/// GLM's own geometric functions require built-in floating-point types. The functions here accept every Lane. They are
/// more specialised, so overload resolution prefers them where both are visible.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>

#if defined(__CUDACC__)
#pragma nv_diagnostic push
#pragma nv_diag_suppress 20012 // GLM marks defaulted functions __host__ __device__
#endif
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#if defined(__CUDACC__)
#pragma nv_diagnostic pop
#endif

#include <type_traits>

namespace gsh {

template <class T>
using vec2 = glm::vec<2, T>;
template <class T>
using vec3 = glm::vec<3, T>;
template <class T>
using vec4 = glm::vec<4, T>;
/// 3x3 matrix, stored by columns: m[column][row].
template <class T>
using mat3 = glm::mat<3, 3, T>;

template <Lane T>
[[nodiscard]] GSH_HD T dot(const vec3<T>& a, const vec3<T>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <Lane T>
[[nodiscard]] GSH_HD vec3<T> cross(const vec3<T>& a, const vec3<T>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

template <Lane T>
[[nodiscard]] GSH_HD T length(const vec3<T>& v) {
    return sqrt(dot(v, v));
}

/// v / |v|; v must not be zero.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> normalize(const vec3<T>& v) {
    return v * (T(1) / length(v));
}

/// Adjoint of normalize: dL_dv += (I - n nᵀ) dL_dn / |v|.
template <Lane T>
GSH_HD void normalize_backward(const vec3<T>& v, const vec3<T>& dL_dn, vec3<T>& dL_dv) {
    const T inverse_length = T(1) / length(v);
    const vec3<T> n = v * inverse_length;
    dL_dv += (dL_dn - n * dot(n, dL_dn)) * inverse_length;
}

/// a bᵀ.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> outer(const vec3<T>& a, const vec3<T>& b) {
    return mat3<T>(a * b.x, a * b.y, a * b.z);
}

template <Lane T>
[[nodiscard]] GSH_HD mat3<T> transpose(const mat3<T>& m) {
    return mat3<T>(vec3<T>(m[0].x, m[1].x, m[2].x), vec3<T>(m[0].y, m[1].y, m[2].y),
                   vec3<T>(m[0].z, m[1].z, m[2].z));
}

/// mᵀ v.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> transposed_times(const mat3<T>& m, const vec3<T>& v) {
    return {dot(m[0], v), dot(m[1], v), dot(m[2], v)};
}

template <Lane T>
[[nodiscard]] GSH_HD T determinant(const mat3<T>& m) {
    return dot(m[0], cross(m[1], m[2]));
}

/// m⁻¹; m must be invertible.
template <Lane T>
[[nodiscard]] GSH_HD mat3<T> inverse(const mat3<T>& m) {
    const vec3<T> r0 = cross(m[1], m[2]), r1 = cross(m[2], m[0]), r2 = cross(m[0], m[1]);
    const T inverse_determinant = T(1) / dot(m[0], r0);
    return transpose(mat3<T>(r0 * inverse_determinant, r1 * inverse_determinant, r2 * inverse_determinant));
}

/// Adjoint of inverse, given the inverse itself: dL_dm -= m⁻ᵀ dL_dinv m⁻ᵀ.
template <Lane T>
GSH_HD void inverse_backward(const mat3<T>& inverse_m, const mat3<T>& dL_dinverse, mat3<T>& dL_dm) {
    const mat3<T> inverse_transposed = transpose(inverse_m);
    dL_dm -= inverse_transposed * dL_dinverse * inverse_transposed;
}

/// Reinterprets an array as another type, for instance scalars as vectors or quaternions, or back. Both types must
/// consist of the same scalar type only.
template <class To, class From>
[[nodiscard]] GSH_HD Span<To> view_as(Span<From> values) {
    static_assert(alignof(To) == alignof(From) && std::is_const_v<To> >= std::is_const_v<From>);
    return {reinterpret_cast<To*>(values.data()), values.size() * sizeof(From) / sizeof(To)};
}

} // namespace gsh
