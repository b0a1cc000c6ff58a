// SPDX-License-Identifier: Apache-2.0
/// @file  How a scene is trained: loss, backgrounds, and how learning rates fall over a run.
#pragma once

#include <gsh/core/rng.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/photo/photo_gain.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Loss, backgrounds, pixel filter, and how rates fall over a run.
struct TrainParams {
    double decay_start = 0.75; ///< share of the run over which rates are constant
    double final_rate = 0.03;  ///< final share of each rate; small last steps average over photographs
    double ssim_weight = 0.4;  ///< λ of (1 - λ) L1 + λ (1 - SSIM); 0.2 in the direct baseline
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, in training and in test
    /// Training uses another background colour in each step. This keeps white clothing from being reconstructed as
    /// transparent. Photographs with plates keep their plates.
    bool random_background = true;
    /// About the blur of the photographs: 0.14 px², less the pixel's own box.
    PixelFilter filter{.dilation = 0.1, .compensate_opacity = true};
    /// A pixel passes no gradient to Gaussians that less than this share of its light reaches. Backward passes then
    /// skip the hidden side of a body. 0: every gradient, however small.
    double gradient_transmittance_min = 0;

    /// Exposure and white balance of each photograph. Without a light in the scene, they would also learn the shading
    /// that it lacks, so they are fixed by default.
    PhotoGainParams gain{};

    /// Bytes of a device's memory for plates and photographs; those that do not fit are brought ahead of their step. 0:
    /// half of what is free when training starts. No setting of the avatar: it does not change any number.
    std::uint64_t photo_memory = 0;

    /// Factor on every rate when the share `progress` of the run is over. It is 1 until decay_start, then falls
    /// geometrically to final_rate.
    [[nodiscard]] double rate_factor(double progress) const {
        const double last = 1 - decay_start;
        const double fallen = last > 0 ? std::clamp((progress - decay_start) / last, 0.0, 1.0) : 0;
        return std::pow(final_rate, fallen);
    }

    /// The background of a step. Its stream of random numbers is not that of the photographs' order, which is the seed.
    [[nodiscard]] std::array<double, 3> background_of_step(std::uint64_t seed, std::uint64_t step) const {
        if (!random_background) return background;
        constexpr std::uint64_t background_stream = 2;
        const std::uint64_t bits = random_bits(mix_bits(seed + background_stream), step);
        std::array<double, 3> color;
        for (std::size_t c = 0; c < 3; ++c) color[c] = static_cast<double>(bits >> (21 * c) & 0x1FFFFF) / 0x1FFFFF;
        return color;
    }

    /// The settings themselves.
    /// Errors  ValueError that names a setting which is out of its range.
    [[nodiscard]] const TrainParams& checked() const {
        check_ranges("TrainParams", *this);
        return *this;
    }

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("rate.decay_start", self.decay_start, SettingRange::share());
        f("rate.final", self.final_rate, SettingRange::above(0).up_to(1));
        f("ssim_weight", self.ssim_weight, SettingRange::share());
        f("gradient_transmittance_min", self.gradient_transmittance_min, SettingRange::share());
        f("background.random", self.random_background, SettingRange());
        PhotoGainParams::for_each_setting(self.gain, f);
        PixelFilter::for_each_setting(self.filter, f);
    }
};
/// The former name of TrainParams.
using TrainConfig [[deprecated("use TrainParams")]] = TrainParams;

/// Loss and filter of the direct baseline, as in its code. Its rates do not fall. docs/quality.md compares
/// TrainParams' own settings with these.
/// Source  Liu et al., "Animatable 3D Gaussian", 2024.
[[nodiscard]] inline TrainParams baseline_train_params() {
    return {.decay_start = 0,
            .final_rate = 1,
            .ssim_weight = 0.2,
            .random_background = false,
            .filter = {.dilation = 0.3, .compensate_opacity = false}};
}

} // namespace gsh
