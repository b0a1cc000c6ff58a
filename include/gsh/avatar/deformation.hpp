// SPDX-License-Identifier: Apache-2.0
/// @file  Deformation policies: a Gaussian moves by the linear, polar or dual-quaternion blend of its bones.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/polar.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string_view>

namespace gsh {

/// How the bones determine the motion of a Gaussian.
enum class Deformation {
    linear,         ///< M = Σ w_i B_i moves mean, covariance and direction, including shear, as in the paper
    polar,          ///< M moves the mean; covariance and direction turn by the rotation nearest to M
    dual_quaternion ///< the normalised blend of the bones' dual quaternions, a rigid motion, moves everything
};
template <>
struct EnumNames<Deformation> {
    static constexpr std::array<std::string_view, 3> names{"linear", "polar", "dual_quaternion"};
};

/// normalise(L⁻¹ offset): a direction of the posed world in the canonical frame, by the true inverse.
///
/// The direction does not depend on the length, so L⁻¹ is replaced by sign(det L) times the adjugate, which is a
/// polynomial. Value and adjoint stay finite and exact however close L is to singular, as blends of opposed bones are.
/// In the degenerate case (L of rank one, or offset zero), the direction is the z axis with a zero gradient.
template <Lane T>
struct CanonicalDirection {
    vec3<T> r0, r1, r2; ///< rows of the adjugate of L
    T scale;            ///< sign(det) / |adj(L) offset|, or 0 in the degenerate case
    vec3<T> dir;

    GSH_HD CanonicalDirection(const mat3<T>& L, const vec3<T>& offset)
        : r0(cross(L[1], L[2])), r1(cross(L[2], L[0])), r2(cross(L[0], L[1])) {
        const vec3<T> v(dot(r0, offset), dot(r1, offset), dot(r2, offset));
        const T squared = dot(v, v), one = T(1), zero = T(0);
        const MaskOf<T> regular = squared > T(1e-30);
        const T sign = select(dot(L[0], r0) < zero, -one, one);
        scale = select(regular, sign / sqrt(select(regular, squared, one)), zero);
        dir = {v.x * scale, v.y * scale, select(regular, v.z * scale, one)};
    }

    /// Adds to dL_dL and dL_doffset; L and offset as given to the constructor.
    GSH_HD void backward(const mat3<T>& L, const vec3<T>& offset, const vec3<T>& dL_ddir, mat3<T>& dL_dL,
                         vec3<T>& dL_doffset) const {
        const vec3<T> g = (dL_ddir - dir * dot(dir, dL_ddir)) * scale; // with respect to adj(L) offset
        dL_doffset += r0 * g.x + r1 * g.y + r2 * g.z;
        // adj(L) offset holds the triple products offset·(L1 x L2), offset·(L2 x L0), offset·(L0 x L1).
        dL_dL[0] += cross(offset, L[2] * g.y - L[1] * g.z);
        dL_dL[1] += cross(offset, L[0] * g.z - L[2] * g.x);
        dL_dL[2] += cross(offset, L[1] * g.x - L[0] * g.y);
    }
};

/// The same for a rotation R, whose inverse is its transpose: normalise(Rᵀ offset).
template <Lane T>
struct RotatedDirection {
    T scale; ///< 1 / |offset|, or 0 in the degenerate case
    vec3<T> dir;

    GSH_HD RotatedDirection(const mat3<T>& R, const vec3<T>& offset) {
        const T squared = dot(offset, offset), one = T(1);
        const MaskOf<T> regular = squared > T(1e-30);
        scale = select(regular, one / sqrt(select(regular, squared, one)), T(0));
        const vec3<T> v = transposed_times(R, offset);
        dir = {v.x * scale, v.y * scale, select(regular, v.z * scale, one)};
    }

    /// Adds to dL_dR and dL_doffset; R and offset as given to the constructor.
    GSH_HD void backward(const mat3<T>& R, const vec3<T>& offset, const vec3<T>& dL_ddir, mat3<T>& dL_dR,
                         vec3<T>& dL_doffset) const {
        const vec3<T> g = (dL_ddir - dir * dot(dir, dL_ddir)) * scale;
        dL_doffset += R * g;
        dL_dR += outer(offset, g);
    }
};

/// A policy of skinning. Its bones and their blends have the type Bone<T>, an Affine or a dual quaternion. A
/// Transform<T> is made from a blend and has:
///
///     map()   the affine map that moves the mean
///     turn()  the matrix that transforms covariance and direction
///
/// The Gradient of a Transform is made from the destination dL_dblend and has the same two members. complete() adds
/// what the Gradient has collected to the destination.
template <class D>
concept DeformationPolicy = requires(const typename D::template Transform<float>& transform,
                                     typename D::template Transform<float>::Gradient& gradient,
                                     typename D::template Bone<float>& dL_dblend) {
    { transform.map() } -> std::convertible_to<const Affine<float>&>;
    { transform.turn() } -> std::convertible_to<const mat3<float>&>;
    { gradient.map() } -> std::same_as<Affine<float>&>;
    { gradient.turn() } -> std::same_as<mat3<float>&>;
    transform.complete(gradient, dL_dblend);
    typename D::template Direction<float>;
};

/// M = Σ w_i B_i for everything, as in the paper. M₃ is not made orthonormal: it shears and shrinks where bones differ.
struct LinearBlend {
    static constexpr Deformation value = Deformation::linear;
    template <class T>
    using Bone = Affine<T>;
    template <Lane T>
    using Direction = CanonicalDirection<T>;

    template <Lane T>
    class Transform {
    public:
        GSH_HD explicit Transform(const Affine<T>& M) : M_(M) {}
        [[nodiscard]] GSH_HD const Affine<T>& map() const { return M_; }
        [[nodiscard]] GSH_HD const mat3<T>& turn() const { return M_.linear; }

        class Gradient {
        public:
            GSH_HD explicit Gradient(Affine<T>& dL_dM) : dL_dM_(dL_dM) {}
            [[nodiscard]] GSH_HD Affine<T>& map() { return dL_dM_; }
            [[nodiscard]] GSH_HD mat3<T>& turn() { return dL_dM_.linear; }

        private:
            Affine<T>& dL_dM_;
        };
        GSH_HD void complete(Gradient&, Affine<T>&) const {} // Gradient already refers to dL_dM

    private:
        const Affine<T>& M_;
    };
};

/// M = Σ w_i B_i for the mean, the rotation nearest to M₃ for covariance and direction. Gaussians keep their size, and
/// their means are those of linear blending.
struct PolarBlend {
    static constexpr Deformation value = Deformation::polar;
    template <class T>
    using Bone = Affine<T>;
    template <Lane T>
    using Direction = RotatedDirection<T>;

    template <Lane T>
    class Transform {
    public:
        GSH_HD explicit Transform(const Affine<T>& M) : M_(M), rotation_(M.linear) {}
        [[nodiscard]] GSH_HD const Affine<T>& map() const { return M_; }
        [[nodiscard]] GSH_HD const mat3<T>& turn() const { return rotation_.R; }

        class Gradient {
        public:
            GSH_HD explicit Gradient(Affine<T>& dL_dM) : dL_dM_(dL_dM), dL_dR_(T(0)) {}
            [[nodiscard]] GSH_HD Affine<T>& map() { return dL_dM_; }
            [[nodiscard]] GSH_HD mat3<T>& turn() { return dL_dR_; }

        private:
            Affine<T>& dL_dM_;
            mat3<T> dL_dR_;
        };
        GSH_HD void complete(Gradient& gradient, Affine<T>& dL_dM) const {
            rotation_.backward(gradient.turn(), dL_dM.linear);
        }

    private:
        const Affine<T>& M_;
        PolarRotation<T> rotation_;
    };
};

/// The normalised sum of the bones as unit dual quaternions, each with the sign that is nearer to the heaviest: a rigid
/// motion for everything. Bones must be rigid; a scale in one of them is lost.
///
/// Source  Kavan et al., "Skinning with Dual Quaternions", 2007.
struct DualQuaternionBlend {
    static constexpr Deformation value = Deformation::dual_quaternion;
    template <class T>
    using Bone = dual_quat<T>;
    template <Lane T>
    using Direction = RotatedDirection<T>;

    template <Lane T>
    class Transform {
    public:
        GSH_HD explicit Transform(const dual_quat<T>& b) : rigid_(b) {}
        [[nodiscard]] GSH_HD const Affine<T>& map() const { return rigid_.map; }
        [[nodiscard]] GSH_HD const mat3<T>& turn() const { return rigid_.map.linear; }

        class Gradient {
        public:
            GSH_HD explicit Gradient(dual_quat<T>&) : dL_dmap_(Affine<T>::zero()) {}
            [[nodiscard]] GSH_HD Affine<T>& map() { return dL_dmap_; }
            [[nodiscard]] GSH_HD mat3<T>& turn() { return dL_dmap_.linear; }

        private:
            Affine<T> dL_dmap_;
        };
        GSH_HD void complete(Gradient& gradient, dual_quat<T>& dL_db) const { rigid_.backward(gradient.map(), dL_db); }

    private:
        RigidFromDualQuat<T> rigid_;
    };
};

static_assert(DeformationPolicy<LinearBlend> && DeformationPolicy<PolarBlend> &&
              DeformationPolicy<DualQuaternionBlend>);

/// The deformation that a setting names (SkinnedSplatsParams), in the place of a policy.
struct NamedDeformation {};

namespace detail {

/// Calls f with the policy of that name: turns a value known at run time into a type.
template <class F>
void with_deformation(Deformation deformation, const F& f) {
    switch (deformation) {
    case Deformation::linear: return f(LinearBlend());
    case Deformation::polar: return f(PolarBlend());
    case Deformation::dual_quaternion: return f(DualQuaternionBlend());
    }
}

/// Calls f with the policy D or, for NamedDeformation, with the one of that name.
template <class D, class F>
void with_deformation_policy(Deformation deformation, const F& f) {
    if constexpr (std::same_as<D, NamedDeformation>) with_deformation(deformation, f);
    else f(D());
}

template <class T>
struct BonesAsDualQuats {
    Span<const Affine<T>> bones;
    Span<dual_quat<T>> dual_quats;

    GSH_HD void operator()(std::size_t j) const { dual_quats[j] = dual_quat_from_rigid(bones[j]); }
};

template <class T>
struct BonesAsDualQuatsBackward {
    Span<const Affine<T>> bones;
    Span<const dual_quat<T>> dual_quats, dL_ddual_quats;
    Span<Affine<T>> dL_dbones;

    GSH_HD void operator()(std::size_t j) const {
        dual_quat_from_rigid_backward(bones[j], dual_quats[j], dL_ddual_quats[j], dL_dbones[j]);
    }
};

} // namespace detail

} // namespace gsh
