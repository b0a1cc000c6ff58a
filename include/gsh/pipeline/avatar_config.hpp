// SPDX-License-Identifier: Apache-2.0
/// @file  What a trainable avatar is made of: its parts, their sizes and what they start with.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/pipeline/canonical_points.hpp>

#include <cstdint>

namespace gsh {

/// Where colours and displacements come from.
enum class Heads {
    joint,   ///< one network z ↦ (SH, δx), the paper's
    separate ///< a field each, its direct baseline's
};

/// What shadows depend on.
enum class AmbientOcclusion {
    none, ///< ao = 1
    time, ///< the frame, γ(t): the paper's; a new motion gets each Gaussian's mean over training
    pose  ///< the joints' rotations relative to their parents: shadows replay on a new motion
};

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
    double ao = 5e-3;          ///< table and network of ambient occlusion
};

/// Rates of the direct baseline (Liu et al., "Animatable 3D Gaussian", 2024, its code): slow fields, frozen rotations.
[[nodiscard]] inline LearningRates baseline_rates() {
    return {.joints = 5e-4,
            .quats = 0,
            .log_scales = 1e-3,
            .opacity_logits = 0.05,
            .displacement = 1e-4,
            .sh = 5e-4};
}

/// Sizes, starting values, parts and learning rates of an avatar.
struct AvatarConfig {
    double hash_base = 4;                     ///< cells on the coarsest level, along the bounding cube's edge
    double hash_growth = 1.6;                 ///< from one level to the next
    std::uint32_t hash_table_size = 1u << 17; ///< most entries of a level
    int mlp_width = 64;                       ///< neurons of a hidden layer
    int mlp_hidden_layers = 2;
    Heads heads = Heads::joint;
    bool hash_displacement = true; ///< δx from a field; else stored with each Gaussian
    bool hash_sh = true;           ///< SH from a field; else stored with each Gaussian
    /// The heads read γ(t) too: colours and displacements that change with the frame; a new motion gets their mean.
    bool head_time = false;
    /// Fine levels, which only points with a share in the region have (if the avatar is given one).
    int fine_level = 12; ///< what lies below must still resolve a training pixel of the torso, 4.3 mm
    bool separate_tables = false; ///< coarse and fine features from a table each
    /// Factor on CanonicalPriors::features. Adam moves all weights equally fast, so this is how fast the network comes
    /// to lean on them: at 1 they drown what the encoding learns point by point.
    double prior_scale = 0.1;
    AmbientOcclusion ao = AmbientOcclusion::none;
    double ao_start = 0.1; ///< share of the run after which ambient occlusion is learned; 1 before (the paper: 0.4)
    std::uint32_t ao_table_size = 1u << 17;
    double largest_ao = 2; ///< above 1, light may exceed the mean that the colours hold when ao starts
    double initial_ao = 1;
    Deformation deformation = Deformation::linear;
    double initial_opacity = 0.2;
    /// Standard deviation along the surface's normal, in shares of that along the surface. 1 starts round and unturned,
    /// as the direct baseline does (and samples without a normal); a round Gaussian stands half its width off the
    /// outline.
    double initial_thickness = 0.1;
    FieldBounds bounds = FieldBounds::cube;
    double bounds_margin = 1.05; ///< the fields' cube or box, in sizes of the points'
    double sh_dc_scale = 60;     ///< the network's constant-colour outputs are multiplied by this
    ColorClamp clamping = ColorClamp::both;
    LearningRates rates = {};

    /// Whether one field gives colours and displacements: a joint head, and neither of them stored.
    [[nodiscard]] bool has_joint_head() const { return heads == Heads::joint && hash_sh && hash_displacement; }
};

} // namespace gsh
