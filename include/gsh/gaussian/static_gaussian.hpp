// SPDX-License-Identifier: Apache-2.0
/// @file  Turns a static 3DGS scene into splats: activations, covariance, and the colour seen from a camera centre.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/sum.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

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

/// One Gaussian of a static scene: opacity = sigmoid(o), covariance = R S Sᵀ Rᵀ or its factor R S, and the colour seen
/// from a camera.
///
/// Shapes  sh [basis_count] RGB.
/// Frame   all in the world; center is the camera's centre.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023.
template <int Degree>
struct StaticGaussian {
    static constexpr std::size_t basis_count = static_cast<std::size_t>(sh_basis_count(Degree));

    template <Lane T>
    struct Input {
        vec3<T> mean;
        quat<T> q;
        vec3<T> log_scale;
        T opacity_logit;
        const vec3<T>* sh;
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
        vec3<T> center = vec3<T>(T(0));
    };

    template <Lane T>
    [[nodiscard]] GSH_HD static Output<T> forward(const Input<T>& in, ColorClamp clamping) {
        return {in.mean, covariance(in.q, in.log_scale), sigmoid(in.opacity_logit),
                shade<Degree>(in.sh, view_direction(in.mean, in.center), T(1), clamping)};
    }

    template <Lane T>
    [[nodiscard]] GSH_HD static FactoredSplat<T> forward_factored(const Input<T>& in, ColorClamp clamping) {
        return {in.mean, covariance_factor(in.q, in.log_scale), sigmoid(in.opacity_logit),
                shade<Degree>(in.sh, view_direction(in.mean, in.center), T(1), clamping)};
    }

    /// Adds to dL_din.
    template <Lane T>
    GSH_HD static void backward(const Input<T>& in, ColorClamp clamping, const Output<T>& dL_dout,
                                Gradient<T>& dL_din) {
        backward_but_shape(in, clamping, dL_dout, dL_din);
        covariance_backward(in.q, in.log_scale, dL_dout.covariance, dL_din.q, dL_din.log_scale);
    }
    template <Lane T>
    GSH_HD static void backward(const Input<T>& in, ColorClamp clamping, const FactoredSplat<T>& dL_dout,
                                Gradient<T>& dL_din) {
        backward_but_shape(in, clamping, dL_dout, dL_din);
        covariance_factor_backward(in.q, in.log_scale, dL_dout.factor, dL_din.q, dL_din.log_scale);
    }

private:
    template <Lane T, class Out>
    GSH_HD static void backward_but_shape(const Input<T>& in, ColorClamp clamping, const Out& dL_dout,
                                          Gradient<T>& dL_din) {
        vec3<T> dL_ddir(T(0)), dL_doffset(T(0));
        T dL_dao(T(0));
        shade_backward<Degree>(in.sh, view_direction(in.mean, in.center), T(1), clamping, dL_dout.color, dL_din.sh,
                               dL_ddir, dL_dao);
        view_direction_backward(in.mean, in.center, dL_ddir, dL_doffset);
        dL_din.mean += dL_dout.mean + dL_doffset;
        dL_din.center -= dL_doffset;
        sigmoid_backward(sigmoid(in.opacity_logit), dL_dout.opacity, dL_din.opacity_logit);
    }
};

namespace detail {

template <int Degree, class T>
struct StaticInput {
    GaussiansView<const T> gaussians;
    Deferred<vec3<T>> center;

    [[nodiscard]] GSH_HD typename StaticGaussian<Degree>::template Input<T> operator[](std::size_t i) const {
        return {gaussians.means[i],          gaussians.quats[i],
                gaussians.log_scales[i],     gaussians.opacity_logits[i],
                gaussians.sh.data() + i * StaticGaussian<Degree>::basis_count, center()};
    }
};

template <int Degree, class T>
struct StaticSplatForward {
    StaticInput<Degree, T> input;
    ColorClamp clamping;
    SplatView<T> splats;

    GSH_HD void operator()(std::size_t i) const {
        if (splats.is_factored())
            splats.set(i, StaticGaussian<Degree>::forward_factored(input[i], clamping));
        else
            splats.set(i, StaticGaussian<Degree>::forward(input[i], clamping));
    }
};

template <int Degree, class T>
struct StaticSplatBackward {
    StaticInput<Degree, T> input;
    ColorClamp clamping;
    SplatView<const T> dL_dsplats;
    GaussiansView<T> dL_dgaussians;
    Span<vec3<T>> dL_dcenters; // contribution of each Gaussian to dL_dcenter; may be empty

    GSH_HD void operator()(std::size_t i) const {
        if (skip(i)) return;
        constexpr std::size_t basis_count = StaticGaussian<Degree>::basis_count;
        vec3<T> dL_dsh[basis_count];
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        typename StaticGaussian<Degree>::template Gradient<T> gradient;
        gradient.sh = dL_dsh;
        if (dL_dsplats.is_factored())
            StaticGaussian<Degree>::backward(input[i], clamping, dL_dsplats.factored(i), gradient);
        else
            StaticGaussian<Degree>::backward(input[i], clamping, dL_dsplats[i], gradient);
        add_attributes(gradient, dL_dgaussians, i);
        if (!dL_dgaussians.sh.empty())
            for (std::size_t k = 0; k < basis_count; ++k) dL_dgaussians.sh[i * basis_count + k] += dL_dsh[k];
        if (!dL_dcenters.empty()) dL_dcenters[i] = gradient.center;
    }

    /// True for a Gaussian without a gradient, whose contribution to the centre is then zero.
    [[nodiscard]] GSH_HD bool skip(std::size_t i) const {
        const bool zero = is_zero(dL_dsplats, i);
        if (zero && !dL_dcenters.empty()) dL_dcenters[i] = vec3<T>(T(0));
        return zero;
    }
};

template <class T>
void check_splats(std::string_view where, std::string_view argument, const SplatView<T>& splats, std::size_t count) {
    const std::string prefix = std::string(argument) + ".";
    check_size(where, prefix + "means", splats.means.size(), count);
    if (!splats.is_factored())
        check_size(where, prefix + "covariances", splats.covariances.size(), count);
    else
        check_size(where, prefix + "factors", splats.factors.size(), count);
    check_size(where, prefix + "opacities", splats.opacities.size(), count);
    check_size(where, prefix + "colors", splats.colors.size(), count);
}

inline void check_degree(std::string_view where, int found, int expected) {
    if (found == expected) return;
    throw ShapeError(std::string(where) + ": sh_degree is " + std::to_string(found) + ", expected " +
                     std::to_string(expected) + "; choose the template's degree with with_sh_degree");
}

} // namespace detail

/// Fallbacks for backends without an overload: each index is one Gaussian.
template <Backend B, int Degree, class T>
void static_splats_forward(B& backend, const detail::StaticSplatForward<Degree, T>& element) {
    static_assert(!CpuBackend<B>, "StaticSplats: include its backend's overloads, "
                                  "<gsh/gaussian/cpu/static_gaussian.hpp> or <gsh/cpu.hpp>");
    backend.for_each(element.input.gaussians.size(), element);
}
template <Backend B, int Degree, class T>
void static_splats_backward(B& backend, const detail::StaticSplatBackward<Degree, T>& element) {
    static_assert(!CpuBackend<B>, "StaticSplats: include its backend's overloads, "
                                  "<gsh/gaussian/cpu/static_gaussian.hpp> or <gsh/cpu.hpp>");
    backend.for_each(element.input.gaussians.size(), element);
}

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
/// Splats whose view has factors get R S instead.
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
        static_splats_forward(*backend_, detail::StaticSplatForward<Degree, T>{{gaussians, center}, params_.clamping,
                                                                               splats});
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
        static_splats_backward(
            *backend_, detail::StaticSplatBackward<Degree, T>{{gaussians, center}, params_.clamping, dL_dsplats,
                                                              dL_dgaussians, cache.dL_dcenters});
        if (!dL_dcenter.empty()) add_sum(*backend_, Span<const vec3<T>>(cache.dL_dcenters), dL_dcenter, cache.partials);
    }

private:
    B* backend_;
    Params params_;
};

} // namespace gsh
