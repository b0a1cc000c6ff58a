// SPDX-License-Identifier: Apache-2.0
/// @file  Dual quaternions as rigid motions, with adjoints; unlike blended matrices, their blends stay rigid.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>

namespace gsh {

/// real + ε dual with ε² = 0. The motion x ↦ R x + t has real = quaternion of R and dual = ½ (0, t) real. The negative
/// and every positive multiple of a dual quaternion represent the same motion.
template <class T>
struct dual_quat {
    quat<T> real, dual;

    [[nodiscard]] GSH_HD static dual_quat zero() {
        return {{T(0), T(0), T(0), T(0)}, {T(0), T(0), T(0), T(0)}};
    }
    /// this += scale * other.
    GSH_HD void add_scaled(const dual_quat& other, T scale) {
        const quat<T>&r = other.real, &d = other.dual;
        real += quat<T>{r.w * scale, r.x * scale, r.y * scale, r.z * scale};
        dual += quat<T>{d.w * scale, d.x * scale, d.y * scale, d.z * scale};
    }
};

/// The unit dual quaternion of a rigid map, real.w >= 0.
template <std::floating_point T>
[[nodiscard]] GSH_HD dual_quat<T> dual_quat_from_rigid(const Affine<T>& rigid) {
    const quat<T> q = quat_from_rotation(rigid.linear);
    const vec3<T> v(q.x, q.y, q.z), &t = rigid.translation;
    const vec3<T> d = (t * q.w + cross(t, v)) * T(0.5);
    return {q, {dot(t, v) * T(-0.5), d.x, d.y, d.z}};
}

/// Adjoint of dual_quat_from_rigid, given its result `value`: adds to dL_drigid.
///
/// A rotation matrix can only change along the tangent directions [ω]x R, so only that part of the gradient is defined.
/// The function adds ½ [τ]x R, where τ is the gradient with respect to ω. This equals the gradient of the function
/// composed with the nearest rotation (math/polar.hpp). It is exact for every chain in which the matrix stays a
/// rotation, as in forward kinematics.
template <std::floating_point T>
GSH_HD void dual_quat_from_rigid_backward(const Affine<T>& rigid, const dual_quat<T>& value,
                                          const dual_quat<T>& dL_dvalue, Affine<T>& dL_drigid) {
    const T half = T(0.5), w = value.real.w, gw = dL_dvalue.dual.w;
    const vec3<T> v(value.real.x, value.real.y, value.real.z), &t = rigid.translation;
    const vec3<T> g(dL_dvalue.dual.x, dL_dvalue.dual.y, dL_dvalue.dual.z);
    dL_drigid.translation += (g * w + cross(v, g) - v * gw) * half;
    const T dL_dw = dL_dvalue.real.w + half * dot(t, g);
    const vec3<T> dL_dv = vec3<T>(dL_dvalue.real.x, dL_dvalue.real.y, dL_dvalue.real.z) + (cross(g, t) - t * gw) * half;
    const vec3<T> half_tau = (dL_dv * w - v * dL_dw + cross(v, dL_dv)) * T(0.25); // from d(w, v) = ½ (0, ω) q
    const mat3<T>& R = rigid.linear;
    dL_drigid.linear += mat3<T>(cross(half_tau, R[0]), cross(half_tau, R[1]), cross(half_tau, R[2]));
}

/// The rigid map of a dual quaternion of any length, and its adjoint. If the real part has length zero, the map is the
/// identity and the gradient is zero.
///
/// Source  Kavan et al., "Skinning with Dual Quaternions", 2007, algorithm 1: b / |b.real|. The dual part need not be
///         orthogonal to the real part, because the translation uses only its orthogonal component.
template <Lane T>
class RigidFromDualQuat {
public:
    Affine<T> map;

    GSH_HD explicit RigidFromDualQuat(const dual_quat<T>& b) {
        const T squared = dot(b.real, b.real), zero = T(0);
        const MaskOf<T> regular = squared > T(1e-30);
        scale_ = select(regular, T(1) / sqrt(select(regular, squared, T(1))), zero);
        unit_ = {{b.real.w * scale_, b.real.x * scale_, b.real.y * scale_, b.real.z * scale_},
                 {b.dual.w * scale_, b.dual.x * scale_, b.dual.y * scale_, b.dual.z * scale_}};
        const vec3<T> v(unit_.real.x, unit_.real.y, unit_.real.z), e(unit_.dual.x, unit_.dual.y, unit_.dual.z);
        map.linear = rotation_matrix(unit_.real);
        map.translation = (e * unit_.real.w - v * unit_.dual.w + cross(v, e)) * T(2);
    }

    /// Adds to dL_db. Only the tangential part of dL_dmap.linear contributes, because R stays a rotation.
    GSH_HD void backward(const Affine<T>& dL_dmap, dual_quat<T>& dL_db) const {
        const quat<T>&n = unit_.real, &m = unit_.dual;
        const vec3<T> v(n.x, n.y, n.z), e(m.x, m.y, m.z), g = dL_dmap.translation * T(2);
        const vec3<T> dL_dv = cross(e, g) - g * m.w, dL_de = g * n.w + cross(g, v);
        quat<T> dL_dn{dot(e, g), dL_dv.x, dL_dv.y, dL_dv.z};
        rotation_matrix_backward(n, dL_dmap.linear, dL_dn);
        const quat<T> dL_dm{-dot(v, g), dL_de.x, dL_de.y, dL_de.z};
        const T along = dot(n, dL_dn) + dot(m, dL_dm); // both parts were divided by |b.real|
        dL_db.add_scaled({{dL_dn.w - n.w * along, dL_dn.x - n.x * along, dL_dn.y - n.y * along, dL_dn.z - n.z * along},
                          dL_dm}, scale_);
    }

private:
    T scale_; // 1 / |b.real|
    dual_quat<T> unit_;
};

/// The rigid map of a dual quaternion of any length.
template <Lane T>
[[nodiscard]] GSH_HD Affine<T> rigid_from_dual_quat(const dual_quat<T>& b) {
    return RigidFromDualQuat<T>(b).map;
}

/// Adjoint of rigid_from_dual_quat: adds to dL_db.
template <Lane T>
GSH_HD void rigid_from_dual_quat_backward(const dual_quat<T>& b, const Affine<T>& dL_dmap, dual_quat<T>& dL_db) {
    RigidFromDualQuat<T>(b).backward(dL_dmap, dL_db);
}

} // namespace gsh
