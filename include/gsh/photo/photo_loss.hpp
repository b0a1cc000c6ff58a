// SPDX-License-Identifier: Apache-2.0
/// @file  The loss of a photograph: renders splats from its camera and compares the picture with it; with adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/composite_picture.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/photo/backdrop.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_pixels.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/rasterizer.hpp>

#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh {

namespace detail {

/// Replaces a photograph by the render at hidden pixels, so that they are equal there.
template <class T>
struct HiddenTruth {
    Span<const UnknownPixel> unknown;
    Span<const T> render; // [channels, plane]
    Span<T> truth;        // [channels, plane]
    std::size_t plane;
    GSH_HD void operator()(std::size_t i) const {
        if (i >= unknown.size() || !unknown[i].hidden) return;
        for (std::size_t at = unknown[i].index; at < truth.size(); at += plane) truth[at] = render[at];
    }
};
/// Clears the gradient at hidden pixels: SSIM compares windows, and so has one there, too.
template <class T>
struct HiddenGradient {
    Span<const UnknownPixel> unknown;
    Span<T> dL_drender; // [channels, plane]
    std::size_t plane;
    GSH_HD void operator()(std::size_t i) const {
        if (i >= unknown.size() || !unknown[i].hidden) return;
        for (std::size_t at = unknown[i].index; at < dL_drender.size(); at += plane) dL_drender[at] = T(0);
    }
};

} // namespace detail

/// A loss of a picture against a photograph, as PhotometricLoss is one:
///
///     forward(render, truth, cache)                        compares two pictures [3, height, width]
///     backward(render, truth, weight, cache, dL_drender)   adds weight times the gradient
///     values(cache)                                        returns loss, L1, SSIM, mean squared error (NaN: unknown)
///
/// The member `values` of its Cache has the same four numbers in the backend's memory. A loss may also read a
/// CompositePicture as truth, where the backend can (photometric_composites).
template <class L, class T>
concept ImageLossPolicy = requires(const L& loss, const ImageView<const T>& picture, T weight, typename L::Cache& cache,
                                   const ImageView<T>& dL_drender) {
    loss.forward(picture, picture, cache);
    loss.backward(picture, picture, weight, cache, dL_drender);
    { loss.values(cache) } -> std::same_as<PhotometricValues>;
    { cache.values } -> std::convertible_to<Span<const double>>;
};

/// What draws the splats, with Rasterizer's calls and its Cache, from which density control reads.
template <class R, class B, class T>
concept RasterizerPolicy =
    requires(const R& rasterizer, const Deferred<Camera<T>>& camera, const SplatView<const T>& splats,
             const Background<T>& background, const RenderTarget<T>& target, const RenderGradient<T>& dL_dtarget,
             RasterCache<B, T>& cache, const SplatView<T>& dL_dsplats, Span<CameraGradient<T>> dL_dcamera) {
        rasterizer.forward(camera, splats, background, target, cache);
        rasterizer.backward(camera, splats, background, dL_dtarget, cache, dL_dsplats, dL_dcamera);
        rasterizer.mend(cache);
    };

struct PhotoLossParams {
    PixelFilter filter = {};                   ///< of gsh's rasterizer
    double ssim_weight = PhotometricParams<double>().ssim_weight; ///< λ of gsh's loss
    double mask_weight = 0;                    ///< 0: masks are not compared
    std::array<double, 3> background{1, 1, 1}; ///< of photographs without a plate
    double gradient_transmittance_min = 0;     ///< of gsh's rasterizer, see RasterParams
};

/// loss = image loss of render and photograph, plus mask_weight times the mean of |alpha - mask|. By default, the image
/// loss is (1 - λ) L1 + λ (1 - SSIM). Another one and another rasterizer are template arguments.
///
/// Render and photograph have the same background: the photograph's plate, or a plain colour. At hidden pixels
/// (UnknownPixel) they count as equal, and the render gets no gradient. A step calls set_photo, render, compare and
/// backward. The functions at the end make pictures on the host with the same renderer.
///
/// Frame   splats in the world, as the photograph's camera is.
/// Units   display-referred sRGB.
/// Errors  ShapeError, ValueError before any work starts; those of Rasterizer::forward.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, equation 7.
template <Backend B, std::floating_point T = float, class ImageLoss = PhotometricLoss<B, T>,
          class Renderer = Rasterizer<B, T>>
    requires ImageLossPolicy<ImageLoss, T> && RasterizerPolicy<Renderer, B, T>
class PhotoLoss {
public:
    using Params = PhotoLossParams;

    explicit PhotoLoss(B& backend, const Params& params = {})
        requires std::same_as<ImageLoss, PhotometricLoss<B, T>> && std::same_as<Renderer, Rasterizer<B, T>>
        : PhotoLoss(backend, params, ImageLoss(backend, {.ssim_weight = T(params.ssim_weight)})) {}
    /// With another image loss.
    PhotoLoss(B& backend, const Params& params, ImageLoss image_loss)
        requires std::same_as<Renderer, Rasterizer<B, T>>
        : PhotoLoss(backend, params, std::move(image_loss), Renderer(backend, raster_params_of(params))) {}
    /// With another image loss and another rasterizer.
    PhotoLoss(B& backend, const Params& params, ImageLoss image_loss, Renderer rasterizer)
        : backend_(&backend), params_(params), backdrop_(params.background), rasterizer_(std::move(rasterizer)),
          half_chroma_(backend), image_loss_(std::move(image_loss)), mask_loss_(backend) {
        check_value(params.mask_weight >= 0, "PhotoLoss", "mask_weight must not be negative");
    }

    [[nodiscard]] const Params& params() const { return params_; }

    /// Frees pictures, photographs and scratch. The next step allocates them again.
    void release_memory() { *this = PhotoLoss(*backend_, params_, std::move(image_loss_), std::move(rasterizer_)); }

    /// The photograph is compared over its plate or, without one, over `background`. render and compare use both from
    /// now on. `pixels` are those of the photograph in the backend's memory (PhotoPixels).
    void set_photo(const Photo& photo, const typename PhotoPixels<B>::View& pixels,
                   const std::array<double, 3>& background) {
        backdrop_.set_color(background);
        resize(photo.camera.height, photo.camera.width);
        halve_chroma_ = photo.half_chroma;
        weight_ = T(photo.weight);
        unknown_ = pixels.unknown;
        if (composites && unknown_.empty()) {
            is_composited_ = true;
            composite_ = backdrop_.composite(*backend_, pixels.rgba, pixels.box, pixels.plate, height_, width_);
            check_picture(*backend_, "PhotoLoss::set_photo", photo.name, composite_, 3, height_, width_);
        } else {
            put_photograph(pixels, with_mask() ? in(mask_, 1) : ImageView<T>{});
        }
    }
    /// The same over Params::background.
    void set_photo(const Photo& photo, const typename PhotoPixels<B>::View& pixels) {
        set_photo(photo, pixels, params_.background);
    }

    /// The same for pixels in host memory, which are uploaded, or of a source.
    void set_photo(const Photo& photo, const std::array<double, 3>& background) {
        set_photo(photo, pixels_of(photo), background);
    }
    void set_photo(const Photo& photo) { set_photo(photo, params_.background); }

    /// A number for the kernels that a photograph needs: the `kind` of a recorded step (RepeatedStep).
    [[nodiscard]] static std::uint64_t kind(const Photo& photo, const typename PhotoPixels<B>::View& pixels) {
        const Camera<double>& camera = photo.camera;
        const bool cropped = pixels.box != whole_picture(camera.height, camera.width);
        const auto unknown = static_cast<std::uint64_t>(std::bit_width(detail::unknown_slots(pixels.unknown.size())));
        return std::uint64_t(photo.half_chroma) << 63 | std::uint64_t(cropped) << 62 | unknown << 48 |
               std::uint64_t(camera.height) << 24 | std::uint64_t(camera.width);
    }

    /// Renders the splats. `camera` is the photograph's camera, as it was calibrated or as refinement has moved it.
    void render(const Deferred<Camera<T>>& camera, const SplatView<const T>& splats) {
        rasterizer_.forward(camera, splats, backdrop_.background(),
                            {.color = view(render_, 3), .alpha = with_mask() ? in(alpha_, 1) : ImageView<T>{}},
                            raster_cache_);
    }

    /// Settles repeated steps of a scene. If some were lost, the scene takes them back, and they are subtracted from
    /// `steps`; then the rasterizer gets the memory that the last picture needs, or what Rasterizer::forward would have
    /// thrown is thrown. Returns their number.
    template <class Scene>
    std::uint64_t settle(RepeatedStep<B>& repeated, Scene& scene, std::unsigned_integral auto& steps) {
        const std::uint64_t lost = repeated.settle();
        if (lost == 0) return 0;
        steps -= lost;
        if constexpr (requires { scene.take_back(lost); }) scene.take_back(lost);
        rasterizer_.mend(raster_cache_);
        return lost;
    }

    /// Compares the render with the photograph.
    void compare() {
        if (halve_chroma_) half_chroma_.forward(view(render_, 3), view(render_, 3));
        hide(render_, truth_);
        if (with_mask()) hide(alpha_, mask_);
        with_truth([&](const auto& truth, const auto& mask) {
            image_loss_.forward(view(render_, 3), truth, image_cache_);
            if (with_mask()) mask_loss_.forward(view(alpha_, 1), mask, mask_cache_);
        });
    }

    /// The loss of the last compare(). Waits for the backend.
    [[nodiscard]] double loss() const {
        const double photometric = values().loss;
        return with_mask() ? photometric + params_.mask_weight * mask_loss_.values(mask_cache_).loss : photometric;
    }
    /// What the image loss found in the last compare(). Waits for the backend.
    [[nodiscard]] PhotometricValues values() const { return image_loss_.values(image_cache_); }
    /// PSNR of the render against the photograph. Waits for the backend.
    [[nodiscard]] double psnr() const { return psnr_of_mse(values().mse); }
    /// The numbers of values() in the backend's memory, [4]: loss, L1, SSIM, mean squared error. Does not wait.
    [[nodiscard]] Span<const double> values_on_backend() const { return image_cache_.values; }

    /// Adjoint of render() and compare(), times the photograph's weight. Takes the arguments of render again. Adds to
    /// dL_dsplats, and to dL_dcamera [1] if that is given.
    void backward(const Deferred<Camera<T>>& camera, const SplatView<const T>& splats, const SplatView<T>& dL_dsplats,
                  Span<CameraGradient<T>> dL_dcamera = {}) {
        const ImageView<T> dL_drender = in(dL_drender_, 3);
        const ImageView<T> dL_dalpha = with_mask() ? in(dL_dalpha_, 1) : ImageView<T>{};
        backend_->fill(dL_drender.data, T(0));
        backend_->fill(dL_dalpha.data, T(0));
        with_truth([&](const auto& truth, const auto& mask) {
            image_loss_.backward(view(render_, 3), truth, weight_, image_cache_, dL_drender);
            if (with_mask())
                mask_loss_.backward(view(alpha_, 1), mask, T(params_.mask_weight) * weight_, mask_cache_, dL_dalpha);
        });
        hide_gradient(dL_drender.data);
        hide_gradient(dL_dalpha.data);
        if (halve_chroma_) half_chroma_.backward(dL_drender);
        const RenderGradient<T> dL_dtarget{.color = dL_drender, .alpha = dL_dalpha};
        rasterizer_.backward(camera, splats, backdrop_.background(), dL_dtarget, raster_cache_, dL_dsplats, dL_dcamera);
    }

    /// The rasterizer's cache of the last picture: which splats are visible and, after backward, the norm of the
    /// gradient of each projected centre.
    [[nodiscard]] const RasterCache<B, T>& raster_cache() const { return raster_cache_; }

    // Pictures on the host. These calls overwrite the photograph and the render. -------------------------------------

    /// Renders the splats over the photograph's plate or Params::background, into color [3, height, width]. alpha
    /// [1, height, width] is written if it is given.
    void picture(const Photo& photo, const SplatView<const T>& splats, Image<T>& color, Image<T>* alpha = nullptr) {
        const auto& pixels = pixels_of(photo);
        backdrop_.set_color(params_.background);
        backdrop_.set_plate(*backend_, pixels.plate, pixels.unknown, photo.camera.height, photo.camera.width);
        picture_from(photo.camera, splats, color, alpha);
    }
    /// Renders the splats over the background.
    void picture(const Camera<double>& camera, const SplatView<const T>& splats, Image<T>& color,
                 Image<T>* alpha = nullptr) {
        backdrop_.clear_plate();
        picture_from(camera, splats, color, alpha);
    }
    /// The photograph as it is compared: over its plate or the background, with its mask.
    void photograph(const Photo& photo, Image<T>& color, Image<T>& mask) {
        resize(photo.camera.height, photo.camera.width);
        backdrop_.set_color(params_.background);
        put_photograph(pixels_of(photo), in(mask_, 1));
        color = download(truth_, 3);
        mask = download(mask_, 1);
    }

private:
    using Buffer = typename B::template Buffer<T>;
    /// Whether the image loss reads photographs that are not written out.
    static constexpr bool composites =
        photometric_composites<B> &&
        requires(const ImageLoss& loss, const ImageView<const T>& render, const CompositePicture<T>& truth,
                 typename ImageLoss::Cache& cache) { loss.forward(render, truth, cache); };

    [[nodiscard]] static RasterParams<T> raster_params_of(const Params& params) {
        RasterParams<T> of_raster = raster_params<T>(params.filter);
        of_raster.gradient_transmittance_min = T(params.gradient_transmittance_min);
        return of_raster;
    }
    [[nodiscard]] bool with_mask() const { return params_.mask_weight > 0; }
    [[nodiscard]] std::size_t plane_size() const {
        return static_cast<std::size_t>(height_) * static_cast<std::size_t>(width_);
    }
    void resize(int height, int width) {
        height_ = height, width_ = width;
        render_.resize(3 * plane_size());
    }
    [[nodiscard]] ImageView<T> view(Buffer& buffer, int channels) const { return {buffer, channels, height_, width_}; }
    /// The same after resizing the buffer.
    [[nodiscard]] ImageView<T> in(Buffer& buffer, int channels) const {
        buffer.resize(static_cast<std::size_t>(channels) * plane_size());
        return view(buffer, channels);
    }
    [[nodiscard]] Image<T> download(const Buffer& buffer, int channels) const {
        Image<T> host(channels, height_, width_);
        backend_->download(Span<const T>(buffer), Span<T>(host.data));
        return host;
    }
    /// use(photograph, mask): images, or composited where they are read.
    template <class Use>
    void with_truth(const Use& use) {
        if constexpr (composites) {
            if (is_composited_) return use(composite_, composite_.mask());
        }
        use(view(truth_, 3), with_mask() ? view(mask_, 1) : ImageView<T>{});
    }
    /// At hidden pixels, copies the render to the photograph, or alpha to the mask.
    void hide(const Buffer& render, Buffer& truth) {
        backend_->for_each(detail::unknown_slots(unknown_.size()),
                           detail::HiddenTruth<T>{unknown_, render, truth, plane_size()});
    }
    void hide_gradient(Span<T> dL_drender) {
        backend_->for_each(detail::unknown_slots(dL_drender.empty() ? 0 : unknown_.size()),
                           detail::HiddenGradient<T>{unknown_, dL_drender, plane_size()});
    }
    /// A photograph in host memory or of a source, in the backend's memory until the next call.
    [[nodiscard]] const typename PhotoPixels<B>::View& pixels_of(const Photo& photo) {
        pixels_ = PhotoPixels<B>(*backend_, {photo});
        pixels_.prepare(0);
        return pixels_[0];
    }
    void put_photograph(const typename PhotoPixels<B>::View& pixels, const ImageView<T>& mask) {
        is_composited_ = false;
        backdrop_.photograph(*backend_, pixels.rgba, pixels.box, pixels.plate, pixels.unknown, in(truth_, 3), mask);
    }
    void picture_from(const Camera<double>& camera, const SplatView<const T>& splats, Image<T>& color,
                      Image<T>* alpha) {
        is_composited_ = false; // its pixels or its plate may be gone
        resize(camera.height, camera.width);
        backdrop_.set_color(params_.background);
        rasterizer_.forward(camera.template cast<T>(), splats, backdrop_.background(),
                            {.color = view(render_, 3), .alpha = alpha ? in(alpha_, 1) : ImageView<T>{}},
                            raster_cache_);
        color = download(render_, 3);
        if (alpha) *alpha = download(alpha_, 1);
    }

    B* backend_;
    Params params_;
    PhotoPixels<B> pixels_; // of one photograph: pixels_of
    Backdrop<B, T> backdrop_;
    Renderer rasterizer_;
    HalfChroma<B, T> half_chroma_;
    ImageLoss image_loss_;
    L1Loss<B, T> mask_loss_;

    bool halve_chroma_ = false;        // of the render, before it is compared
    T weight_ = T(1);                  // of the photograph
    int height_ = 0, width_ = 0;       // of the current photograph or picture
    Span<const UnknownPixel> unknown_; // of the current photograph
    bool is_composited_ = false;       // the photograph is read from composite_, not from truth_ and mask_
    CompositePicture<T> composite_;
    Buffer render_, truth_, dL_drender_; // [3, height, width]; they keep the memory of the largest
    Buffer alpha_, mask_, dL_dalpha_;    // [height, width], or empty
    RasterCache<B, T> raster_cache_;
    typename ImageLoss::Cache image_cache_;
    typename L1Loss<B, T>::Cache mask_cache_;
};

} // namespace gsh
