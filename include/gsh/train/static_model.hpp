// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene that learns: 3D Gaussian splatting of one moment, with density control.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/optim/schedule.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/train/splat_scene.hpp>
#include <gsh/train/train_params.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Learning rates of the attributes.
struct StaticRates {
    double means = 1.6e-4, final_means = 1.6e-6; ///< shares of the extent; the rate falls geometrically
    double quats = 1e-3;
    double log_scales = 5e-3;
    double opacity_logits = 0.05;
    double sh = 2.5e-3;               ///< of the constant coefficient
    double sh_bands = sh_band_share;  ///< of higher bands, as a share of sh

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("rate.means", self.means, SettingRange::at_least(0));
        f("rate.final_means", self.final_means, SettingRange::at_least(0));
        f("rate.quats", self.quats, SettingRange::at_least(0));
        f("rate.log_scales", self.log_scales, SettingRange::at_least(0));
        f("rate.opacity_logits", self.opacity_logits, SettingRange::at_least(0));
        f("rate.sh", self.sh, SettingRange::at_least(0));
        f("rate.sh_bands", self.sh_bands, SettingRange::at_least(0));
    }
};

/// The settings of Kerbl et al., "3D Gaussian Splatting", 2023, for a run of 30,000 steps. static_model_params(steps)
/// adapts them to another number of steps.
struct StaticModelParams {
    std::int64_t steps = 30000; ///< after which the means' rate is final_means
    StaticRates rates = {};
    DensityParams density = {};
    int sh_degree = 3;                  ///< at the end; training starts with 0
    std::int64_t sh_interval = 1000;    ///< steps between degrees
    double extent = 0;                  ///< metres; 0: computed from the cameras, see scene_extent
    double ssim_weight = PhotometricParams<double>().ssim_weight;
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, in training and in test
    PixelFilter filter = {};            ///< the usual one, so that any viewer shows the PLY as trained

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        StaticRates::for_each_setting(self.rates, f);
        DensityParams::for_each_setting(self.density, f);
        f("sh_degree", self.sh_degree, SettingRange::at_least(0).up_to(4));
        f("sh_interval", self.sh_interval, SettingRange::at_least(1));
        f("extent", self.extent, SettingRange::at_least(0));
        f("ssim_weight", self.ssim_weight, SettingRange::share());
        PixelFilter::for_each_setting(self.filter, f);
    }
};
/// The former name of StaticModelParams.
using StaticConfig [[deprecated("use StaticModelParams")]] = StaticModelParams;

/// The settings for another number of steps, in the same proportions as 3DGS's 30,000. A change still collects at least
/// 25 views, and at least 250 steps lie between two resets of opacities.
[[nodiscard]] inline StaticModelParams static_model_params(std::int64_t steps) {
    check_value(steps > 0, "static_model_params", "steps is " + std::to_string(steps) + ", expected at least 1");
    StaticModelParams config;
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

/// The extent of a scene, metres: 1.1 times the largest distance of a camera from the mean of all. 3DGS relates rates
/// of positions and sizes to it.
/// Errors  ValueError for no photographs, or cameras that all stand in one place.
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

/// Coefficient i of a wider table. New columns are zero.
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

/// Gaussians of one moment that learn from photographs. Density control changes their number. Colours start with degree
/// 0 of spherical harmonics and gain a degree every sh_interval steps. Every frame shows the same moment.
///
/// Errors  ValueError: no Gaussians, more than max_gaussians, a degree beyond StaticModelParams::sh_degree; after a
///         step, if pruning leaves none.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023.
template <Backend B, std::floating_point T = float>
class StaticModel : public PlainScene<B, T> {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    /// Nothing bounds the length of a Gaussian, so a trainer takes factors of covariances.
    static constexpr bool has_needles = true;

    /// `start` may have any degree up to the last one; initial_gaussians (setup/static_start.hpp) makes it. `extent` is
    /// in metres, see scene_extent. `seed` is the seed of the run.
    StaticModel(B& backend, const GaussianCloud<T>& start, double extent, std::uint64_t seed,
                const StaticModelParams& config = {})
        : backend_(&backend), config_(config), extent_(extent),
          density_(backend, config.density, extent, random_bits(seed, 1)) {
        constexpr const char* where = "StaticModel";
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

    [[nodiscard]] std::size_t size() const { return gaussians_.size(); }
    [[nodiscard]] std::size_t frame_count() const { return std::numeric_limits<std::size_t>::max(); }
    [[nodiscard]] const StaticModelParams& config() const { return config_; }
    [[nodiscard]] double extent() const { return extent_; }
    /// The sum of all changes so far.
    [[nodiscard]] const DensityChange& total_change() const { return total_change_; }
    /// The present Gaussians, in host memory.
    [[nodiscard]] GaussianCloud<T> cloud() { return download(*backend_, gaussians_); }

    void set_progress(std::uint64_t step, double /*progress*/) { step_ = static_cast<std::int64_t>(step); }

    void forward(std::size_t /*frame*/, const Deferred<vec3<T>>& center, const SplatView<T>& splats) {
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            to_splats<decltype(degree)::value>().forward(std::as_const(gaussians_).view(), center, splats,
                                                         splats_cache_);
        });
    }
    void backward(std::size_t /*frame*/, const Deferred<vec3<T>>& center, const SplatView<const T>& dL_dsplats,
                  Span<vec3<T>> /*dL_dcenter*/) {
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            to_splats<decltype(degree)::value>().backward(std::as_const(gaussians_).view(), center, dL_dsplats,
                                                          splats_cache_, gradient_.view());
        });
    }

    [[nodiscard]] LearnedArrays<T> learned() {
        const StaticRates& rates = config_.rates;
        const auto array = [&](std::string name, auto attribute, double rate) {
            return LearnedArray<T>{.name = std::move(name),
                                   .values = numbers(gaussians_.*attribute),
                                   .gradient = numbers(gradient_.*attribute),
                                   .first_moment = numbers(first_moment_.*attribute),
                                   .second_moment = numbers(second_moment_.*attribute),
                                   .rate = rate};
        };
        using G = Gaussians<B, T>;
        LearnedArrays<T> arrays{
            array("means", &G::means,
                  extent_ * Schedule::exponential(rates.means, rates.final_means, config_.steps).rate(step_)),
            array("quats", &G::quats, rates.quats), array("log_scales", &G::log_scales, rates.log_scales),
            array("opacity_logits", &G::opacity_logits, rates.opacity_logits), array("sh", &G::sh, rates.sh)};
        arrays.back().other = {LearnedArray<T>::OtherRate::Where::columns,
                               3 * static_cast<std::size_t>(sh_basis_count(gaussians_.sh_degree)), 3,
                               rates.sh * rates.sh_bands};
        return arrays;
    }

    /// Changes the number of Gaussians and the degree, if the schedule has it after this step.
    void after_step(const RasterCache<B, T>& raster_cache) {
        const std::int64_t steps = step_ + 1;
        density_.observe(raster_cache);
        const DensityChange change = density_.after_step(steps, gaussians_, first_moment_, second_moment_);
        total_change_.cloned += change.cloned, total_change_.split += change.split,
            total_change_.pruned += change.pruned;
        check_value(size() > 0, "StaticModel",
                    "no Gaussian is left after step " + std::to_string(steps) +
                        "; do the cameras see the starting points?");
        const bool wider = gaussians_.sh_degree < config_.sh_degree && steps % config_.sh_interval == 0 &&
                           !has_halted(*backend_); // else the step will be taken again
        if (wider)
            for (Gaussians<B, T>* gaussians : {&gaussians_, &first_moment_, &second_moment_}) raise_degree(*gaussians);
        if (change.changed() || wider) {
            gradient_.resize(size(), gaussians_.sh_degree);
            fill_zero(*backend_, gradient_.view());
        }
    }

private:
    template <int Degree>
    [[nodiscard]] StaticSplats<B, Degree, T> to_splats() const {
        return StaticSplats<B, Degree, T>(*backend_);
    }
    void raise_degree(Gaussians<B, T>& gaussians) {
        const auto basis = [](int degree) { return static_cast<std::size_t>(sh_basis_count(degree)); };
        const int degree = gaussians.sh_degree + 1;
        Buffer<vec3<T>> sh(gaussians.size() * basis(degree));
        backend_->for_each(sh.size(), detail::WidenSh<T>{gaussians.sh, basis(degree - 1), basis(degree), sh});
        std::swap(gaussians.sh, sh);
        gaussians.sh_degree = degree;
    }
    // A buffer of vectors or quaternions as a span of numbers.
    static Span<T> numbers(auto& buffer) { return view_as<T>(Span(buffer.data(), buffer.size())); }

    B* backend_;
    StaticModelParams config_;
    double extent_;
    DensityControl<B, T> density_;
    DensityChange total_change_;
    std::int64_t step_ = 0;
    Gaussians<B, T> gaussians_, gradient_, first_moment_, second_moment_;
    StaticSplatsCache<B, T> splats_cache_;
};

/// TrainParams of a static scene. Rates follow the model's own schedule, and the background is constant.
[[nodiscard]] inline TrainParams train_params_of(const StaticModelParams& config) {
    return {.decay_start = 1,
            .final_rate = 1,
            .ssim_weight = config.ssim_weight,
            .background = config.background,
            .random_background = false,
            .filter = config.filter}; // without gains: of one photograph of each camera, they would be the mean
}

/// The seed for the Trainer of a static scene, which determines the order of the photographs. StaticModel takes `seed`
/// itself.
[[nodiscard]] inline std::uint64_t static_order_seed(std::uint64_t seed) {
    return random_bits(seed, 2);
}

} // namespace gsh
