// SPDX-License-Identifier: Apache-2.0
/// @file  How a scene is trained: loss, backgrounds, and how learning rates fall over a run.
#pragma once

#include <gsh/gaussian/splats.hpp>
#include <gsh/pipeline/photo_gain.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace gsh {

/// Loss, backgrounds, pixel filter, and how rates fall over a run.
struct TrainConfig {
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

    /// Bytes of a device's memory for photographs; the others are brought ahead of their step. 0: half of what is free
    /// when training starts. No setting of the avatar: it does not change any number.
    std::uint64_t photo_memory = 0;

    /// Factor on every rate when the share `progress` of the run is over. It is 1 until decay_start, then falls
    /// geometrically to final_rate.
    [[nodiscard]] double rate_factor(double progress) const {
        const double last = 1 - decay_start;
        const double fallen = last > 0 ? std::clamp((progress - decay_start) / last, 0.0, 1.0) : 0;
        return std::pow(final_rate, fallen);
    }
};

/// Loss and filter of the direct baseline, as in its code. Its rates do not fall. docs/quality.md compares
/// TrainConfig's own settings with these.
/// Source  Liu et al., "Animatable 3D Gaussian", 2024.
[[nodiscard]] inline TrainConfig baseline_config() {
    return {.decay_start = 0,
            .final_rate = 1,
            .ssim_weight = 0.2,
            .random_background = false,
            .filter = {.dilation = 0.3, .compensate_opacity = false}};
}

} // namespace gsh
