// SPDX-License-Identifier: Apache-2.0
/// @file  One Gaussian of an avatar: posing and its adjoint, and views of the arrays of attributes.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <string_view>
#include <type_traits>

namespace gsh {

/// One Gaussian of an avatar, posed by a blend of bones.
///
/// M is the affine map and A the 3x3 matrix that the policy D derives from the blend (for LinearBlend A = M₃, not made
/// orthonormal): mean = M x, covariance = A R S Sᵀ Rᵀ Aᵀ, opacity = sigmoid(o), and the colour seen along
/// d = normalise(A⁻¹ (M x - center)), a direction in the frame of the coefficients.
///
/// Shapes  sh [basis_count] RGB.
/// Frame   x, q, sh canonical; mean, covariance, center in the world.
/// Units   metres, logarithm of metres; ao a factor on the colour.
/// Errors  none, this is kernel code; a singular A gives a flat covariance and a finite direction.
/// Source  the equations are those of the paper's deformation section. The Animatable 3D Gaussian code (Liu et al.,
///         2024) has the transpose of A in place of the inverse; the adjoint here has every term.
template <int Degree, DeformationPolicy D = LinearBlend>
struct SkinnedGaussian {
    static constexpr int basis_count = sh_basis_count(Degree);
    template <Lane T>
    using Blend = typename D::template Bone<T>;

    template <Lane T>
    struct Input {
        vec3<T> mean;
        quat<T> q;
        vec3<T> log_scale;
        T opacity_logit;
        const vec3<T>* sh;
        T ao;
        Blend<T> blend;
        vec3<T> center;
    };
    template <Lane T>
    using Output = Splat<T>;
    /// Gradient with respect to an Input; sh points to the array to which its part is added.
    template <Lane T>
    struct Gradient {
        vec3<T> mean = vec3<T>(T(0));
        quat<T> q = {T(0), T(0), T(0), T(0)};
        vec3<T> log_scale = vec3<T>(T(0));
        T opacity_logit = T(0);
        vec3<T>* sh = nullptr;
        T ao = T(0);
        Blend<T> blend = Blend<T>::zero();
        vec3<T> center = vec3<T>(T(0));
    };

    template <Lane T>
    [[nodiscard]] GSH_HD static Output<T> forward(const Input<T>& in, ColorClamp clamping) {
        const typename D::template Transform<T> transform(in.blend);
        const vec3<T> mean = transform.map()(in.mean);
        const typename D::template Direction<T> view(transform.turn(), mean - in.center);
        return {mean, gram(transform.turn() * covariance_factor(in.q, in.log_scale)), sigmoid(in.opacity_logit),
                shade<Degree>(in.sh, view.dir, in.ao, clamping)};
    }

    /// Adds to dL_din.
    template <Lane T>
    GSH_HD static void backward(const Input<T>& in, ColorClamp clamping, const Output<T>& dL_dout,
                                Gradient<T>& dL_din) {
        const typename D::template Transform<T> transform(in.blend);
        typename D::template Transform<T>::Gradient dL_dtransform(dL_din.blend);
        const mat3<T>& A = transform.turn();
        const vec3<T> offset = transform.map()(in.mean) - in.center;
        const typename D::template Direction<T> view(A, offset);
        vec3<T> dL_ddir(T(0)), dL_doffset(T(0));
        shade_backward<Degree>(in.sh, view.dir, in.ao, clamping, dL_dout.color, dL_din.sh, dL_ddir, dL_din.ao);
        view.backward(A, offset, dL_ddir, dL_dtransform.turn(), dL_doffset);
        dL_din.center -= dL_doffset;
        apply_backward(transform.map(), in.mean, dL_dout.mean + dL_doffset, dL_dtransform.map(), dL_din.mean);

        const detail::CovarianceFactor<T> factor(in.q, in.log_scale);
        const mat3<T> dL_dposed = full_gradient(dL_dout.covariance) * (A * factor.F) * T(2); // of A F
        dL_dtransform.turn() += dL_dposed * transpose(factor.F);
        factor.backward(in.q, transpose(A) * dL_dposed, dL_din.q, dL_din.log_scale);
        sigmoid_backward(sigmoid(in.opacity_logit), dL_dout.opacity, dL_din.opacity_logit);
        transform.complete(dL_dtransform, dL_din.blend);
    }
};

/// Views of an avatar's N Gaussians; `SkinnedView<const T>` is an input, `SkinnedView<T>` a gradient. An attribute of a
/// gradient may be empty; it is then not computed. Weights are fixed and have no gradient.
///
/// Shapes  means, quats, log_scales, opacity_logits [N]; sh [N, sh_stride] RGB, of which the first (Degree+1)² are
///         used, so that the output of a network can be viewed in place; ao [N], or empty for 1.
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

/// Throws MemoryError unless the backend can access every attribute.
template <Backend B, class T>
void check_memory(const B& backend, std::string_view where, std::string_view argument, const SkinnedView<T>& view) {
    check_memory(backend, where, argument, view.means, "means");
    check_memory(backend, where, argument, view.quats, "quats");
    check_memory(backend, where, argument, view.log_scales, "log_scales");
    check_memory(backend, where, argument, view.opacity_logits, "opacity_logits");
    check_memory(backend, where, argument, view.sh, "sh");
    check_memory(backend, where, argument, view.ao, "ao");
    check_memory(backend, where, argument, view.weights.joints, "weights.joints");
    check_memory(backend, where, argument, view.weights.weights, "weights.weights");
}

namespace detail {

template <int Degree, class T, class D = LinearBlend>
struct SkinnedInput {
    using Bone = typename D::template Bone<T>;

    SkinnedView<const T> gaussians;
    Span<const Bone> bones;
    Deferred<vec3<T>> center;
    std::size_t sh_stride;

    [[nodiscard]] GSH_HD typename SkinnedGaussian<Degree, D>::template Input<T> operator[](std::size_t i) const {
        return with_sh(i, gaussians.sh.data() + i * sh_stride);
    }
    /// The same with the coefficients at another place.
    [[nodiscard]] GSH_HD typename SkinnedGaussian<Degree, D>::template Input<T> with_sh(std::size_t i,
                                                                                        const vec3<T>* sh) const {
        return {gaussians.means[i],
                gaussians.quats[i],
                gaussians.log_scales[i],
                gaussians.opacity_logits[i],
                sh,
                gaussians.ao.empty() ? T(1) : gaussians.ao[i],
                blend(gaussians.weights, i, bones),
                center()};
    }
};

template <int Degree, class T, class D = LinearBlend>
struct SkinnedSplatForward {
    SkinnedInput<Degree, T, D> input;
    ColorClamp clamping;
    SplatView<T> splats;

    GSH_HD void operator()(std::size_t i) const {
        splats.set(i, SkinnedGaussian<Degree, D>::forward(input[i], clamping));
    }
};

/// The adjoint of one Gaussian: adds to its own attributes, and to bones and a centre that the caller provides.
template <int Degree, class T, class D = LinearBlend>
struct SkinnedSplatBackward {
    SkinnedInput<Degree, T, D> input;
    ColorClamp clamping;
    SplatView<const T> dL_dsplats;
    SkinnedView<T> dL_dgaussians;
    std::size_t dL_dsh_stride;

    GSH_HD void operator()(std::size_t i, Span<typename D::template Bone<T>> dL_dbones, vec3<T>& dL_dcenter) const {
        if (unseen(i)) return;
        typename SkinnedGaussian<Degree, D>::template Gradient<T> gradient;
        vec3<T> unused[SkinnedGaussian<Degree, D>::basis_count];
        gradient.sh = dL_dgaussians.sh.empty() ? unused : dL_dgaussians.sh.data() + i * dL_dsh_stride;
        if (dL_dgaussians.sh.empty())
            for (vec3<T>& value : unused) value = vec3<T>(T(0));
        SkinnedGaussian<Degree, D>::backward(input[i], clamping, dL_dsplats[i], gradient);
        add(i, gradient);
        if (!dL_dbones.empty()) blend_backward(input.gaussians.weights, i, input.bones, gradient.blend, dL_dbones);
        dL_dcenter += gradient.center;
    }

    /// Adds to the Gaussian's own attributes, but for the coefficients.
    GSH_HD void add(std::size_t i, const typename SkinnedGaussian<Degree, D>::template Gradient<T>& gradient) const {
        add_attributes(gradient, dL_dgaussians, i);
        if (!dL_dgaussians.ao.empty()) dL_dgaussians.ao[i] += gradient.ao;
    }

    [[nodiscard]] GSH_HD bool unseen(std::size_t i) const { return is_zero(dL_dsplats, i); }
};

} // namespace detail

} // namespace gsh
