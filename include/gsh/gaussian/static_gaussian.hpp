// SPDX-License-Identifier: Apache-2.0
/// @file  Turns a static 3DGS scene into splats: activations, covariance, and the colour seen from a camera centre.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/sum.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>

namespace gsh {

/// The unit vector from the camera's centre to a mean. For a Gaussian at the centre, which is never visible, the result
/// is the z axis instead of NaN.
template <Lane T>
[[nodiscard]] GSH_HD vec3<T> view_direction(const vec3<T>& mean, const vec3<T>& center) {
    const vec3<T> offset = mean - center;
    const T squared = dot(offset, offset);
    const MaskOf<T> apart = squared > T(0);
    const T scale = T(1) / sqrt(select(apart, squared, T(1)));
    return {offset.x * scale, offset.y * scale, select(apart, offset.z * scale, T(1))};
}

/// Adjoint of view_direction with respect to the offset mean - center: adds to dL_doffset.
template <Lane T>
GSH_HD void view_direction_backward(const vec3<T>& mean, const vec3<T>& center, const vec3<T>& dL_ddir,
                                    vec3<T>& dL_doffset) {
    const vec3<T> offset = mean - center, dir = view_direction(mean, center);
    const T squared = dot(offset, offset);
    const T scale = T(1) / sqrt(select(squared > T(0), squared, T(1)));
    dL_doffset += (dL_ddir - dir * dot(dir, dL_ddir)) * scale;
}

namespace detail {

template <int Degree, class T>
struct StaticSplatForward {
    GaussiansView<const T> gaussians;
    Deferred<vec3<T>> center;
    ColorClamp clamping;
    SplatView<T> splats;

    GSH_HD void operator()(std::size_t i) const {
        const vec3<T>* sh = gaussians.sh.data() + i * static_cast<std::size_t>(sh_basis_count(Degree));
        const vec3<T> mean = gaussians.means[i];
        splats.means[i] = mean;
        splats.covariances[i] = covariance(gaussians.quats[i], gaussians.log_scales[i]);
        splats.opacities[i] = sigmoid(gaussians.opacity_logits[i]);
        splats.colors[i] = shade<Degree>(sh, view_direction(mean, center()), T(1), clamping);
    }
};

template <int Degree, class T>
struct StaticSplatBackward {
    GaussiansView<const T> gaussians;
    Deferred<vec3<T>> center;
    ColorClamp clamping;
    SplatView<const T> dL_dsplats;
    GaussiansView<T> dL_dgaussians;
    Span<vec3<T>> dL_dcenters; // contribution of each Gaussian to dL_dcenter; may be empty

    GSH_HD void operator()(std::size_t i) const {
        constexpr std::size_t basis_count = static_cast<std::size_t>(sh_basis_count(Degree));
        const vec3<T>* sh = gaussians.sh.data() + i * basis_count;
        const vec3<T> mean = gaussians.means[i], dir = view_direction(mean, center());

        vec3<T> dL_dsh[basis_count], dL_ddir(T(0)), dL_doffset(T(0));
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        T dL_dao = T(0);
        shade_backward<Degree>(sh, dir, T(1), clamping, dL_dsplats.colors[i], dL_dsh, dL_ddir, dL_dao);
        view_direction_backward(mean, center(), dL_ddir, dL_doffset);
        if (!dL_dgaussians.sh.empty())
            for (std::size_t k = 0; k < basis_count; ++k) dL_dgaussians.sh[i * basis_count + k] += dL_dsh[k];
        if (!dL_dgaussians.means.empty()) dL_dgaussians.means[i] += dL_dsplats.means[i] + dL_doffset;
        if (!dL_dcenters.empty()) dL_dcenters[i] = -dL_doffset;

        quat<T> dL_dq{T(0), T(0), T(0), T(0)};
        vec3<T> dL_dlog_scale(T(0));
        covariance_backward(gaussians.quats[i], gaussians.log_scales[i], dL_dsplats.covariances[i], dL_dq,
                            dL_dlog_scale);
        if (!dL_dgaussians.quats.empty()) dL_dgaussians.quats[i] += dL_dq;
        if (!dL_dgaussians.log_scales.empty()) dL_dgaussians.log_scales[i] += dL_dlog_scale;
        if (!dL_dgaussians.opacity_logits.empty())
            sigmoid_backward(sigmoid(gaussians.opacity_logits[i]), dL_dsplats.opacities[i],
                             dL_dgaussians.opacity_logits[i]);
    }
};

template <class T>
void check_splats(std::string_view where, std::string_view argument, const SplatView<T>& splats, std::size_t count) {
    const std::string prefix = std::string(argument) + ".";
    check_size(where, prefix + "means", splats.means.size(), count);
    check_size(where, prefix + "covariances", splats.covariances.size(), count);
    check_size(where, prefix + "opacities", splats.opacities.size(), count);
    check_size(where, prefix + "colors", splats.colors.size(), count);
}

inline void check_degree(std::string_view where, int found, int expected) {
    if (found == expected) return;
    throw ShapeError(std::string(where) + ": sh_degree is " + std::to_string(found) + ", expected " +
                     std::to_string(expected) + "; choose the template's degree with with_sh_degree");
}

} // namespace detail

/// The settings of StaticSplats.
struct StaticSplatsParams {
    ColorClamp clamping = ColorClamp::below; ///< as 3DGS does
};

/// Temporary storage of backward; reuse it between steps to avoid allocation.
template <Backend B, std::floating_point T = float>
struct StaticSplatsCache {
    typename B::template Buffer<vec3<T>> dL_dcenters, partials;
};

/// Gaussians to splats: opacity = sigmoid(logit), covariance = R S Sᵀ Rᵀ, colour from the SH along the view direction.
///
/// Shapes  gaussians and splats of equal size; center [3].
/// Frame   all in the world; center is the camera's centre, Camera::center().
/// Errors  ShapeError where a size or the degree does not fit.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023.
template <Backend B, int Degree, std::floating_point T = float>
class StaticSplats {
public:
    using Params = StaticSplatsParams;
    using Cache = StaticSplatsCache<B, T>;

    explicit StaticSplats(B& backend, const Params& params = {}) : backend_(&backend), params_(params) {}

    [[nodiscard]] const Params& params() const { return params_; }

    /// Overwrites the splats. backward computes everything anew, so the cache stays as it is.
    void forward(const GaussiansView<const T>& gaussians, const Deferred<vec3<T>>& center, const SplatView<T>& splats,
                 Cache& /*cache*/) const {
        constexpr auto where = "StaticSplats::forward";
        detail::check_degree(where, gaussians.sh_degree, Degree);
        check_gaussians(where, "gaussians", gaussians, gaussians.size());
        detail::check_splats(where, "splats", splats, gaussians.size());
        check_memory(*backend_, where, "gaussians", gaussians);
        check_memory(*backend_, where, "splats", splats);
        backend_->for_each(gaussians.size(),
                           detail::StaticSplatForward<Degree, T>{gaussians, center, params_.clamping, splats});
    }

    /// Adjoint of forward: adds to the attributes of dL_dgaussians that are not empty. If dL_dcenter is given, it is
    /// one vector in the backend's memory and is added to as well.
    void backward(const GaussiansView<const T>& gaussians, const Deferred<vec3<T>>& center,
                  const SplatView<const T>& dL_dsplats, Cache& cache, const GaussiansView<T>& dL_dgaussians,
                  Span<vec3<T>> dL_dcenter = {}) const {
        constexpr auto where = "StaticSplats::backward";
        const std::size_t count = gaussians.size();
        detail::check_degree(where, gaussians.sh_degree, Degree);
        detail::check_degree(where, dL_dgaussians.sh_degree, Degree);
        check_gaussians(where, "gaussians", gaussians, count);
        detail::check_splats(where, "dL_dsplats", dL_dsplats, count);
        check_gaussians(where, "dL_dgaussians", dL_dgaussians, count, true);
        if (!dL_dcenter.empty()) check_size(where, "dL_dcenter", dL_dcenter.size(), 1, "one vector, or none");
        check_memory(*backend_, where, "gaussians", gaussians);
        check_memory(*backend_, where, "dL_dsplats", dL_dsplats);
        check_memory(*backend_, where, "dL_dgaussians", dL_dgaussians);
        check_memory(*backend_, where, "dL_dcenter", dL_dcenter);

        cache.dL_dcenters.resize(dL_dcenter.empty() ? 0 : count);
        backend_->for_each(count, detail::StaticSplatBackward<Degree, T>{gaussians, center, params_.clamping,
                                                                         dL_dsplats, dL_dgaussians, cache.dL_dcenters});
        if (!dL_dcenter.empty()) add_sum(*backend_, Span<const vec3<T>>(cache.dL_dcenters), dL_dcenter, cache.partials);
    }

private:
    B* backend_;
    Params params_;
};

} // namespace gsh
