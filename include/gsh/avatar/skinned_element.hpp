// SPDX-License-Identifier: Apache-2.0
/// @file  One Gaussian of an avatar: what a bone transform makes of it, the adjoint, and the arrays that it comes from.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <type_traits>

namespace gsh {

/// normalise(L⁻¹ offset): a direction of the posed world as the canonical frame sees it, by the true inverse.
///
/// Length cancels in the direction, so L⁻¹ is replaced by sign(det L) times the adjugate, which is a polynomial:
/// value and adjoint stay finite and exact however close L is to singular, as blends of opposed bones are. Where
/// nothing is left to normalise (L of rank one, or offset zero) the direction is the z axis with a zero gradient.
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

/// One Gaussian of an avatar: what a bone transform M makes of it.
///
/// mean = M x, covariance = M₃ R S Sᵀ Rᵀ M₃ᵀ, opacity = sigmoid(o), and the colour seen along
/// d = normalise(M₃⁻¹ (M x - center)) in the frame that the coefficients live in; M₃ is not made orthonormal.
///
/// Shapes  sh [basis_count] RGB.
/// Frame   x, q, sh canonical; mean, covariance, center in the world.
/// Units   metres, logarithm of metres; ao a factor on the colour.
/// Errors  none, this is kernel code; a singular M gives a flat covariance and a finite direction.
/// Source  the equations are those of the paper's deformation section; with the inverse where the Animatable 3D
///         Gaussian code (Liu et al., 2024) takes the transpose, and with every term of the adjoint.
template <int Degree>
struct SkinnedGaussian {
    static constexpr int basis_count = sh_basis_count(Degree);

    template <Lane T>
    struct Input {
        vec3<T> mean;
        quat<T> q;
        vec3<T> log_scale;
        T opacity_logit;
        const vec3<T>* sh;
        T ao;
        Affine<T> M;
        vec3<T> center;
    };
    template <Lane T>
    struct Output {
        vec3<T> mean;
        sym3<T> covariance;
        T opacity;
        vec3<T> color;
    };
    /// Gradient with respect to an Input; sh points to where its part is to be added.
    template <Lane T>
    struct Gradient {
        vec3<T> mean = vec3<T>(T(0));
        quat<T> q = {T(0), T(0), T(0), T(0)};
        vec3<T> log_scale = vec3<T>(T(0));
        T opacity_logit = T(0);
        vec3<T>* sh = nullptr;
        T ao = T(0);
        Affine<T> M = Affine<T>::zero();
        vec3<T> center = vec3<T>(T(0));
    };

    template <Lane T>
    [[nodiscard]] GSH_HD static Output<T> forward(const Input<T>& in, ColorClamp clamping) {
        const vec3<T> mean = in.M(in.mean);
        const CanonicalDirection<T> view(in.M.linear, mean - in.center);
        return {mean, gram(in.M.linear * covariance_factor(in.q, in.log_scale)), sigmoid(in.opacity_logit),
                shade<Degree>(in.sh, view.dir, in.ao, clamping)};
    }

    /// Adds to dL_din.
    template <Lane T>
    GSH_HD static void backward(const Input<T>& in, ColorClamp clamping, const Output<T>& dL_dout,
                                Gradient<T>& dL_din) {
        const vec3<T> offset = in.M(in.mean) - in.center;
        const CanonicalDirection<T> view(in.M.linear, offset);
        vec3<T> dL_ddir(T(0)), dL_doffset(T(0));
        shade_backward<Degree>(in.sh, view.dir, in.ao, clamping, dL_dout.color, dL_din.sh, dL_ddir, dL_din.ao);
        view.backward(in.M.linear, offset, dL_ddir, dL_din.M.linear, dL_doffset);
        dL_din.center -= dL_doffset;
        apply_backward(in.M, in.mean, dL_dout.mean + dL_doffset, dL_din.M, dL_din.mean);

        const detail::CovarianceFactor<T> factor(in.q, in.log_scale);
        const mat3<T> dL_dposed = full_gradient(dL_dout.covariance) * (in.M.linear * factor.F) * T(2); // of M₃ F
        dL_din.M.linear += dL_dposed * transpose(factor.F);
        factor.backward(in.q, transpose(in.M.linear) * dL_dposed, dL_din.q, dL_din.log_scale);
        sigmoid_backward(sigmoid(in.opacity_logit), dL_dout.opacity, dL_din.opacity_logit);
    }
};

/// Views of an avatar's N Gaussians; `SkinnedView<const T>` is an input, `SkinnedView<T>` a gradient. In a gradient an
/// attribute may be left empty: nobody asks for it, nothing is written. Weights are fixed and have no gradient.
///
/// Shapes  means, quats, log_scales, opacity_logits [N]; sh [N, sh_stride] RGB, of which the first (Degree+1)² count,
///         so that coefficients may stay where a network wrote them; ao [N], or empty for 1.
template <class T>
struct SkinnedView {
    using Scalar = std::remove_const_t<T>;
    template <class U>
    using Like = std::conditional_t<std::is_const_v<T>, const U, U>;

    Span<Like<vec3<Scalar>>> means = {};
    Span<Like<quat<Scalar>>> quats = {};
    Span<Like<vec3<Scalar>>> log_scales = {};
    Span<T> opacity_logits = {};
    Span<Like<vec3<Scalar>>> sh = {};
    Span<T> ao = {};
    SkinWeights<Scalar> weights = {};
    std::size_t sh_stride = 0; ///< vectors from one Gaussian's coefficients to the next; 0 for (Degree+1)²

    [[nodiscard]] GSH_HD std::size_t size() const { return means.size(); }
};

/// Scratch of skinned_splats_backward; keep it from step to step.
template <Backend B, std::floating_point T = float>
struct SkinnedSplatsWorkspace {
    typename B::template Buffer<Affine<T>> dL_dbones; // [chunks, J]
    typename B::template Buffer<vec3<T>> dL_dcenters; // [chunks]
};

namespace detail {

template <int Degree, class T>
struct SkinnedInput {
    SkinnedView<const T> gaussians;
    Span<const Affine<T>> bones;
    vec3<T> center;
    std::size_t sh_stride;

    [[nodiscard]] GSH_HD typename SkinnedGaussian<Degree>::template Input<T> operator[](std::size_t i) const {
        return {gaussians.means[i], gaussians.quats[i], gaussians.log_scales[i], gaussians.opacity_logits[i],
                gaussians.sh.data() + i * sh_stride, gaussians.ao.empty() ? T(1) : gaussians.ao[i],
                blend(gaussians.weights, i, bones), center};
    }
};

template <int Degree, class T>
struct SkinnedSplatForward {
    SkinnedInput<Degree, T> input;
    ColorClamp clamping;
    SplatView<T> splats;

    GSH_HD void operator()(std::size_t i) const {
        const auto out = SkinnedGaussian<Degree>::forward(input[i], clamping);
        splats.means[i] = out.mean;
        splats.covariances[i] = out.covariance;
        splats.opacities[i] = out.opacity;
        splats.colors[i] = out.color;
    }
};

/// The adjoint of one Gaussian: adds to its own attributes, and to bones and a centre that the caller owns.
template <int Degree, class T>
struct SkinnedSplatBackward {
    SkinnedInput<Degree, T> input;
    ColorClamp clamping;
    SplatView<const T> dL_dsplats;
    SkinnedView<T> dL_dgaussians;
    std::size_t dL_dsh_stride;

    GSH_HD void operator()(std::size_t i, Span<Affine<T>> dL_dbones, vec3<T>& dL_dcenter) const {
        if (unseen(i)) return;
        typename SkinnedGaussian<Degree>::template Gradient<T> gradient;
        vec3<T> unused[SkinnedGaussian<Degree>::basis_count];
        gradient.sh = dL_dgaussians.sh.empty() ? unused : dL_dgaussians.sh.data() + i * dL_dsh_stride;
        if (dL_dgaussians.sh.empty())
            for (vec3<T>& value : unused) value = vec3<T>(T(0));
        SkinnedGaussian<Degree>::backward(input[i], clamping,
                                          {dL_dsplats.means[i], dL_dsplats.covariances[i], dL_dsplats.opacities[i],
                                           dL_dsplats.colors[i]},
                                          gradient);
        if (!dL_dgaussians.means.empty()) dL_dgaussians.means[i] += gradient.mean;
        if (!dL_dgaussians.quats.empty()) dL_dgaussians.quats[i] += gradient.q;
        if (!dL_dgaussians.log_scales.empty()) dL_dgaussians.log_scales[i] += gradient.log_scale;
        if (!dL_dgaussians.opacity_logits.empty()) dL_dgaussians.opacity_logits[i] += gradient.opacity_logit;
        if (!dL_dgaussians.ao.empty()) dL_dgaussians.ao[i] += gradient.ao;
        if (!dL_dbones.empty()) blend_backward(input.gaussians.weights, i, gradient.M, dL_dbones);
        dL_dcenter += gradient.center;
    }

    /// The adjoint is linear: a Gaussian that no pixel saw, one in two of a body, has nothing to add.
    [[nodiscard]] GSH_HD bool unseen(std::size_t i) const {
        const vec3<T>&mean = dL_dsplats.means[i], &color = dL_dsplats.colors[i];
        const sym3<T>& cov = dL_dsplats.covariances[i];
        return dL_dsplats.opacities[i] == T(0) && mean.x == T(0) && mean.y == T(0) && mean.z == T(0) &&
               color.x == T(0) && color.y == T(0) && color.z == T(0) && cov.xx == T(0) && cov.xy == T(0) &&
               cov.xz == T(0) && cov.yy == T(0) && cov.yz == T(0) && cov.zz == T(0);
    }
};

} // namespace detail

} // namespace gsh
