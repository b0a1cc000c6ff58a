// SPDX-License-Identifier: Apache-2.0
/// @file  The settings of a static scene under their names, for files and command lines.
#pragma once

#include <gsh/train/configuration.hpp>
#include <gsh/train/static_trainer.hpp>

#include <concepts>
#include <type_traits>

namespace gsh {

/// Calls f(name, value) for every setting of a static scene but its length and its largest number of Gaussians, which
/// belong to the input.
template <class C, class F>
    requires std::same_as<std::remove_const_t<C>, StaticConfig>
void for_each_setting(C& c, const F& f) {
    f("rate.means", c.rates.means);
    f("rate.final_means", c.rates.final_means);
    f("rate.quats", c.rates.quats);
    f("rate.log_scales", c.rates.log_scales);
    f("rate.opacity_logits", c.rates.opacity_logits);
    f("rate.sh", c.rates.sh);
    f("rate.sh_bands", c.rates.sh_bands);
    f("density.gradient_threshold", c.density.gradient_threshold);
    f("density.start", c.density.start);
    f("density.stop", c.density.stop);
    f("density.interval", c.density.interval);
    f("density.reset_interval", c.density.reset_interval);
    f("density.small", c.density.small);
    f("density.large", c.density.large);
    f("density.large_on_screen", c.density.large_on_screen);
    f("density.min_opacity", c.density.min_opacity);
    f("density.reset_opacity", c.density.reset_opacity);
    f("density.split_factor", c.density.split_factor);
    f("density.split_count", c.density.split_count);
    f("sh_degree", c.sh_degree);
    f("sh_interval", c.sh_interval);
    f("extent", c.extent);
    f("ssim_weight", c.ssim_weight);
    f("filter.dilation", c.filter.dilation);
    f("filter.compensate_opacity", c.filter.compensate_opacity);
}

} // namespace gsh
