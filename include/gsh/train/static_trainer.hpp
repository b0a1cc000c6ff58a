// SPDX-License-Identifier: Apache-2.0
/// @file  Training a static scene: 3D Gaussian splatting of one moment, seen from many sides.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/schedule.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/train/backdrop.hpp>
#include <gsh/train/density_control.hpp>
#include <gsh/train/photo.hpp>
#include <gsh/train/step_images.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Steps of gradient descent per attribute.
struct StaticRates {
    double means = 1.6e-4, final_means = 1.6e-6; ///< of the scene's extent, falling geometrically
    double quats = 1e-3;
    double log_scales = 5e-3;
    double opacity_logits = 0.05;
    double sh = 2.5e-3;        ///< the constant coefficient
    double sh_bands = 0.05;    ///< share of it at which the higher bands move
};

/// Every number of Kerbl et al. for a run of 30,000 steps; static_config(steps) fits them to another budget.
struct StaticConfig {
    std::int64_t steps = 30000; ///< after which the means' rate has fallen to its end
    StaticRates rates = {};
    DensityParams density = {};
    int sh_degree = 3;                  ///< at the end; training starts with 0
    std::int64_t sh_interval = 1000;    ///< steps between degrees
    double extent = 0;                  ///< metres; 0: from the cameras, see scene_extent
    double ssim_weight = 0.2;
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, in training and in test
    PixelFilter filter = {};            ///< the usual one, so that any viewer shows the PLY as it was trained
};

/// The settings for a budget of steps: what 3DGS does at a share of its 30,000 happens at the same share of these. A
/// change still sums up 25 views, and opacities have 250 steps to recover from a reset.
[[nodiscard]] inline StaticConfig static_config(std::int64_t steps) {
    check_value(steps > 0, "static_config", "steps is " + std::to_string(steps) + ", expected at least 1");
    StaticConfig config;
    const auto scaled = [&](std::int64_t of_30000, std::int64_t least) {
        return std::max(least, of_30000 * steps / 30000);
    };
    config.steps = steps;
    config.density.start = scaled(config.density.start, 50);
    config.density.stop = scaled(config.density.stop, 1);
    config.density.interval = scaled(config.density.interval, 25);
    config.density.reset_interval = scaled(config.density.reset_interval, 250);
    config.sh_interval = scaled(config.sh_interval, 1);
    return config;
}

/// 1.1 times the largest distance of a camera from the middle of all, metres: the length to which 3DGS relates rates of
/// positions and sizes.
/// Errors  ValueError for cameras that stand in one place: they say nothing about the scene's size.
[[nodiscard]] inline double scene_extent(const std::vector<Photo>& photos) {
    check_value(!photos.empty(), "scene_extent", "there are no photographs");
    vec3<double> middle(0.0);
    for (const Photo& photo : photos) middle += photo.camera.center() / static_cast<double>(photos.size());
    double radius = 0;
    for (const Photo& photo : photos) radius = std::max(radius, length(photo.camera.center() - middle));
    check_value(radius > 0, "scene_extent", "all cameras stand in one place; give the scene's extent in metres");
    return 1.1 * radius;
}

namespace detail {

/// Coefficient i of a wider table; new columns are zero.
template <class T>
struct WidenSh {
    Span<const vec3<T>> from;
    std::size_t from_basis, to_basis;
    Span<vec3<T>> to;

    GSH_HD void operator()(std::size_t i) const {
        const std::size_t row = i / to_basis, column = i % to_basis;
        to[i] = column < from_basis ? from[row * from_basis + column] : vec3<T>(T(0));
    }
};

} // namespace detail

/// Trains Gaussians on photographs of one moment, with adaptive density control.
///
/// A step sees one photograph; an epoch sees each once, in an order that depends on seed and epoch alone. Colours begin
/// with degree 0 of spherical harmonics and gain a degree every sh_interval steps. Photo::frame is not read.
///
/// Errors  ValueError: no photographs, no Gaussians, more of them than max_gaussians, a degree beyond StaticConfig's.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023.
template <Backend B, std::floating_point T = float>
class StaticTrainer {
public:
    using Scalar = T;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// `start` may hold any degree up to the last one; initial_gaussians (train/static_start.hpp) makes one.
    StaticTrainer(B& backend, const GaussianCloud<T>& start, std::vector<Photo> photos, std::uint64_t seed,
                  const StaticConfig& config = {})
        : backend_(&backend), photos_(std::move(photos)), seed_(seed), config_(config),
          extent_(config.extent != 0 ? config.extent : scene_extent(photos_)),
          rasterizer_(backend, raster_params<T>(config.filter)), loss_(backend, {.ssim_weight = T(config.ssim_weight)}),
          density_(backend, config.density, extent_, random_bits(seed, 1)) {
        constexpr const char* where = "StaticTrainer";
        check_value(!photos_.empty(), where, "there are no photographs to train on");
        for (const Photo& photo : photos_) check_photo(photo);
        check_value(start.size() > 0, where, "there are no Gaussians to start with");
        check_value(start.size() <= config.density.max_gaussians, where,
                    "starts with " + std::to_string(start.size()) + " Gaussians, max_gaussians is " +
                        std::to_string(config.density.max_gaussians));
        check_value(config.sh_degree >= 0 && config.sh_degree <= 4, where, "sh_degree must be 0 to 4");
        check_value(start.sh_degree <= config.sh_degree, where,
                    "starts with degree " + std::to_string(start.sh_degree) + " of spherical harmonics, sh_degree is " +
                        std::to_string(config.sh_degree));
        check_value(config.steps > 0 && config.sh_interval > 0, where, "steps and sh_interval must be at least 1");
        upload(backend, start, gaussians_);
        for (Gaussians<B, T>* like : {&gradient_, &first_moment_, &second_moment_}) {
            like->resize(start.size(), start.sh_degree);
            fill_zero(backend, like->view());
        }
        density_.restart(start.size());
    }

    [[nodiscard]] std::uint64_t step_count() const { return step_count_; }
    [[nodiscard]] std::size_t size() const { return gaussians_.size(); }
    [[nodiscard]] const std::vector<Photo>& photos() const { return photos_; }
    [[nodiscard]] std::uint64_t seed() const { return seed_; }
    [[nodiscard]] const StaticConfig& config() const { return config_; }
    [[nodiscard]] double extent() const { return extent_; }
    [[nodiscard]] B& backend() { return *backend_; }
    /// Changes since the beginning, added up.
    [[nodiscard]] const DensityChange& total_change() const { return total_change_; }

    /// The Gaussians as they are, in host memory.
    [[nodiscard]] GaussianCloud<T> cloud() { return download(*backend_, gaussians_); }

    [[nodiscard]] std::size_t photo_of_step(std::uint64_t step) {
        const std::uint64_t epoch = step / photos_.size();
        if (order_.empty() || epoch != order_epoch_) {
            order_ =
                shuffled_indices(static_cast<std::uint32_t>(photos_.size()), random_bits(random_bits(seed_, 2), epoch));
            order_epoch_ = epoch;
        }
        return order_[step % photos_.size()];
    }

    /// Takes one step.
    /// Errors  ValueError if nothing is left after pruning.
    void step() {
        const Photo& photo = photos_[photo_of_step(step_count_)];
        const Camera<T> camera = photo.camera.template cast<T>();
        upload_photo(photo);
        draw(camera, {});
        loss_.forward(images_.render(), images_.truth(), loss_cache_);
        backward(camera);
        update();
        adapt();
    }

    /// Loss of the last step; waits for it.
    [[nodiscard]] PhotometricValues last_loss() const { return loss_.values(loss_cache_); }

    /// PSNR of the last step's render against its photograph, before the step's update.
    [[nodiscard]] double last_psnr() const { return images_.psnr(*backend_); }

    /// Renders a photograph's view.
    void render(const Photo& photo, Image<T>& color) { render(photo.camera, photo.frame, color); }

    /// Renders the scene: colour [3, height, width] over the background, and alpha if asked. There is but one frame.
    void render(const Camera<double>& camera, std::size_t /*frame*/, Image<T>& color, Image<T>* alpha = nullptr) {
        images_.resize(camera.height, camera.width);
        images_.take(*backend_, images_.render(), color, alpha,
                     [&](const ImageView<T>& plane) { draw(camera.template cast<T>(), plane); });
    }

    /// A photograph as training sees it, on the host: over the background, with its mask's alpha.
    void photo_pixels(const Photo& photo, Image<T>& color, Image<T>& alpha) {
        check_photo(photo);
        images_.resize(photo.camera.height, photo.camera.width);
        images_.take(*backend_, images_.truth(), color, &alpha,
                     [&](const ImageView<T>& mask) { upload_photo(photo, mask); });
    }

private:
    static void check_photo(const Photo& photo) {
        check_camera("StaticTrainer", photo.name, photo.camera);
        check_size("StaticTrainer", photo.name, photo.rgba.size(),
                   4 * static_cast<std::size_t>(photo.camera.width) * static_cast<std::size_t>(photo.camera.height),
                   "the image must have its camera's size");
    }

    /// truth = the photograph over the background.
    void upload_photo(const Photo& photo, const ImageView<T>& alpha = {}) {
        images_.resize(photo.camera.height, photo.camera.width);
        backdrop_.photograph(*backend_, photo.rgba, {}, images_.truth(), alpha); // a room is part of a static scene
    }

    void draw(const Camera<T>& camera, const ImageView<T>& alpha) {
        splats_.resize(size());
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            static_splats_forward<decltype(degree)::value>(*backend_, std::as_const(gaussians_).view(), camera.center(),
                                                           splats_.view());
        });
        rasterizer_.forward(camera, std::as_const(splats_).view(), backdrop_.background(),
                            {.color = images_.render(), .alpha = alpha}, raster_cache_);
    }

    void backward(const Camera<T>& camera) {
        backend_->fill(images_.dL_drender().data, T(0));
        loss_.backward(images_.render(), images_.truth(), T(1), loss_cache_, images_.dL_drender());
        dL_dsplats_.resize(size());
        const SplatView<T> gradient = dL_dsplats_.view();
        fill_zero(*backend_, gradient);
        rasterizer_.backward(camera, std::as_const(splats_).view(), backdrop_.background(),
                             {.color = images_.dL_drender()}, raster_cache_, gradient);
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            static_splats_backward<decltype(degree)::value>(*backend_, std::as_const(gaussians_).view(),
                                                            camera.center(), std::as_const(dL_dsplats_).view(),
                                                            workspace_, gradient_.view());
        });
    }

    /// A step of Adam for every attribute; the gradients are zero afterwards.
    void update() {
        const auto step = static_cast<std::int64_t>(step_count_++);
        const StaticRates& rates = config_.rates;
        const auto move = [&](auto attribute, double rate) {
            adam_.step(*backend_, numbers(gaussians_.*attribute), numbers(gradient_.*attribute),
                       numbers(first_moment_.*attribute), numbers(second_moment_.*attribute), rate, step + 1,
                       UsedGradients::zero);
        };
        move(&Gaussians<B, T>::means,
             extent_ * Schedule::exponential(rates.means, rates.final_means, config_.steps).rate(step));
        move(&Gaussians<B, T>::quats, rates.quats);
        move(&Gaussians<B, T>::log_scales, rates.log_scales);
        move(&Gaussians<B, T>::opacity_logits, rates.opacity_logits);
        adam_.step_columns(*backend_, numbers(gaussians_.sh), numbers(gradient_.sh), numbers(first_moment_.sh),
                           numbers(second_moment_.sh),
                           3 * static_cast<std::size_t>(sh_basis_count(gaussians_.sh_degree)), 3, rates.sh,
                           rates.sh * rates.sh_bands, step + 1, UsedGradients::zero);
    }

    /// Changes in number and degree that are due after the step.
    void adapt() {
        const auto step = static_cast<std::int64_t>(step_count_);
        density_.observe(raster_cache_);
        const DensityChange change = density_.after_step(step, gaussians_, first_moment_, second_moment_);
        total_change_.cloned += change.cloned, total_change_.split += change.split,
            total_change_.pruned += change.pruned;
        check_value(size() > 0, "StaticTrainer",
                    "no Gaussian is left after step " + std::to_string(step) +
                        "; do the cameras see the starting points?");
        const bool wider = gaussians_.sh_degree < config_.sh_degree && step % config_.sh_interval == 0;
        if (wider)
            for (Gaussians<B, T>* gaussians : {&gaussians_, &first_moment_, &second_moment_}) raise_degree(*gaussians);
        if (change.changed() || wider) {
            gradient_.resize(size(), gaussians_.sh_degree);
            fill_zero(*backend_, gradient_.view());
        }
    }

    void raise_degree(Gaussians<B, T>& gaussians) {
        const auto basis = [](int degree) { return static_cast<std::size_t>(sh_basis_count(degree)); };
        const int degree = gaussians.sh_degree + 1;
        Buffer<vec3<T>> sh(gaussians.size() * basis(degree));
        backend_->for_each(sh.size(), detail::WidenSh<T>{gaussians.sh, basis(degree - 1), basis(degree), sh});
        std::swap(gaussians.sh, sh);
        gaussians.sh_degree = degree;
    }

    // Vectors, quaternions and the like as the numbers that they are made of.
    static Span<T> numbers(auto& buffer) { return view_as<T>(Span(buffer.data(), buffer.size())); }

    B* backend_;
    std::vector<Photo> photos_;
    std::uint64_t seed_;
    StaticConfig config_;
    double extent_;
    Rasterizer<B, T> rasterizer_;
    PhotometricLoss<B, T> loss_;
    DensityControl<B, T> density_;
    Adam adam_;

    std::uint64_t step_count_ = 0;
    DensityChange total_change_;
    std::vector<std::uint32_t> order_;
    std::uint64_t order_epoch_ = 0;

    StepImages<B, T> images_;
    Backdrop<B, T> backdrop_{config_.background};
    Gaussians<B, T> gaussians_, gradient_, first_moment_, second_moment_;
    Splats<B, T> splats_, dL_dsplats_;
    StaticSplatsWorkspace<B, T> workspace_;
    typename Rasterizer<B, T>::Cache raster_cache_;
    typename PhotometricLoss<B, T>::Cache loss_cache_;
};

} // namespace gsh
