// SPDX-License-Identifier: Apache-2.0
/// @file  From canonical Gaussians to posed splats: position, covariance and colour under a blend of bones.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace gsh {

/// Private storage of a backend in backward, for instance partial sums over bones. Each backend specialises it beside
/// its overloads.
template <Backend B, std::floating_point T>
struct SkinnedSplatsScratch {
    static_assert(detail::overload_is_included<B>, "SkinnedSplats: include its backend's overloads, "
                                                   "<gsh/avatar/cpu/skinned_splats.hpp> or <gsh/cpu.hpp>");
};

/// The settings of SkinnedSplats.
struct SkinnedSplatsParams {
    ColorClamp clamping = ColorClamp::both;        ///< the colours of a photograph lie in [0, 1]
    Deformation deformation = Deformation::linear; ///< the paper's; for NamedDeformation
};

/// Working storage of both passes, kept from step to step.
template <Backend B, std::floating_point T = float>
struct SkinnedSplatsCache {
    // Used if bones are blended as dual quaternions:
    typename B::template Buffer<dual_quat<T>> dual_bones, dL_ddual_bones; // [J]
    SkinnedSplatsScratch<B, T> scratch;                                   // the backend's own
};

namespace detail {

template <class T>
void check_skinned(std::string_view where, std::string_view argument, const SkinnedView<T>& view, std::size_t count,
                   std::size_t basis_count, bool gradient) {
    const auto check = [&](const char* name, std::size_t found, std::size_t expected, std::string_view hint) {
        if (found == expected || (gradient && found == 0)) return; // names are made for errors alone
        check_size(where, std::string(argument).append(".").append(name), found, expected, hint);
    };
    const std::size_t stride = view.sh_stride ? view.sh_stride : basis_count;
    check_value(stride >= basis_count, where, "sh_stride is smaller than the number of coefficients of this degree");
    check("means", view.means.size(), count, "one mean per Gaussian");
    check("quats", view.quats.size(), count, "one quaternion per Gaussian");
    check("log_scales", view.log_scales.size(), count, "three log-scales per Gaussian");
    check("opacity_logits", view.opacity_logits.size(), count, "one opacity logit per Gaussian");
    // A strided view may end after the coefficients of its last Gaussian.
    const std::size_t shortest = count ? (count - 1) * stride + basis_count : 0;
    if (view.sh.size() < shortest || view.sh.size() > count * stride)
        check("sh", view.sh.size(), count * stride, "(Degree + 1)² RGB coefficients per Gaussian, or sh_stride");
    if (!view.ao.empty()) check("ao", view.ao.size(), count, "one factor per Gaussian, or none");
    if (!gradient) check_skin(where, view.weights, count);
}

template <class T>
void check_posed(std::string_view where, std::string_view argument, const SplatView<T>& splats, std::size_t count) {
    const auto check = [&](const char* name, std::size_t found) {
        if (found != count) check_size(where, std::string(argument).append(".").append(name), found, count);
    };
    check("means", splats.means.size());
    check("covariances", splats.covariances.size());
    check("opacities", splats.opacities.size());
    check("colors", splats.colors.size());
}

/// The bones in the form that policy D blends.
template <class D, Backend B, class T>
[[nodiscard]] Span<const typename D::template Bone<T>> bones_of(B& backend, Span<const Affine<T>> bones,
                                                                SkinnedSplatsCache<B, T>& cache) {
    if constexpr (std::is_same_v<typename D::template Bone<T>, Affine<T>>) {
        return bones;
    } else {
        cache.dual_bones.resize(bones.size());
        backend.for_each(bones.size(), BonesAsDualQuats<T>{bones, cache.dual_bones});
        return cache.dual_bones;
    }
}

/// Memory for the gradients of these bones: dL_dbones itself, or a zeroed array of the same length in the cache.
template <class D, Backend B, class T>
[[nodiscard]] Span<typename D::template Bone<T>> bone_gradients_of(B& backend, Span<Affine<T>> dL_dbones,
                                                                   SkinnedSplatsCache<B, T>& cache) {
    if constexpr (std::is_same_v<typename D::template Bone<T>, Affine<T>>) {
        return dL_dbones;
    } else {
        cache.dL_ddual_bones.resize(dL_dbones.size());
        backend.fill(view_as<T>(Span<dual_quat<T>>(cache.dL_ddual_bones)), T(0));
        return cache.dL_ddual_bones;
    }
}

} // namespace detail

/// Fallback for backends without an overload: each index is one Gaussian.
template <Backend B, int Degree, class T, class D>
void skinned_splats_pose(B& backend, const detail::SkinnedSplatForward<Degree, T, D>& element) {
    static_assert(!CpuBackend<B>, "SkinnedSplats: include its backend's overloads, "
                                  "<gsh/avatar/cpu/skinned_splats.hpp> or <gsh/cpu.hpp>");
    backend.for_each(element.input.gaussians.size(), element);
}

/// Fallback without the backend's overloads, which the sums over bones require: fails to compile, and names the header
/// to include.
template <Backend B, class... Arguments>
void skinned_splats_accumulate(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>, "SkinnedSplats: include its backend's overloads, "
                                                   "<gsh/avatar/cpu/skinned_splats.hpp> or <gsh/cpu.hpp>");
}

/// Poses the Gaussians of an avatar. Both passes blend the bones anew for each Gaussian, which reads less memory than a
/// stored blend. D is a DeformationPolicy, or the settings name one of gsh's.
///
/// Shapes  gaussians [N], bones [J], splats [N]; center [3].
/// Frame   bones: world from canonical, rigid for Deformation::dual_quaternion; center: of the camera, in the world
///         (Camera::center()).
/// Errors  ShapeError where a size does not match.
template <Backend B, int Degree, std::floating_point T = float, class D = NamedDeformation>
    requires std::same_as<D, NamedDeformation> || DeformationPolicy<D>
class SkinnedSplats {
public:
    using Params = SkinnedSplatsParams;
    using Cache = SkinnedSplatsCache<B, T>;

    explicit SkinnedSplats(B& backend, const Params& params = {}) : backend_(&backend), params_(params) {}

    [[nodiscard]] const Params& params() const { return params_; }

    /// Overwrites the splats. Only dual quaternions use the cache: eight numbers per bone.
    void forward(const SkinnedView<const T>& gaussians, Span<const Affine<T>> bones, const Deferred<vec3<T>>& center,
                 const SplatView<T>& splats, Cache& cache) const {
        constexpr auto where = "SkinnedSplats::forward";
        const std::size_t count = gaussians.size();
        detail::check_skinned(where, "gaussians", gaussians, count, basis_count, false);
        detail::check_posed(where, "splats", splats, count);
        check_memory(*backend_, where, "gaussians", gaussians);
        check_memory(*backend_, where, "bones", bones);
        check_memory(*backend_, where, "splats", splats);
        detail::with_deformation_policy<D>(params_.deformation, [&]<class Policy>(Policy) {
            const auto own = detail::bones_of<Policy>(*backend_, bones, cache);
            skinned_splats_pose(*backend_, detail::SkinnedSplatForward<Degree, T, Policy>{
                                               {gaussians, own, center, stride(gaussians)}, params_.clamping, splats});
        });
    }

    /// Adjoint of forward: adds to the non-empty attributes of dL_dgaussians and, where given, to dL_dbones [J] and to
    /// dL_dcenter, one vector in the backend's memory. With dual quaternions, the gradient of the nine numbers of a
    /// bone's rotation is its component along turns (dual_quat_from_rigid_backward).
    void backward(const SkinnedView<const T>& gaussians, Span<const Affine<T>> bones, const Deferred<vec3<T>>& center,
                  const SplatView<const T>& dL_dsplats, Cache& cache, const SkinnedView<T>& dL_dgaussians,
                  Span<Affine<T>> dL_dbones = {}, Span<vec3<T>> dL_dcenter = {}) const {
        constexpr auto where = "SkinnedSplats::backward";
        const std::size_t count = gaussians.size();
        detail::check_skinned(where, "gaussians", gaussians, count, basis_count, false);
        detail::check_posed(where, "dL_dsplats", dL_dsplats, count);
        detail::check_skinned(where, "dL_dgaussians", dL_dgaussians, count, basis_count, true);
        if (!dL_dbones.empty()) check_size(where, "dL_dbones", dL_dbones.size(), bones.size(), "one per bone, or none");
        if (!dL_dcenter.empty()) check_size(where, "dL_dcenter", dL_dcenter.size(), 1, "one vector, or none");
        check_memory(*backend_, where, "gaussians", gaussians);
        check_memory(*backend_, where, "bones", bones);
        check_memory(*backend_, where, "dL_dsplats", dL_dsplats);
        check_memory(*backend_, where, "dL_dgaussians", dL_dgaussians);
        check_memory(*backend_, where, "dL_dbones", dL_dbones);
        check_memory(*backend_, where, "dL_dcenter", dL_dcenter);
        detail::with_deformation_policy<D>(params_.deformation, [&]<class Policy>(Policy) {
            const auto own = detail::bones_of<Policy>(*backend_, bones, cache);
            const auto dL_down = detail::bone_gradients_of<Policy>(*backend_, dL_dbones, cache);
            skinned_splats_accumulate(
                *backend_,
                detail::SkinnedSplatBackward<Degree, T, Policy>{{gaussians, own, center, stride(gaussians)},
                                                                params_.clamping,
                                                                dL_dsplats,
                                                                dL_dgaussians,
                                                                stride(dL_dgaussians)},
                dL_down, dL_dcenter, cache.scratch);
            if constexpr (!std::is_same_v<typename Policy::template Bone<T>, Affine<T>>)
                backend_->for_each(dL_dbones.size(),
                                   detail::BonesAsDualQuatsBackward<T>{bones, own, dL_down, dL_dbones});
        });
    }

private:
    static constexpr std::size_t basis_count = SkinnedGaussian<Degree>::basis_count;
    static std::size_t stride(const auto& view) { return view.sh_stride ? view.sh_stride : basis_count; }

    B* backend_;
    Params params_;
};

} // namespace gsh
