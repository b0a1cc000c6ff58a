// SPDX-License-Identifier: Apache-2.0
/// @file  The differentiable Gaussian rasterizer.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/screen_gradient.hpp>
#include <gsh/render/target.hpp>

#include <cmath>
#include <concepts>
#include <limits>
#include <string>

namespace gsh {

/// The default settings with a scene's pixel filter.
template <std::floating_point T>
[[nodiscard]] RasterParams<T> raster_params(const PixelFilter& filter) {
    RasterParams<T> params;
    params.dilation = T(filter.dilation);
    params.compensate_opacity = filter.compensate_opacity;
    return params;
}

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void composite_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Rasterizer: include its backend's overloads, <gsh/render/cpu/rasterizer.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void composite_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Rasterizer: include its backend's overloads, <gsh/render/cpu/rasterizer.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void composite_backward_to_screen(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "Rasterizer::backward_to_screen is for the CPU backends: include <gsh/render/cpu/rasterizer.hpp> or "
                  "<gsh/cpu.hpp>");
}

/// Projects Gaussians and composites them front to back over a background.
///
///     alpha = min(alpha_max, opacity * exp(-dᵀ Σ⁻¹ d / 2))  at a pixel's centre; skipped if below alpha_min
///     C = sum T alpha color + T_end background,  T = product of (1 - alpha) of the splats in front
///
/// Splats are ordered by camera z, ties by index. A pixel stops before a splat would take T below transmittance_min.
///
/// Shapes  images planar, [channels, height, width] of the camera.
/// Errors  ShapeError for sizes that do not match. ValueError for invalid settings, for an invalid camera, for a
///         Gaussian with a NaN or infinite number (the message gives its index; nothing is drawn), and for more than
///         max_pairs pairs. In a recorded step, check throws the last two.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023. Two differences: a splat
///         counts wherever alpha >= alpha_min, not only within three sigma, and the cap alpha_max passes no gradient.
template <Backend B, std::floating_point T = float>
class Rasterizer {
public:
    using Params = RasterParams<T>;
    using Cache = RasterCache<B, T>;

    explicit Rasterizer(B& backend, const Params& params = {}) : backend_(&backend), params_(params) {
        constexpr const char* where = "Rasterizer";
        check_value(params.alpha_min >= T(1e-30) && params.alpha_min < params.alpha_max, where,
                    "alpha_min must lie between 1e-30 and alpha_max");
        check_value(params.alpha_max < T(1), where, "alpha_max must be below 1, or the adjoint divides by zero");
        check_value(params.transmittance_min >= T(0) && params.transmittance_min < T(1), where,
                    "transmittance_min must lie in [0, 1)");
        check_value(params.gradient_transmittance_min >= T(0) && params.gradient_transmittance_min <= T(1), where,
                    "gradient_transmittance_min must lie in [0, 1]");
        check_value(params.near_plane > T(0), where, "near_plane must be positive");
        check_value(params.dilation >= T(0) && params.jacobian_margin >= T(0), where,
                    "dilation and jacobian_margin must not be negative");
        check_value(params.compensation_floor > T(0), where, "compensation_floor must be positive");
        check_value(params.max_pairs <= std::numeric_limits<std::uint32_t>::max(), where,
                    "max_pairs must fit 32 bits");
    }

    [[nodiscard]] const Params& params() const { return params_; }

    /// Overwrites the target and the cache. A camera that was computed on the backend has the size of input.known.
    void forward(const Deferred<Camera<T>>& input, const SplatView<const T>& splats, const Background<T>& background,
                 const RenderTarget<T>& target, Cache& cache) const {
        constexpr const char* where = "Rasterizer::forward";
        const Camera<T>& camera = input.known;
        check_camera(where, camera);
        check_splats(where, splats);
        check_image(where, "color", target.color, 3, camera.height, camera.width);
        check_optional(where, "alpha", target.alpha, 1, camera);
        check_optional(where, "expected_depth", target.expected_depth, 1, camera);
        check_optional(where, "median_depth", target.median_depth, 1, camera);
        check_optional(where, "background", background.image, 3, camera);
        check_memory(*backend_, where, "splats", splats);
        check_memory(*backend_, where, "color", target.color);
        check_memory(*backend_, where, "alpha", target.alpha);
        check_memory(*backend_, where, "expected_depth", target.expected_depth);
        check_memory(*backend_, where, "median_depth", target.median_depth);
        check_memory(*backend_, where, "background", background.image);
        cache.splat_count = 0, cache.width = cache.height = 0; // backward refuses the cache until forward has succeeded
        cache.has_depth = target.has_depth();
        composite_forward(*backend_, input, splats, background, params_, target, cache); // the backend's own overload
        if (!defers()) check_status(where, cache);
        cache.splat_count = splats.size(), cache.width = camera.width, cache.height = camera.height;
    }

    /// Throws what forward throws for the Gaussians that it was given. Forward itself does this at once, unless the
    /// backend records a step (StepGraph): then the host does not wait, and this function is for the time after the
    /// step. A device that has halted stays so, and later steps do nothing, until Device::resume() is called.
    /// Errors  also ValueError if the device has halted for another reason.
    void check(const Cache& cache) const {
        constexpr const char* where = "Rasterizer::forward";
        check_status(where, cache);
        check_value(!has_halted(*backend_), where,
                    "the device has halted in an earlier pass, so this one may have done nothing; call "
                    "Device::resume(), then run the step again");
    }

    /// Adds to the non-empty spans of dL_dsplats, and to dL_dcamera and dL_dbackground if given. The other arguments
    /// are those of the forward pass that filled the cache. A gradient of a depth needs a depth in forward's target.
    void backward(const Deferred<Camera<T>>& input, const SplatView<const T>& splats, const Background<T>& background,
                  const RenderGradient<T>& dL_dtarget, Cache& cache, const SplatView<T>& dL_dsplats,
                  Span<CameraGradient<T>> dL_dcamera = {}, const BackgroundGradient<T>& dL_dbackground = {}) const {
        constexpr const char* where = "Rasterizer::backward";
        const Camera<T>& camera = input.known;
        check_splats(where, splats);
        check_size(where, "means", splats.size(), cache.splat_count, "pass what forward was given");
        check_value(camera.width == cache.width && camera.height == cache.height, where,
                    "the camera has another image size than forward's");
        check_images(where, background, dL_dtarget, cache, dL_dbackground);
        check_gradient(where, "dL_dsplats.means", dL_dsplats.means.size(), splats.size());
        check_gradient(where, "dL_dsplats.covariances", dL_dsplats.covariances.size(),
                       splats.is_factored() ? 0 : splats.size());
        check_gradient(where, "dL_dsplats.factors", dL_dsplats.factors.size(), splats.factors.size());
        check_gradient(where, "dL_dsplats.opacities", dL_dsplats.opacities.size(), splats.size());
        check_gradient(where, "dL_dsplats.colors", dL_dsplats.colors.size(), splats.size());
        check_gradient(where, "dL_dcamera", dL_dcamera.size(), 1);
        check_memory(*backend_, where, "splats", splats);
        check_memory(*backend_, where, "dL_dsplats", dL_dsplats);
        check_memory(*backend_, where, "dL_dcamera", dL_dcamera);
        composite_backward(*backend_, input, splats, background, params_, dL_dtarget, cache, dL_dsplats, dL_dcamera,
                           dL_dbackground);
    }

    /// The first half of backward: adds to the gradients of the splats on the image plane, for callers who look at
    /// these, or who have a projection of their own. The rest is project_backward. On the CPU backends.
    void backward_to_screen(const Background<T>& background, const RenderGradient<T>& dL_dtarget, Cache& cache,
                            const ScreenGradient<T>& dL_dscreen,
                            const BackgroundGradient<T>& dL_dbackground = {}) const {
        constexpr const char* where = "Rasterizer::backward_to_screen";
        check_value(cache.width > 0, where, "the cache is not that of a forward pass");
        check_images(where, background, dL_dtarget, cache, dL_dbackground);
        check_gradient(where, "dL_dscreen.means2d", dL_dscreen.means2d.size(), cache.splat_count);
        check_gradient(where, "dL_dscreen.conics", dL_dscreen.conics.size(), cache.splat_count);
        check_gradient(where, "dL_dscreen.depths", dL_dscreen.depths.size(), cache.splat_count);
        check_gradient(where, "dL_dscreen.opacities", dL_dscreen.opacities.size(), cache.splat_count);
        check_gradient(where, "dL_dscreen.colors", dL_dscreen.colors.size(), cache.splat_count);
        check_gradient(where, "dL_dscreen.absolute_means2d", dL_dscreen.absolute_means2d.size(), cache.splat_count);
        composite_backward_to_screen(*backend_, background, params_, dL_dtarget, cache, dL_dscreen, dL_dbackground);
    }

    /// After a step that halted a device: throws what forward would have thrown, or gives the cache the memory that the
    /// pass lacked.
    void mend(Cache& cache) const {
        [[maybe_unused]] const RasterStatus status = accepted_status("Rasterizer::forward", cache);
        if constexpr (requires { cache.scratch.reserve(std::size_t()); })
            cache.scratch.reserve(static_cast<std::size_t>(status.pairs));
    }

private:
    static constexpr int max_side = 1048560; ///< pixels: 65535 tiles of 16

    static void check_camera(const char* where, const Camera<T>& camera) {
        check_value(camera.width > 0 && camera.height > 0, where, "the camera's image is empty; set width and height");
        check_value(camera.width <= max_side && camera.height <= max_side, where,
                    "the camera's image is wider or higher than 1048560 pixels, more tiles than 16 bits can number");
        T sum = camera.fx * T(0) + camera.fy * T(0) + camera.cx * T(0) + camera.cy * T(0);
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) sum += camera.R[c][r] * T(0) + camera.t[r] * T(0);
        check_value(sum == T(0), where, "the camera has a number that is not finite");
        check_value(camera.fx > T(0) && camera.fy > T(0), where,
                    "the camera's focal lengths must be positive; is its K singular?");
    }
    static void check_splats(const char* where, const SplatView<const T>& splats) {
        const std::size_t n = splats.size();
        check_size(where, "covariances", splats.covariances.size(), splats.is_factored() ? 0 : n,
                   "store one covariance per mean, or one factor");
        if (splats.is_factored()) check_size(where, "factors", splats.factors.size(), n, "store one factor per mean");
        check_size(where, "opacities", splats.opacities.size(), n, "store one opacity per mean");
        check_size(where, "colors", splats.colors.size(), n, "store one color per mean");
        check_value(n < std::numeric_limits<std::uint32_t>::max(), where, "more Gaussians than 32 bits can number");
    }
    template <class U, class Size> // a camera or a cache
    static void check_optional(const char* where, const char* argument, const ImageView<U>& image, int channels,
                               const Size& size) {
        if (!image.empty()) check_image(where, argument, image, channels, size.height, size.width);
    }
    /// The images of a backward pass.
    void check_images(const char* where, const Background<T>& background, const RenderGradient<T>& dL_dtarget,
                      const Cache& cache, const BackgroundGradient<T>& dL_dbackground) const {
        check_optional(where, "dL_dtarget.color", dL_dtarget.color, 3, cache);
        check_optional(where, "dL_dtarget.alpha", dL_dtarget.alpha, 1, cache);
        check_optional(where, "dL_dtarget.expected_depth", dL_dtarget.expected_depth, 1, cache);
        check_optional(where, "dL_dtarget.median_depth", dL_dtarget.median_depth, 1, cache);
        check_value(cache.has_depth || !dL_dtarget.has_depth(), where,
                    "dL_dtarget has a gradient of depths, and forward's target had no image of them");
        check_optional(where, "background", background.image, 3, cache);
        check_optional(where, "dL_dbackground.image", dL_dbackground.image, 3, cache);
        check_gradient(where, "dL_dbackground.color", dL_dbackground.color.size(), 1);
        check_memory(*backend_, where, "background", background.image);
        check_memory(*backend_, where, "dL_dtarget.color", dL_dtarget.color);
        check_memory(*backend_, where, "dL_dtarget.alpha", dL_dtarget.alpha);
        check_memory(*backend_, where, "dL_dtarget.expected_depth", dL_dtarget.expected_depth);
        check_memory(*backend_, where, "dL_dtarget.median_depth", dL_dtarget.median_depth);
        check_memory(*backend_, where, "dL_dbackground.color", dL_dbackground.color);
        check_memory(*backend_, where, "dL_dbackground.image", dL_dbackground.image);
    }
    static void check_gradient(const char* where, const char* argument, std::size_t found, std::size_t expected) {
        if (found != 0) check_size(where, argument, found, expected, "or leave it empty to skip it");
    }
    /// Whether the backend is recording a step, during which the host must not wait for it.
    [[nodiscard]] bool defers() const {
        if constexpr (DeferringBackend<B>) return backend_->deferring();
        else return false;
    }
    /// The report of the last pass. Throws for input that is wrong, whatever the size of the buffers.
    [[nodiscard]] RasterStatus accepted_status(const char* where, const Cache& cache) const {
        RasterStatus status;
        backend_->download(Span<const RasterStatus>(cache.status), Span<RasterStatus>(&status, 1));
        if (status.nonfinite != 0)
            throw GaussianError(std::string(where) + ": Gaussian " + std::to_string(status.first_nonfinite) +
                                    " has a mean, covariance, opacity or color that is not finite (" +
                                    std::to_string(status.nonfinite) + " such in all)",
                                status.first_nonfinite);
        if (status.pairs > params_.max_pairs)
            throw ValueError(std::string(where) + ": the Gaussians cover " + std::to_string(status.pairs) +
                             " tiles in all, expected at most " + std::to_string(params_.max_pairs) +
                             "; are scales or the camera in other units than metres? Params::max_pairs sets the limit");
        return status;
    }
    void check_status(const char* where, const Cache& cache) const {
        const RasterStatus status = accepted_status(where, cache);
        if (status.pairs > status.capacity)
            throw ValueError(std::string(where) + ": the Gaussians cover " + std::to_string(status.pairs) +
                             " tiles in all, the buffers of the recorded step hold " + std::to_string(status.capacity) +
                             "; run forward once outside of a recorded step, where the buffers grow, and "
                             "call Device::resume()");
    }

    B* backend_;
    Params params_;
};

} // namespace gsh
