// SPDX-License-Identifier: Apache-2.0
/// @file  The loss of a photograph: splats are rendered from its camera and compared with it; the adjoint of both.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/pipeline/backdrop.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/render/rasterizer.hpp>

#include <array>
#include <concepts>
#include <cstddef>

namespace gsh {

/// loss = (1 - λ) L1 + λ (1 - SSIM) of the rendered picture and the photograph, and, if asked for, mask_weight times
/// the mean of |alpha - mask|.
///
/// Splats and photograph stand before the same background: the photograph's plate, or a plain colour. A step sets a
/// photograph, renders, compares, and goes back; pictures for people are made by the same renderer.
///
/// Frame   splats in the world, as the photograph's camera is.
/// Units   display-referred sRGB.
/// Errors  ShapeError, ValueError before any work starts; those of Rasterizer::forward.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, equation 7.
template <Backend B, std::floating_point T = float>
class PhotoLoss {
public:
    struct Params {
        PixelFilter filter = {};
        double ssim_weight = 0.2;                  ///< λ
        double mask_weight = 0;                    ///< 0: the photograph's mask is not compared
        std::array<double, 3> background{1, 1, 1}; ///< where there is no plate
    };

    explicit PhotoLoss(B& backend, const Params& params = {})
        : backend_(&backend), params_(params), backdrop_(params.background),
          rasterizer_(backend, raster_params<T>(params.filter)),
          photometric_(backend, {.ssim_weight = T(params.ssim_weight)}), mask_loss_(backend) {
        check_value(params.mask_weight >= 0, "PhotoLoss", "mask_weight must not be negative");
    }

    [[nodiscard]] const Params& params() const { return params_; }

    /// From here on this colour stands where there is no plate. A photograph that was set before keeps its own.
    void set_background(const std::array<double, 3>& color) { backdrop_.set_color(color); }

    /// From here on splats are rendered before this photograph's plate or the background, and compared with it.
    void set_photo(const Photo& photo) {
        resize(photo.camera.height, photo.camera.width);
        backdrop_.photograph(*backend_, photo.rgba, photo.plate, view(truth_, 3),
                             with_mask() ? in(mask_, 1) : ImageView<T>{});
    }

    /// Renders the splats from the photograph's camera, or from where it is believed to be by now.
    void render(const Camera<T>& camera, const SplatView<const T>& splats) {
        rasterizer_.forward(camera, splats, backdrop_.background(),
                            {.color = view(render_, 3), .alpha = with_mask() ? in(alpha_, 1) : ImageView<T>{}},
                            raster_cache_);
    }

    /// Compares what was rendered with the photograph.
    void compare() {
        photometric_.forward(view(render_, 3), view(truth_, 3), photometric_cache_);
        if (with_mask()) mask_loss_.forward(view(alpha_, 1), view(mask_, 1), mask_cache_);
    }

    /// The loss that compare() found; waits for it.
    [[nodiscard]] double loss() const {
        const double photometric = values().loss;
        return with_mask() ? photometric + params_.mask_weight * mask_loss_.values(mask_cache_).loss : photometric;
    }
    /// The photometric part of it; waits for it.
    [[nodiscard]] PhotometricValues values() const { return photometric_.values(photometric_cache_); }
    /// PSNR of what was rendered against the photograph; waits for both.
    [[nodiscard]] double psnr() const {
        const Image<T> seen = download(render_, 3), wanted = download(truth_, 3);
        return gsh::psnr(seen.view(), wanted.view());
    }

    /// Adjoint of render() and compare(), whose arguments it takes again: adds to dL_dsplats, and to dL_dcamera [1] if
    /// it is given.
    void backward(const Camera<T>& camera, const SplatView<const T>& splats, const SplatView<T>& dL_dsplats,
                  Span<CameraGradient<T>> dL_dcamera = {}) {
        const ImageView<T> dL_drender = in(dL_drender_, 3);
        backend_->fill(dL_drender.data, T(0));
        photometric_.backward(view(render_, 3), view(truth_, 3), T(1), photometric_cache_, dL_drender);
        RenderGradient<T> dL_dtarget{.color = dL_drender};
        if (with_mask()) {
            const ImageView<T> dL_dalpha = in(dL_dalpha_, 1);
            backend_->fill(dL_dalpha.data, T(0));
            mask_loss_.backward(view(alpha_, 1), view(mask_, 1), T(params_.mask_weight), mask_cache_, dL_dalpha);
            dL_dtarget.alpha = dL_dalpha;
        }
        rasterizer_.backward(camera, splats, backdrop_.background(), dL_dtarget, raster_cache_, dL_dsplats, dL_dcamera);
    }

    /// What the rasterizer left of the last picture: which splats it shows, and after backward how their places on the
    /// screen pull.
    [[nodiscard]] const RasterCache<B, T>& raster_cache() const { return raster_cache_; }

    // Pictures on the host. They take the place of the photograph and of what was rendered. ---------------------------

    /// The splats before the photograph's plate, or before the background: color [3, height, width], and if asked alpha
    /// [1, height, width].
    void picture(const Photo& photo, const SplatView<const T>& splats, Image<T>& color, Image<T>* alpha = nullptr) {
        backdrop_.set_plate(*backend_, photo.plate, photo.camera.height, photo.camera.width);
        picture_from(photo.camera, splats, color, alpha);
    }
    /// The splats before the background.
    void picture(const Camera<double>& camera, const SplatView<const T>& splats, Image<T>& color,
                 Image<T>* alpha = nullptr) {
        backdrop_.clear_plate();
        picture_from(camera, splats, color, alpha);
    }
    /// The photograph as it is compared: before its plate or the background, with its mask.
    void photograph(const Photo& photo, Image<T>& color, Image<T>& mask) {
        resize(photo.camera.height, photo.camera.width);
        backdrop_.photograph(*backend_, photo.rgba, photo.plate, view(truth_, 3), in(mask_, 1));
        color = download(truth_, 3);
        mask = download(mask_, 1);
    }

private:
    using Buffer = typename B::template Buffer<T>;

    [[nodiscard]] bool with_mask() const { return params_.mask_weight > 0; }
    [[nodiscard]] std::size_t plane_size() const {
        return static_cast<std::size_t>(height_) * static_cast<std::size_t>(width_);
    }
    void resize(int height, int width) {
        height_ = height, width_ = width;
        for (Buffer* buffer : {&render_, &truth_}) buffer->resize(3 * plane_size());
    }
    [[nodiscard]] ImageView<T> view(Buffer& buffer, int channels) const { return {buffer, channels, height_, width_}; }
    /// The same, the buffer made large enough first.
    [[nodiscard]] ImageView<T> in(Buffer& buffer, int channels) const {
        buffer.resize(static_cast<std::size_t>(channels) * plane_size());
        return view(buffer, channels);
    }
    [[nodiscard]] Image<T> download(const Buffer& buffer, int channels) const {
        Image<T> host(channels, height_, width_);
        backend_->download(Span<const T>(buffer), Span<T>(host.data));
        return host;
    }
    void picture_from(const Camera<double>& camera, const SplatView<const T>& splats, Image<T>& color,
                      Image<T>* alpha) {
        resize(camera.height, camera.width);
        rasterizer_.forward(camera.template cast<T>(), splats, backdrop_.background(),
                            {.color = view(render_, 3), .alpha = alpha ? in(alpha_, 1) : ImageView<T>{}},
                            raster_cache_);
        color = download(render_, 3);
        if (alpha) *alpha = download(alpha_, 1);
    }

    B* backend_;
    Params params_;
    Backdrop<B, T> backdrop_;
    Rasterizer<B, T> rasterizer_;
    PhotometricLoss<B, T> photometric_;
    L1Loss<B, T> mask_loss_;

    int height_ = 0, width_ = 0;            // of the photograph or picture at hand
    Buffer render_, truth_, dL_drender_;    // [3, height, width]; they keep the memory of the largest
    Buffer alpha_, mask_, dL_dalpha_;       // [height, width], where they are asked for
    typename Rasterizer<B, T>::Cache raster_cache_;
    typename PhotometricLoss<B, T>::Cache photometric_cache_, mask_cache_;
};

} // namespace gsh
