// SPDX-License-Identifier: Apache-2.0
/// @file  Rasterization of arrays of Gaussians with the conventions of gsplat, and its adjoint.

#include "library/rasterization.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"

#include <gsh/image/image.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace gsh_python {

namespace {

using namespace gsh;
using B = cpu::Threads;
template <class U>
using Buffer = B::Buffer<U>;

template <class T>
[[nodiscard]] RasterParams<T> params_of(const ProjectionSettings& settings) {
    RasterParams<T> params;
    params.near_plane = static_cast<T>(settings.near_plane);
    params.dilation = static_cast<T>(settings.eps2d);
    params.compensate_opacity = settings.compensate != 0;
    params.compensation_floor = static_cast<T>(settings.compensation_floor);
    params.alpha_max = static_cast<T>(settings.alpha_max);
    params.transmittance_min = static_cast<T>(settings.transmittance_min);
    params.max_pairs = (std::uint64_t(1) << 32) - 1;
    return params;
}

/// The rasterizer's memory for one image and up to three of its channels.
template <class T>
struct ImagePass {
    RasterCache<B, T> cache;
    Buffer<T> opacities;      // [N] 0 where culled
    Buffer<vec3<T>> colors;   // [N] unless the caller's array serves
    Background<T> background;
    bool own_colors = false;
};

class AnyPass {
public:
    virtual ~AnyPass() = default;
    virtual void backward(B& backend, const ImageGradients& dL, const ScreenGradients& out) = 0;
};

/// A forward pass over all images, and what its backward pass needs. Its memory serves again after release.
template <class T>
class Pass final : public AnyPass {
public:
    void forward(B& backend, const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
                 const ProjectionSettings& settings, const std::int32_t* radii, const ColorArrays& colors,
                 bool with_depth, T* render, T* alphas) {
        sizes_ = sizes, channels_ = static_cast<std::size_t>(colors.channels), per_camera_ = colors.per_camera != 0;
        with_backgrounds_ = colors.backgrounds != nullptr, with_depth_ = with_depth, params_ = params_of<T>(settings);
        width_ = cameras.width, height_ = cameras.height;
        const std::size_t n = count(), images = image_count();
        check_finite<T>("rasterize", "backgrounds", elements<T, T>(colors.backgrounds, 0, images * channels_));
        const std::size_t parts = std::max<std::size_t>(1, (channels_ + 2) / 3);
        passes_.resize(std::max(passes_.size(), images * parts));
        parts_ = parts;
        planes_.resize(5 * plane());
        const Rasterizer<B, T> rasterizer(backend, params_);
        for (std::size_t image = 0; image < images; ++image) {
            const std::size_t batch = image / static_cast<std::size_t>(sizes.cameras);
            const Camera<T> camera = camera_of<T>(cameras, image);
            for (std::size_t part = 0; part < parts; ++part) {
                ImagePass<T>& pass = passes_[image * parts + part];
                select_opacities(backend, elements<T, T>(splats.opacities, batch * n, n), radii + 2 * image * n, pass);
                const Span<const vec3<T>> rgb = colors_of(backend, colors, image, batch, part, pass);
                const SplatView<const T> view{
                    elements<vec3<T>, T>(splats.means, 3 * batch * n, n),
                    elements<sym3<T>, T>(splats.covars, 6 * batch * n, splats.covars ? n : 0),
                    pass.opacities, rgb, elements<mat3<T>, T>(splats.factors, 9 * batch * n, splats.factors ? n : 0)};
                RenderTarget<T> target{plane_view(0, 3)};
                target.alpha = plane_view(3, 1);
                if (with_depth && part == 0) target.expected_depth = plane_view(4, 1);
                rasterizer.forward(camera, view, pass.background, target, pass.cache);
                const std::size_t used = std::min<std::size_t>(3, channels_ - 3 * part);
                T* const out = render + image * plane() * all_channels();
                if (part == 0) {
                    const int depth_channel = with_depth ? static_cast<int>(channels_) : -1;
                    interleave(backend, out, 3 * part, used, depth_channel, alphas + image * plane());
                } else {
                    interleave(backend, out, 3 * part, used, -1, nullptr);
                }
            }
        }
    }

    void backward(B& backend, const ImageGradients& dL, const ScreenGradients& out) override {
        const std::size_t n = count(), all = n * image_count();
        const Rasterizer<B, T> rasterizer(backend, params_);
        planes_.resize(5 * plane());
        const auto clear = [&](void* array, std::size_t numbers) {
            if (array != nullptr) backend.fill(elements<T, T>(array, 0, numbers), T(0));
        };
        clear(out.means2d, 2 * all), clear(out.depths, all), clear(out.conics, 3 * all), clear(out.opacities, all);
        clear(out.absolute_means2d, 2 * all), clear(out.backgrounds, channels_ * image_count());
        clear(out.colors, channels_ * (per_camera_ ? all : n * static_cast<std::size_t>(sizes_.batches)));
        for (std::size_t image = 0; image < image_count(); ++image) {
            const std::size_t batch = image / static_cast<std::size_t>(sizes_.cameras);
            for (std::size_t part = 0; part < parts_; ++part) {
                ImagePass<T>& pass = passes_[image * parts_ + part];
                const std::size_t used = std::min<std::size_t>(3, channels_ - 3 * part);
                RenderGradient<T> gradient;
                if (dL.render != nullptr && used > 0) {
                    for (std::size_t c = 0; c < 3; ++c) read_plane(backend, dL, image, 3 * part + c, c < used, c);
                    gradient.color = const_plane_view(0, 3);
                }
                if (part == 0 && dL.alphas != nullptr) {
                    const auto* const from = static_cast<const T*>(dL.alphas);
                    read_strided(backend, from + static_cast<std::ptrdiff_t>(image) * dL.alpha_strides[0],
                                 dL.alpha_strides[1], dL.alpha_strides[2], planes_.data() + 3 * plane());
                    gradient.alpha = const_plane_view(3, 1);
                }
                if (part == 0 && with_depth_ && dL.render != nullptr) {
                    read_plane(backend, dL, image, channels_, true, 4);
                    gradient.expected_depth = const_plane_view(4, 1);
                }
                ScreenGradient<T> screen;
                screen.means2d = elements<vec2<T>, T>(out.means2d, 2 * image * n, n);
                screen.conics = elements<sym2<T>, T>(out.conics, 3 * image * n, n);
                screen.depths = elements<T, T>(out.depths, image * n, n);
                screen.opacities = elements<T, T>(out.opacities, image * n, n);
                screen.absolute_means2d = elements<vec2<T>, T>(out.absolute_means2d, 2 * image * n, n);
                const std::size_t color_row = (per_camera_ ? image : batch) * n;
                if (out.colors != nullptr && channels_ == 3) {
                    screen.colors = elements<vec3<T>, T>(out.colors, 3 * color_row, n);
                } else if (out.colors != nullptr && used > 0) {
                    dL_dcolors_.resize(n);
                    backend.fill(Span<vec3<T>>(dL_dcolors_), vec3<T>(T(0)));
                    screen.colors = dL_dcolors_;
                }
                vec3<T> dL_dbackground(T(0));
                BackgroundGradient<T> of_background;
                if (out.backgrounds != nullptr) of_background.color = Span<vec3<T>>(&dL_dbackground, 1);
                rasterizer.backward_to_screen(pass.background, gradient, pass.cache, screen, of_background);
                if (out.backgrounds != nullptr)
                    for (std::size_t c = 0; c < used; ++c)
                        static_cast<T*>(out.backgrounds)[image * channels_ + 3 * part + c] =
                            dL_dbackground[static_cast<int>(c)];
                if (out.colors != nullptr && channels_ != 3 && used > 0)
                    add_colors(backend, static_cast<T*>(out.colors) + color_row * channels_ + 3 * part, used);
            }
        }
    }

private:
    Sizes sizes_{};
    std::size_t channels_ = 0, parts_ = 1;
    bool per_camera_ = false, with_backgrounds_ = false, with_depth_ = false;
    int width_ = 0, height_ = 0;
    RasterParams<T> params_;
    std::vector<ImagePass<T>> passes_;
    Buffer<T> planes_;             // red, green, blue, alpha, depth
    Buffer<vec3<T>> dL_dcolors_;

    [[nodiscard]] std::size_t count() const { return static_cast<std::size_t>(sizes_.count); }
    [[nodiscard]] std::size_t image_count() const { return static_cast<std::size_t>(sizes_.batches * sizes_.cameras); }
    [[nodiscard]] std::size_t plane() const {
        return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
    }
    [[nodiscard]] std::size_t all_channels() const { return channels_ + (with_depth_ ? 1 : 0); }
    [[nodiscard]] ImageView<T> plane_view(std::size_t first, int channels) {
        return {Span<T>(planes_.data() + first * plane(), plane() * static_cast<std::size_t>(channels)), channels,
                height_, width_};
    }
    [[nodiscard]] ImageView<const T> const_plane_view(std::size_t first, int channels) {
        return plane_view(first, channels);
    }

    /// Culled Gaussians get the opacity 0, with which the rasterizer leaves them out, too.
    void select_opacities(B& backend, Span<const T> opacities, const std::int32_t* radii, ImagePass<T>& pass) const {
        pass.opacities.resize(count());
        T* const to = pass.opacities.data();
        const T* const from = opacities.data();
        backend.for_chunks(count(), 16384, [=](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                to[i] = radii[2 * i] > 0 && radii[2 * i + 1] > 0 ? from[i] : from[i] * T(0); // a NaN stays
        });
    }

    /// The colours of a part's channels; sets the background of the pass, too.
    [[nodiscard]] Span<const vec3<T>> colors_of(B& backend, const ColorArrays& colors, std::size_t image,
                                                std::size_t batch, std::size_t part, ImagePass<T>& pass) const {
        const std::size_t n = count(), used = std::min<std::size_t>(3, channels_ - 3 * part);
        pass.background = {};
        if (colors.backgrounds != nullptr)
            for (std::size_t c = 0; c < used; ++c)
                pass.background.color[static_cast<int>(c)] =
                    static_cast<const T*>(colors.backgrounds)[image * channels_ + 3 * part + c];
        const std::size_t row = (per_camera_ ? image : batch) * n;
        if (channels_ == 3) return elements<vec3<T>, T>(colors.colors, 3 * row, n);
        pass.colors.resize(n);
        vec3<T>* const to = pass.colors.data();
        const T* const from = static_cast<const T*>(colors.colors) + row * channels_ + 3 * part;
        backend.for_chunks(n, 16384, [=, channels = channels_](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                vec3<T> color(T(0));
                for (std::size_t c = 0; c < used; ++c) color[static_cast<int>(c)] = from[i * channels + c];
                to[i] = color;
            }
        });
        return pass.colors;
    }

    void add_colors(B& backend, T* to, std::size_t used) const {
        const vec3<T>* const from = dL_dcolors_.data();
        backend.for_chunks(count(), 16384, [=, channels = channels_](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                for (std::size_t c = 0; c < used; ++c) to[i * channels + c] += from[i][static_cast<int>(c)];
        });
    }

    /// Writes `used` colour planes to channels from `first` on, the depth to its channel, and alpha.
    void interleave(B& backend, T* render, std::size_t first, std::size_t used, int depth_channel, T* alphas) const {
        const std::size_t pixels = plane(), channels = all_channels();
        const T* const planes = planes_.data();
        backend.for_chunks(pixels, 16384, [=](std::size_t, std::size_t begin, std::size_t end) {
            if (used == 3 && channels == 3) { // the usual case, with strides that the compiler knows
                for (std::size_t p = begin; p < end; ++p)
                    for (std::size_t c = 0; c < 3; ++c) render[3 * p + c] = planes[c * pixels + p];
            } else {
                for (std::size_t p = begin; p < end; ++p)
                    for (std::size_t c = 0; c < used; ++c) render[channels * p + first + c] = planes[c * pixels + p];
            }
            if (depth_channel >= 0)
                for (std::size_t p = begin; p < end; ++p)
                    render[channels * p + static_cast<std::size_t>(depth_channel)] = planes[4 * pixels + p];
            if (alphas != nullptr) std::copy(planes + 3 * pixels + begin, planes + 3 * pixels + end, alphas + begin);
        });
    }

    /// One channel of dL.render into a plane; zeros if it is not one of the caller's.
    void read_plane(B& backend, const ImageGradients& dL, std::size_t image, std::size_t channel, bool exists,
                    std::size_t to) {
        T* const out = planes_.data() + to * plane();
        if (!exists) {
            std::fill(out, out + plane(), T(0));
            return;
        }
        const T* const from = static_cast<const T*>(dL.render) +
                              static_cast<std::ptrdiff_t>(image) * dL.render_strides[0] +
                              static_cast<std::ptrdiff_t>(channel) * dL.render_strides[3];
        read_strided(backend, from, dL.render_strides[1], dL.render_strides[2], out);
    }
    void read_strided(B& backend, const T* from, std::int64_t row_stride, std::int64_t column_stride, T* to) const {
        const auto width = static_cast<std::size_t>(width_);
        backend.for_chunks(static_cast<std::size_t>(height_), 32, [=](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t y = begin; y < end; ++y) {
                const T* const row = from + static_cast<std::ptrdiff_t>(y) * row_stride;
                T* const out = to + y * width;
                if (column_stride == 1) std::copy_n(row, width, out);
                else if (column_stride == 3)
                    for (std::size_t x = 0; x < width; ++x) out[x] = row[3 * x];
                else
                    for (std::size_t x = 0; x < width; ++x)
                        out[x] = row[static_cast<std::ptrdiff_t>(x) * column_stride];
            }
        });
    }
};

/// Released passes, whose memory serves the next ones: a training step then allocates nothing.
template <class T>
class Pool {
public:
    [[nodiscard]] std::unique_ptr<Pass<T>> take() {
        const std::lock_guard lock(mutex_);
        if (free_.empty()) return std::make_unique<Pass<T>>();
        std::unique_ptr<Pass<T>> pass = std::move(free_.back());
        free_.pop_back();
        return pass;
    }
    void give(std::unique_ptr<Pass<T>> pass) {
        const std::lock_guard lock(mutex_);
        if (free_.size() < 2) free_.push_back(std::move(pass));
    }
    void clear() {
        const std::lock_guard lock(mutex_);
        free_.clear();
    }
    [[nodiscard]] static Pool& instance() {
        static Pool pool;
        return pool;
    }

private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<Pass<T>>> free_;
};

template <class T>
void run_forward(const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
                 const ProjectionSettings& settings, const std::int32_t* radii, const ColorArrays& colors,
                 int with_depth, void* render, void* alphas, void** pass) {
    std::unique_ptr<Pass<T>> mine = Pool<T>::instance().take();
    mine->forward(threads(sizes.threads), sizes, splats, cameras, settings, radii, colors, with_depth != 0,
                  static_cast<T*>(render), static_cast<T*>(alphas));
    *pass = static_cast<AnyPass*>(mine.release());
}

} // namespace

int rasterize(const Sizes& sizes, const SplatArrays& splats, const CameraArrays& cameras,
              const ProjectionSettings& settings, const std::int32_t* radii, const ColorArrays& colors, int with_depth,
              void* render, void* alphas, void** pass) {
    return guarded([&] {
        if (sizes.scalar_bytes == 4)
            run_forward<float>(sizes, splats, cameras, settings, radii, colors, with_depth, render, alphas, pass);
        else
            run_forward<double>(sizes, splats, cameras, settings, radii, colors, with_depth, render, alphas, pass);
    });
}

int rasterize_backward(void* pass, int thread_count, const ImageGradients& dL, const ScreenGradients& out) {
    return guarded([&] { static_cast<AnyPass*>(pass)->backward(threads(thread_count), dL, out); });
}

void release(void* pass) {
    auto* const any = static_cast<AnyPass*>(pass);
    if (auto* const single = dynamic_cast<Pass<float>*>(any))
        Pool<float>::instance().give(std::unique_ptr<Pass<float>>(single));
    else Pool<double>::instance().give(std::unique_ptr<Pass<double>>(static_cast<Pass<double>*>(any)));
}

void release_memory() {
    Pool<float>::instance().clear();
    Pool<double>::instance().clear();
}

} // namespace gsh_python
