// SPDX-License-Identifier: Apache-2.0
/// @file  How avatars are trained: rates, loss, backgrounds, and when they change over a run.
#pragma once

#include <gsh/gaussian/splats.hpp>
#include <gsh/train/parameters.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace gsh {

/// Steps of gradient descent per group, metres or unitless as the group is.
struct LearningRates {
    double joints = 5e-4;
    double quats = 1e-3;
    double log_scales = 5e-3;
    double opacity_logits = 0.05;
    double displacement = 5e-4;           ///< table and network of the displacement field; its rows in a joint network
    double sh = 2e-3;                     ///< table and network of the colour field, or of the joint one
    double stored_displacements = 1.6e-4; ///< δx of each Gaussian, where no field gives it; metres, as 3DGS moves means
    double stored_sh = 2.5e-3; ///< constant colour of each Gaussian, where no field gives it; the bands a 20th of it
    double ao = 5e-3;                     ///< table and network of ambient occlusion

    [[nodiscard]] double operator[](ParameterGroup group) const {
        switch (group) {
        case ParameterGroup::joints: return joints;
        case ParameterGroup::quats: return quats;
        case ParameterGroup::log_scales: return log_scales;
        case ParameterGroup::opacity_logits: return opacity_logits;
        case ParameterGroup::displacements: return stored_displacements;
        case ParameterGroup::sh: return stored_sh;
        case ParameterGroup::displacement_table:
        case ParameterGroup::displacement_network: return displacement;
        case ParameterGroup::joint_table:
        case ParameterGroup::joint_network:
        case ParameterGroup::sh_table:
        case ParameterGroup::sh_network: return sh;
        case ParameterGroup::ao_table:
        case ParameterGroup::ao_network: return ao;
        }
        return 0;
    }
};

/// Loss, backgrounds, pixel filter, and how rates fall over a run.
struct TrainConfig {
    LearningRates rates;
    double decay_start = 0.75; ///< share of the run over which rates stay: an avatar is rarely done learning
    double final_rate = 0.03;  ///< share of its rate that each group ends with: small last steps average photographs
    double ssim_weight = 0.4;  ///< λ of (1 - λ) L1 + λ (1 - SSIM); the direct baseline: 0.2
    double ao_start = 0.1;     ///< share of the run after which ambient occlusion is learned; 1 before (the paper: 0.4)
    std::array<double, 3> background{1, 1, 1}; ///< display-referred sRGB, in training and in test
    /// In training another colour each step, so that no Gaussian can pass for background; views with plates keep
    /// theirs.
    bool random_background = true;
    /// About what photographs have: 0.14 px² less a pixel's own box.
    PixelFilter filter{.dilation = 0.1, .compensate_opacity = true};

    /// Factor on every rate when a share of the run is over: 1 until decay_start, then falling geometrically to
    /// final_rate.
    [[nodiscard]] double rate_factor(double progress) const {
        const double last = 1 - decay_start;
        const double fallen = last > 0 ? std::clamp((progress - decay_start) / last, 0.0, 1.0) : 0;
        return std::pow(final_rate, fallen);
    }
};

/// Rates and filter of the direct baseline (Liu et al., "Animatable 3D Gaussian", 2024, its code): slow fields, frozen
/// rotations, no decay. What TrainConfig has instead is measured against these in docs/quality.md.
[[nodiscard]] inline TrainConfig baseline_config() {
    return {
        .rates =
            {.joints = 5e-4, .quats = 0, .log_scales = 1e-3, .opacity_logits = 0.05, .displacement = 1e-4, .sh = 5e-4},
        .decay_start = 0,
        .final_rate = 1,
        .ssim_weight = 0.2,
        .ao_start = 0.4,
        .random_background = false,
        .filter = {.dilation = 0.3, .compensate_opacity = false}};
}

} // namespace gsh
