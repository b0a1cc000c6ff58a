// SPDX-License-Identifier: Apache-2.0
/// @file  Configuration of a trainable avatar: its parts, their sizes, initial values and learning rates.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/learn/learned_light.hpp>
#include <gsh/model/canonical_points.hpp>

#include <cstdint>

namespace gsh {

/// Which fields give colours and displacements.
enum class Heads {
    shared,  ///< one field for both, as in the paper
    separate ///< a field for each, as in its direct baseline
};

/// What ambient occlusion depends on: the choice of a shadow. All settings of the shadow are named ao here.
enum class AmbientOcclusion {
    none, ///< ao = 1
    time, ///< the frame, γ(t), as in the paper; in a new motion each Gaussian has its mean over the training frames
    pose  ///< the joints' rotations relative to their parents; ao is also right in a new motion
};

/// Learning rates, in metres for joints and displacements, else without a unit.
struct LearningRates {
    double joints = 5e-4;
    double quats = 1e-3;
    double log_scales = 5e-3;
    double opacity_logits = 0.05;
    double displacement = 5e-4;           ///< of a displacement field, or of a shared field's rows for displacements
    double sh = 2e-3;                     ///< of table and network of a colour field, or of a shared field
    double stored_displacements = 1.6e-4; ///< of stored δx, metres; as 3DGS moves means
    double stored_sh = 2.5e-3; ///< of stored constant colours; the bands above have sh_band_share of it
    double ao = 5e-3;          ///< of table and network of the shadow
    LightRates light = {};
    double light_normals = 0;  ///< of offsets of the mesh's unit normals, say 5e-3; 0: its own normals
};

/// Rates of the direct baseline, as in its code: slow fields, fixed rotations.
/// Source  Liu et al., "Animatable 3D Gaussian", 2024.
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
    double hash_base = 4;                     ///< cells on the coarsest level, along the unit cube's edge
    double hash_growth = 1.6;                 ///< ratio of cells from one level to the next
    std::uint32_t hash_table_size = 1u << 17; ///< largest number of entries of a level
    int mlp_width = 64;                       ///< neurons of a hidden layer
    int mlp_hidden_layers = 2;
    Heads heads = Heads::shared;
    bool hash_displacement = true; ///< δx from a field; if false, stored with each Gaussian
    bool hash_sh = true;           ///< SH from a field; if false, stored with each Gaussian
    /// The heads also read γ(t), so that colours and displacements change with the frame. A new motion has their mean.
    bool head_time = false;
    /// The first fine level. Only points with τ > 0 read fine levels, if the avatar has a region.
    int fine_level = 12; ///< the coarse levels below must still resolve a training pixel of the torso, 4.3 mm
    bool separate_tables = false; ///< coarse and fine levels have a table each
    /// Factor on CanonicalPriors::features. Adam moves all weights equally fast, so the factor sets how fast the
    /// network learns to use the features. At 1 they dominate what the encoding learns point by point.
    double prior_scale = 0.1;
    AmbientOcclusion ao = AmbientOcclusion::none;
    double ao_growth = 1.6; ///< ratio of cells from one level of the shadow's grid to the next
    int ao_width = 32;      ///< neurons of a hidden layer of the shadow's network
    double ao_start = 0.1; ///< share of the run after which the shadow is used and learned; the paper: 0.4
    std::uint32_t ao_table_size = 1u << 17;
    double largest_ao = 2; ///< upper bound of ao; above 1, ao can also brighten the colours learned before
    double initial_ao = 1;
    /// Colours are those of the surface, shaded by light that falls on the posed mesh. Light is also right in a new
    /// motion. `ao` is then what light does not explain.
    bool light = false;
    int light_points = 4;      ///< near lights; each casts sharp shadows and has a gloss
    int light_directions = 12; ///< distant lights around the body, with soft shadows
    bool light_shadows = true; ///< if false, only where the surface faces counts
    double light_distance = 4; ///< metres, of the points from the people before they learn
    Deformation deformation = Deformation::linear;
    double initial_opacity = 0.2;
    /// Standard deviation along the surface's normal, as a share of that along the surface. With 1, as in the direct
    /// baseline, and at samples without a normal, Gaussians start round and unturned. A round Gaussian reaches half its
    /// width beyond the outline of the body.
    double initial_thickness = 0.1;
    FieldBounds bounds = FieldBounds::cube;
    double bounds_margin = 1.05; ///< size of the fields' cube or box, as a multiple of the points' own
    double sh_dc_scale = 60;     ///< factor on the network's outputs for constant colours
    double sh_start = 0;         ///< share of the run after which colours depend on the direction
    ColorClamp clamping = ColorClamp::both;
    LearningRates rates = {};

    /// Whether one field gives both colours and displacements: it is shared, and neither is stored.
    [[nodiscard]] bool has_shared_field() const { return heads == Heads::shared && hash_sh && hash_displacement; }
};

} // namespace gsh
