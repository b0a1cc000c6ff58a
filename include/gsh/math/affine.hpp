// SPDX-License-Identifier: Apache-2.0
/// @file  Affine maps x ↦ L x + t: bone transforms, camera extrinsics and their weighted sums.
#pragma once

#include <gsh/math/vec.hpp>

namespace gsh {

/// A 3x4 matrix [linear | translation]. Addition and scaling act on the matrix entries, as linear blending requires.
template <class T>
struct Affine {
    mat3<T> linear;
    vec3<T> translation;

    // Constructors instead of member initialisers: nvcc 13.0 turns the initialisers into constants whose types its own
    // verifier rejects ("Invalid bitcast") without failing.
    GSH_HD Affine() : linear(T(1)), translation(T(0)) {}
    GSH_HD Affine(const mat3<T>& linear_, const vec3<T>& translation_) : linear(linear_), translation(translation_) {}

    [[nodiscard]] GSH_HD static Affine zero() { return {mat3<T>(T(0)), vec3<T>(T(0))}; }

    [[nodiscard]] GSH_HD vec3<T> operator()(const vec3<T>& point) const { return linear * point + translation; }

    /// this += scale * other.
    GSH_HD void add_scaled(const Affine& other, T scale) {
        linear += other.linear * scale;
        translation += other.translation * scale;
    }
};

/// a_from_c = a_from_b * b_from_c.
template <Lane T>
[[nodiscard]] GSH_HD Affine<T> operator*(const Affine<T>& a, const Affine<T>& b) {
    return {a.linear * b.linear, a.linear * b.translation + a.translation};
}

/// Adjoint of the product: adds to dL_da and dL_db.
template <Lane T>
GSH_HD void product_backward(const Affine<T>& a, const Affine<T>& b, const Affine<T>& dL_dproduct, Affine<T>& dL_da,
                             Affine<T>& dL_db) {
    dL_da.linear += dL_dproduct.linear * transpose(b.linear) + outer(dL_dproduct.translation, b.translation);
    dL_da.translation += dL_dproduct.translation;
    dL_db.linear += transpose(a.linear) * dL_dproduct.linear;
    dL_db.translation += transposed_times(a.linear, dL_dproduct.translation);
}

/// Adjoint of y = map(point): adds to dL_dmap and dL_dpoint.
template <Lane T>
GSH_HD void apply_backward(const Affine<T>& map, const vec3<T>& point, const vec3<T>& dL_dy, Affine<T>& dL_dmap,
                           vec3<T>& dL_dpoint) {
    dL_dmap.linear += outer(dL_dy, point);
    dL_dmap.translation += dL_dy;
    dL_dpoint += transposed_times(map.linear, dL_dy);
}

} // namespace gsh
