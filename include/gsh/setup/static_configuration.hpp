// SPDX-License-Identifier: Apache-2.0
/// @file  The settings of a static scene by name, for files and command lines; its trainer's settings and seed.
#pragma once

#include <gsh/core/rng.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/train_config.hpp>

#include <concepts>
#include <type_traits>

namespace gsh {

/// TrainConfig of a static scene. Rates follow the model's own schedule, and the background is constant.
[[nodiscard]] inline TrainConfig train_config_of(const StaticConfig& config) {
    return {.decay_start = 1,
            .final_rate = 1,
            .ssim_weight = config.ssim_weight,
            .background = config.background,
            .random_background = false,
            .filter = config.filter}; // without gains: of one photograph of each camera, they would be the mean
}

/// The seed for the Trainer of a static scene, which determines the order of the photographs. StaticModel takes `seed`
/// itself.
[[nodiscard]] inline std::uint64_t static_order_seed(std::uint64_t seed) { return random_bits(seed, 2); }

/// Calls f(name, value, range) for every setting of a static scene except its length and its largest number of
/// Gaussians, which belong to the input.
template <class C, class F>
    requires std::same_as<std::remove_const_t<C>, StaticConfig>
void for_each_setting(C& c, const F& f) {
    using R = SettingRange;
    constexpr R any, share = R::at_least(0).up_to(1);
    f("rate.means", c.rates.means, R::at_least(0));
    f("rate.final_means", c.rates.final_means, R::at_least(0));
    f("rate.quats", c.rates.quats, R::at_least(0));
    f("rate.log_scales", c.rates.log_scales, R::at_least(0));
    f("rate.opacity_logits", c.rates.opacity_logits, R::at_least(0));
    f("rate.sh", c.rates.sh, R::at_least(0));
    f("rate.sh_bands", c.rates.sh_bands, R::at_least(0));
    f("density.gradient_threshold", c.density.gradient_threshold, R::above(0));
    f("density.start", c.density.start, R::at_least(0));
    f("density.stop", c.density.stop, R::at_least(0));
    f("density.interval", c.density.interval, R::at_least(1));
    f("density.reset_interval", c.density.reset_interval, R::at_least(0));
    f("density.small", c.density.small, R::above(0));
    f("density.large", c.density.large, R::above(0));
    f("density.large_on_screen", c.density.large_on_screen, R::at_least(0));
    f("density.min_opacity", c.density.min_opacity, R::above(0).below(1));
    f("density.reset_opacity", c.density.reset_opacity, R::above(0).below(1));
    f("density.split_factor", c.density.split_factor, R::at_least(1));
    f("density.split_count", c.density.split_count, R::at_least(1));
    f("sh_degree", c.sh_degree, R::at_least(0).up_to(4));
    f("sh_interval", c.sh_interval, R::at_least(1));
    f("extent", c.extent, R::at_least(0));
    f("ssim_weight", c.ssim_weight, share);
    f("filter.dilation", c.filter.dilation, R::at_least(0));
    f("filter.compensate_opacity", c.filter.compensate_opacity, any);
}

} // namespace gsh
