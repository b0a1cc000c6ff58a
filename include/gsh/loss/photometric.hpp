// SPDX-License-Identifier: Apache-2.0
/// @file  The training loss between a render and a photograph: absolute difference and SSIM.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/composite_picture.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/loss/ssim.hpp>

#include <array>
#include <concepts>
#include <string>
#include <string_view>

namespace gsh {

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void photometric_forward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "PhotometricLoss: include its backend's overloads, <gsh/loss/cpu/photometric.hpp> or <gsh/cpu.hpp>");
}
template <Backend B, class... Arguments>
void photometric_backward(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "PhotometricLoss: include its backend's overloads, <gsh/loss/cpu/photometric.hpp> or <gsh/cpu.hpp>");
}

/// L = (1 - λ) mean |render - truth| + λ (1 - mean SSIM), means over pixels and channels.
///
/// Shapes  render, truth, dL_drender [channels, height, width], any size, also smaller than the window.
/// Units   display-referred sRGB in [0, 1]; SSIM's window is 11 x 11, Gaussian with sigma 1.5, zero beyond the border.
/// Errors  ShapeError for images that differ in shape, or for a cache of another shape. ValueError for whole_windows
///         and an image in which no window fits, or a backend without it.
/// Source  loss: Kerbl et al., "3D Gaussian Splatting", 2023; SSIM: Wang et al., 2004.
template <Backend B, std::floating_point T = float>
class PhotometricLoss {
public:
    using Params = PhotometricParams<T>;
    using Cache = PhotometricCache<B, T>;
    explicit PhotometricLoss(B& backend, Params params = {}) : backend_(&backend), params_(params) {
        check_value(params.ssim_weight >= T(0) && params.ssim_weight <= T(1), "PhotometricLoss",
                    "ssim_weight is " + detail::number_text(params.ssim_weight) + ", expected a number in [0, 1]");
    }

    /// Stores the loss and its parts in the cache, in the memory of the backend; values() copies them to the host.
    void forward(const ImageView<const T>& render, const ImageView<const T>& truth, Cache& cache) const {
        compare(render, truth, cache);
    }
    /// The same for a photograph that is not written out, where the backend can read it so. Elsewhere composite_rgba8
    /// writes it first.
    void forward(const ImageView<const T>& render, const CompositePicture<T>& truth, Cache& cache) const
        requires photometric_composites<B>
    {
        compare(render, truth, cache);
    }

    /// Adds dL_dloss times the gradient of the loss to dL_drender. The derivative of |x| at 0 is taken as 0.
    void backward(const ImageView<const T>& render, const ImageView<const T>& truth, T dL_dloss, const Cache& cache,
                  const ImageView<T>& dL_drender) const {
        differentiate(render, truth, dL_dloss, cache, dL_drender);
    }
    void backward(const ImageView<const T>& render, const CompositePicture<T>& truth, T dL_dloss, const Cache& cache,
                  const ImageView<T>& dL_drender) const
        requires photometric_composites<B>
    {
        differentiate(render, truth, dL_dloss, cache, dL_drender);
    }

    /// Copies the values of the last forward to the host; waits for the backend.
    [[nodiscard]] PhotometricValues values(const Cache& cache) const {
        check_size("PhotometricLoss::values", "cache.values", cache.values.size(), PhotometricValues::count,
                   "call forward first");
        std::array<double, PhotometricValues::count> host{};
        backend_->download(Span<const double>(cache.values), Span<double>(host));
        return PhotometricValues::from(host.data());
    }

    [[nodiscard]] const Params& params() const { return params_; }

private:
    B* backend_;
    Params params_;

    template <class Truth>
    void compare(const ImageView<const T>& render, const Truth& truth, Cache& cache) const {
        constexpr std::string_view where = "PhotometricLoss::forward";
        check_picture(*backend_, where, "render", render, render.channels, render.height, render.width);
        check_picture(*backend_, where, "truth", truth, render.channels, render.height, render.width);
        check_value(!params_.whole_windows ||
                        (render.height >= SsimWindow<T>::size && render.width >= SsimWindow<T>::size),
                    where, "whole_windows needs an image of 11 x 11 pixels or more");
        cache.channels = render.channels, cache.height = render.height, cache.width = render.width;
        cache.with_ssim = params_.ssim_weight != T(0);
        cache.values.resize(PhotometricValues::count);
        photometric_forward(*backend_, render, truth, params_, cache); // the backend's own overload
    }

    template <class Truth>
    void differentiate(const ImageView<const T>& render, const Truth& truth, T dL_dloss, const Cache& cache,
                       const ImageView<T>& dL_drender) const {
        constexpr std::string_view where = "PhotometricLoss::backward";
        check_picture(*backend_, where, "render", render, cache.channels, cache.height, cache.width);
        check_picture(*backend_, where, "truth", truth, cache.channels, cache.height, cache.width);
        check_picture(*backend_, where, "dL_drender", dL_drender, cache.channels, cache.height, cache.width);
        check_value(cache.with_ssim == (params_.ssim_weight != T(0)), where,
                    "cache comes from a loss with another ssim_weight; use one cache per loss");
        photometric_backward(*backend_, render, truth, dL_dloss, params_, cache, dL_drender);
    }
};

/// The mean absolute difference alone.
template <Backend B, std::floating_point T = float>
class L1Loss : public PhotometricLoss<B, T> {
public:
    explicit L1Loss(B& backend) : PhotometricLoss<B, T>(backend, {.ssim_weight = T(0)}) {}
};

/// 1 - mean SSIM alone.
template <Backend B, std::floating_point T = float>
class SsimLoss : public PhotometricLoss<B, T> {
public:
    explicit SsimLoss(B& backend) : PhotometricLoss<B, T>(backend, {.ssim_weight = T(1)}) {}
};

} // namespace gsh
