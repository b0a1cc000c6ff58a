// SPDX-License-Identifier: Apache-2.0
/// @file  Adaptive density control: clones and splits Gaussians where gradients are large, removes faint ones.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/learn/density_descent.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/raster_cache.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// When Gaussians are cloned, split and pruned, and which. Steps count from 1. Sizes are shares of the scene's extent.
struct DensityParams {
    double gradient_threshold = 2e-4;  ///< mean |dL/d center|; half the image's longer side is 1
    std::int64_t start = 500;          ///< no changes up to this step
    std::int64_t stop = 15000;         ///< no changes from this step on
    std::int64_t interval = 100;       ///< steps between changes; gradients are averaged over them
    std::int64_t reset_interval = 3000; ///< steps between opacity resets; 0: none
    double small = 0.01;               ///< a Gaussian whose longest axis is at most this is cloned, otherwise split
    double large = 0.1;                ///< a Gaussian with a longer axis is removed, once opacities were reset
    double large_on_screen = 0;        ///< the same for its radius in pixels (three sigma) in any view; 0: no limit
    double min_opacity = 0.005;        ///< Gaussians of lower opacity are removed
    double reset_opacity = 0.01;       ///< largest opacity after a reset
    double split_factor = 1.6;         ///< a split Gaussian's axes are divided by this
    int split_count = 2;               ///< number of Gaussians that replace a split one
    std::size_t max_gaussians = 2'000'000; ///< hard limit; the largest gradients have precedence

    [[nodiscard]] bool adapts_after(std::int64_t step) const {
        return step > start && step < stop && step % interval == 0;
    }
    [[nodiscard]] bool resets_after(std::int64_t step) const {
        return reset_interval > 0 && step < stop && step % reset_interval == 0;
    }
    [[nodiscard]] bool prunes_large_after(std::int64_t step) const {
        return reset_interval > 0 && step > reset_interval;
    }

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("density.gradient_threshold", self.gradient_threshold, SettingRange::above(0));
        f("density.start", self.start, SettingRange::at_least(0));
        f("density.stop", self.stop, SettingRange::at_least(0));
        f("density.interval", self.interval, SettingRange::at_least(1));
        f("density.reset_interval", self.reset_interval, SettingRange::at_least(0));
        f("density.small", self.small, SettingRange::above(0));
        f("density.large", self.large, SettingRange::above(0));
        f("density.large_on_screen", self.large_on_screen, SettingRange::at_least(0));
        f("density.min_opacity", self.min_opacity, SettingRange::above(0).below(1));
        f("density.reset_opacity", self.reset_opacity, SettingRange::above(0).below(1));
        f("density.split_factor", self.split_factor, SettingRange::at_least(1));
        f("density.split_count", self.split_count, SettingRange::at_least(1));
    }
};

namespace detail {

template <class T>
struct ObserveSplats {
    Span<const std::uint8_t> visible;
    Span<const T> gradient_norms;
    Span<const T> screen_radii;
    T unit; ///< pixels
    Span<T> gradient_sums;
    Span<std::uint32_t> view_counts;
    Span<T> radii;
    Span<const std::uint32_t> halt; ///< halt_word

    GSH_HD void operator()(std::size_t i) const {
        if (is_halted(halt) || !visible[i]) return;
        gradient_sums[i] += gradient_norms[i] * unit;
        ++view_counts[i];
        radii[i] = max(radii[i], screen_radii[i]);
    }
};

template <class T>
struct DecideFates {
    GaussiansView<const T> gaussians;
    Span<const T> gradient_sums;
    Span<const std::uint32_t> view_counts;
    Span<const T> radii;
    T threshold, small, large, large_on_screen, min_opacity_logit; // small and large as logarithms
    Span<Fate> fates;
    Span<T> gradients;

    GSH_HD void operator()(std::size_t i) const {
        const vec3<T>& s = gaussians.log_scales[i];
        const T size = max(s.x, max(s.y, s.z));
        const T gradient = view_counts[i] == 0 ? T(0) : gradient_sums[i] / static_cast<T>(view_counts[i]);
        const bool busy = gradient >= threshold, faint = gaussians.opacity_logits[i] < min_opacity_logit;
        const bool too_large = size > large || radii[i] > large_on_screen;
        gradients[i] = gradient;
        fates[i] = faint                  ? Fate::prune
                   : busy && size > small ? Fate::split
                   : too_large            ? Fate::prune
                   : busy                 ? Fate::clone
                                          : Fate::keep;
    }
};

template <class T>
struct LimitFromAbove {
    Span<T> values;
    T limit;
    GSH_HD void operator()(std::size_t i) const { values[i] = min(values[i], limit); }
};

} // namespace detail

/// Collects gradients of the rasterizer's backward passes. At scheduled steps it clones, splits and prunes Gaussians
/// together with Adam's moments.
///
///     busy = mean over the views that saw it of |dL/d center| >= gradient_threshold
///     opacity < min_opacity: pruned;  busy and large: split;  too large: pruned;  busy and small: cloned
///
/// A clone is an exact copy. A split replaces a Gaussian by samples of it, with axes divided by split_factor. Copies
/// and parts start with moments of zero; a Gaussian that stays keeps its moments. The order is that of the parents.
///
/// Units   gradients are of the loss with respect to the projected mean, in halves of the image's longer side:
///         normalised device coordinates, for a square image.
/// Source  Kerbl et al., "3D Gaussian Splatting", 2023, §5 and its code, with two differences. Parts that are still too
///         large are removed at the next change, not at once. That code clears the radii on the screen before it
///         applies their limit; here the limit works, and is off by default.
template <Backend B, std::floating_point T = float>
class DensityControl {
public:
    using Params = DensityParams;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Units   extent in metres: the radius of what the cameras see, or of their circle (scene_extent).
    /// Errors  ValueError for settings out of range.
    DensityControl(B& backend, const Params& params, double extent, std::uint64_t seed)
        : backend_(&backend), params_(params), extent_(extent), seed_(seed) {
        constexpr const char* where = "DensityControl";
        check_value(extent > 0 && std::isfinite(extent), where,
                    "extent is " + detail::number_text(extent) + ", expected metres above 0");
        check_value(params.interval > 0, where, "interval must be at least 1 step");
        check_value(params.gradient_threshold > 0, where, "gradient_threshold must be positive");
        check_value(params.min_opacity > 0 && params.min_opacity < 1 && params.reset_opacity > 0 &&
                        params.reset_opacity < 1,
                    where, "min_opacity and reset_opacity must lie between 0 and 1");
        check_value(params.reset_opacity > params.min_opacity, where,
                    "reset_opacity must exceed min_opacity, or a reset prunes everything");
        check_value(params.small > 0 && params.large > 0 && params.large_on_screen >= 0, where,
                    "small and large must be positive, large_on_screen not negative");
        check_value(params.split_factor >= 1, where, "split_factor must be at least 1");
        check_value(params.split_count >= 1, where, "split_count must be at least 1");
        check_value(params.max_gaussians < std::numeric_limits<std::uint32_t>::max(), where,
                    "max_gaussians must fit 32 bits");
    }

    [[nodiscard]] const Params& params() const { return params_; }

    /// Clears the statistics. From now on there are `count` Gaussians.
    void restart(std::size_t count) {
        for (Buffer<T>* buffer : {&gradient_sums_, &radii_}) {
            buffer->resize(count);
            backend_->fill(Span<T>(*buffer), T(0));
        }
        view_counts_.resize(count);
        backend_->fill(Span<std::uint32_t>(view_counts_), 0u);
    }

    /// Adds one view to the statistics, after Rasterizer::backward.
    /// Errors  ShapeError if the number of Gaussians is not that of the last change or restart.
    void observe(const RasterCache<B, T>& cache) {
        constexpr const char* where = "DensityControl::observe";
        const std::size_t count = gradient_sums_.size();
        check_size(where, "cache.visible", cache.visible.size(), count, "call restart when Gaussians change elsewhere");
        check_size(where, "cache.screen_gradient_norms", cache.screen_gradient_norms.size(), count, "after backward");
        check_size(where, "cache.screen_radii", cache.screen_radii.size(), count, "after backward");
        const T unit = T(std::max(cache.width, cache.height)) / 2;
        backend_->for_each(count, detail::ObserveSplats<T>{cache.visible, cache.screen_gradient_norms,
                                                           cache.screen_radii, unit, gradient_sums_, view_counts_,
                                                           radii_, halt_word(*backend_)});
    }

    /// Makes the changes that the schedule has after step `step`, counted from 1. After a change the number of
    /// Gaussians may be another one; gradients and splats then need new sizes.
    DensityChange after_step(std::int64_t step, Gaussians<B, T>& gaussians, Gaussians<B, T>& m, Gaussians<B, T>& v) {
        DensityChange change;
        if (!params_.adapts_after(step) && !params_.resets_after(step)) return change;
        if (has_halted(*backend_)) return change; // the statistics are not complete; the step will be taken again
        if (params_.adapts_after(step))
            change = adapt(gaussians, m, v, random_bits(seed_, static_cast<std::uint64_t>(step)),
                           params_.prunes_large_after(step));
        if (params_.resets_after(step)) {
            reset_opacity(gaussians, m, v);
            change.opacity_reset = true;
        }
        return change;
    }

    /// Clones, splits and prunes by the statistics since the last change. `seed` determines the positions of parts.
    /// Errors  ShapeError for moments or statistics of another number of Gaussians.
    DensityChange adapt(Gaussians<B, T>& gaussians, Gaussians<B, T>& m, Gaussians<B, T>& v, std::uint64_t seed,
                        bool prune_large) {
        constexpr const char* where = "DensityControl::adapt";
        const std::size_t count = gaussians.size();
        check_moments(where, gaussians, m, v);
        check_size(where, "gaussians", count, gradient_sums_.size(), "call restart when Gaussians change elsewhere");

        const auto metres = [&](double share) { return T(std::log(share * extent_)); };
        constexpr T unlimited = std::numeric_limits<T>::infinity();
        fates_.resize(count);
        gradients_.resize(count);
        backend_->for_each(
            count,
            detail::DecideFates<T>{std::as_const(gaussians).view(), gradient_sums_, view_counts_, radii_,
                                   T(params_.gradient_threshold), metres(params_.small),
                                   prune_large ? metres(params_.large) : unlimited,
                                   prune_large && params_.large_on_screen > 0 ? T(params_.large_on_screen) : unlimited,
                                   logit(T(params_.min_opacity)), fates_, gradients_});
        using detail::plan_descent; // a backend's own overload has precedence
        const DensityChange change =
            plan_descent(*backend_, Span<const Fate>(fates_), Span<const T>(gradients_),
                         static_cast<std::size_t>(params_.split_count), params_.max_gaussians, descent_);
        if (change.changed()) descend(gaussians, m, v, seed);
        restart(gaussians.size());
        return change;
    }

    /// Limits opacities to reset_opacity and clears their moments. The opacity of Gaussians that the images need grows
    /// again; the others are pruned.
    void reset_opacity(Gaussians<B, T>& gaussians, Gaussians<B, T>& m, Gaussians<B, T>& v) {
        check_moments("DensityControl::reset_opacity", gaussians, m, v);
        backend_->for_each(gaussians.size(),
                           detail::LimitFromAbove<T>{gaussians.opacity_logits, logit(T(params_.reset_opacity))});
        for (Gaussians<B, T>* moment : {&m, &v}) backend_->fill(Span<T>(moment->opacity_logits), T(0));
    }

private:
    static void check_moments(const char* where, const Gaussians<B, T>& gaussians, const Gaussians<B, T>& m,
                              const Gaussians<B, T>& v) {
        check_gaussians(where, "m", m.view(), gaussians.size());
        check_gaussians(where, "v", v.view(), gaussians.size());
        check_size(where, "m.sh", m.sh.size(), gaussians.sh.size(), "moments have the degree of the Gaussians");
        check_size(where, "v.sh", v.sh.size(), gaussians.sh.size(), "moments have the degree of the Gaussians");
    }

    void descend(Gaussians<B, T>& gaussians, Gaussians<B, T>& m, Gaussians<B, T>& v, std::uint64_t seed) {
        const std::size_t count = descent_.parents.size();
        const Span<const std::uint32_t> parents(descent_.parents);
        const Span<const detail::Kin> kin(descent_.kin);
        const auto replace = [&](Gaussians<B, T>& old, auto body) {
            next_.resize(count, old.sh_degree);
            body.from = std::as_const(old).view(), body.to = next_.view();
            backend_->for_each(count, body);
            std::swap(old, next_);
        };
        replace(gaussians, detail::DescendGaussian<T>{{}, parents, kin, seed, T(std::log(params_.split_factor)), {}});
        replace(m, detail::DescendMoments<T>{{}, parents, kin, {}});
        replace(v, detail::DescendMoments<T>{{}, parents, kin, {}});
    }

    B* backend_;
    Params params_;
    double extent_;
    std::uint64_t seed_;

    Buffer<T> gradient_sums_, radii_; // [N] over the views since the last change; largest radius on the screen
    Buffer<std::uint32_t> view_counts_;

    Buffer<Fate> fates_;
    Buffer<T> gradients_;
    detail::DescentBuffers<B> descent_;
    Gaussians<B, T> next_;
};

} // namespace gsh
