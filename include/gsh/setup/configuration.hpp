// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations of a reconstruction as plain data with names: the paper's, its baseline's, ablations.
#pragma once

#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/model/configured_avatar_params.hpp>
#include <gsh/model/occlusion.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/setup/schedule.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/train_params.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

/// Which joints move the avatar.
enum class JointSet {
    all,            ///< all joints of the body, with expression
    trunk_and_limbs ///< fingers, jaw and eyes merged into their parents, no expression: as in SMPL
};
template <>
struct EnumNames<JointSet> {
    static constexpr std::array<std::string_view, 2> names{"all", "trunk_and_limbs"};
};

/// Which points read the fine levels of the hash grid, AppearanceParams::fine_level and above.
enum class FineLevels {
    region,     ///< those in the region mask, where τ > 0
    everywhere, ///< all points
    none        ///< no point
};
template <>
struct EnumNames<FineLevels> {
    static constexpr std::array<std::string_view, 3> names{"region", "everywhere", "none"};
};

/// Everything about a reconstruction except its input, its seed and its length: the settings of all parts.
struct Configuration {
    std::string name = "paper";
    JointSet joints = JointSet::all;
    bool region_samples = true; ///< K(x): more Gaussians on face and hands; if false, as many at every vertex
    FineLevels fine_levels = FineLevels::region;
    RegionMaskParams region;
    SurfaceSampleParams samples; ///< its total is not read: it is the run's
    bool depth_prior = true;     ///< φ_d: four depths of the body's mesh
    bool normal_prior = true;    ///< φ_n: two normals of the body's mesh
    PriorFeatureParams prior;
    ConfiguredAvatarParams avatar{.ao = AmbientOcclusion::time};
    TrainParams train;
    ScheduleParams schedule;
    /// Share of an image's height on either side of a mask's outline where the mask is not believed: Photo::unknown.
    double unknown_band = 0.01;
    bool half_chroma = true; ///< whether photographs with colours of half resolution are found: Photo::half_chroma
    /// Whether Gaussians that no photograph saw are filled after training (setup/unseen_points.hpp).
    bool fill_unseen = true;
    RefinementParams refinement; ///< used by runs with refinement
    PoseFitParams test_fit;      ///< of a test frame's pose; only steps and mask_weight are read

    /// Whether a region mask is needed: samples or fine levels depend on it.
    [[nodiscard]] bool has_regions() const { return region_samples || fine_levels == FineLevels::region; }
    /// Whether fields read depths or normals.
    [[nodiscard]] bool has_priors() const { return depth_prior || normal_prior; }

    /// The stage of the training of `points` Gaussians when the share `progress` of a run is over. Colours that change
    /// with the time, and appearances that appearance_type names, which may do so, are not stored.
    [[nodiscard]] TrainingStage stage_at(double progress, std::size_t points) const {
        TrainingStage stage = schedule.at(progress, points);
        if (avatar.head_time || !avatar.appearance_type.empty()) stage.stored = false;
        return stage;
    }

    /// The steps of a run for which no number is chosen. Half as many do once colours are stored with each Gaussian.
    [[nodiscard]] std::uint64_t usual_steps() const { return stage_at(1, 0).stored ? 1500 : 3000; }

    /// All settings but the name.
    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("joints", self.joints, SettingRange());
        f("region.samples", self.region_samples, SettingRange());
        RegionMaskParams::for_each_setting(self.region, f);
        SurfaceSampleParams::for_each_setting(self.samples, f);
        f("fine_levels", self.fine_levels, SettingRange());
        f("prior.depth", self.depth_prior, SettingRange());
        f("prior.normals", self.normal_prior, SettingRange());
        PriorFeatureParams::for_each_setting(self.prior, f);
        ConfiguredAvatarParams::for_each_setting(self.avatar, f);
        TrainParams::for_each_setting(self.train, f);
        ScheduleParams::for_each_setting(self.schedule, f);
        f("unknown_band", self.unknown_band, SettingRange::at_least(0).up_to(0.1));
        f("half_chroma", self.half_chroma, SettingRange());
        f("fill_unseen", self.fill_unseen, SettingRange());
        RefinementParams::for_each_setting(self.refinement, f);
        PoseFitParams::for_each_setting(self.test_fit, f);
    }
};

/// The names of named_configuration: the paper's method, its direct baseline with 22 joints and with all joints, and
/// the paper's method with one part changed.
inline constexpr std::array<std::string_view, 13> configuration_names{
    "paper",       "baseline", "baseline-x", "no-ao",     "no-hash-sh", "no-hash-vd", "no-multiscale",
    "coarse-only", "no-depth", "no-normals", "smpl-init", "pose-ao",    "light"};

/// The configuration of a run for which none is chosen.
inline constexpr std::string_view default_configuration = "light";

/// A configuration by its name. For error messages, `where` names the caller, and `also` is appended to the list of
/// names.
/// Errors  ValueError that lists the names.
[[nodiscard]] inline Configuration named_configuration(std::string_view name, std::string_view where = {},
                                                       std::string_view also = {}) {
    Configuration c;
    c.name = name;
    c.train.gradient_transmittance_min = 0.01;
    // Liu et al., "Animatable 3D Gaussian", 2024, as in its code, except that samples lie on the surface. In that code
    // they are copies of the vertices, moved by a squared length that is used as a length.
    const auto make_baseline = [&] {
        c.samples.weights = SampleWeights::copied;
        c.avatar.points.bounds = FieldBounds::box;
        c.region_samples = c.depth_prior = c.normal_prior = false;
        c.fine_levels = FineLevels::everywhere;
        c.avatar.heads = Heads::separate;
        c.avatar.appearance.field.grid.growth = 1.5;
        c.avatar.appearance.sh_dc_scale = 20;
        c.avatar.appearance.displacement_rate = 1e-4; // slow fields
        c.avatar.appearance.sh_rate = 5e-4;
        c.avatar.occlusion.grid = HashGridParams{.growth = 1.5, .table_size = 1u << 19};
        c.avatar.occlusion.width = 64;
        c.avatar.occlusion.largest = 1;
        c.avatar.occlusion.initial = 0.5;
        c.avatar.model.initial_thickness = 1;
        c.avatar.model.occlusion_start = 0.4;
        c.avatar.model.quat_rate = 0; // fixed rotations
        c.avatar.model.log_scale_rate = 1e-3;
        c.train = baseline_train_params();
        c.unknown_band = 0;
        c.half_chroma = false;
        c.fill_unseen = false;
    };
    if (name == "paper") return c;
    if (name == "baseline")
        make_baseline(), c.joints = JointSet::trunk_and_limbs;
    else if (name == "baseline-x")
        make_baseline();
    else if (name == "no-ao")
        c.avatar.ao = AmbientOcclusion::none;
    else if (name == "no-hash-sh")
        c.avatar.hash_sh = false;
    else if (name == "no-hash-vd")
        c.avatar.hash_displacement = false;
    else if (name == "no-multiscale")
        c.fine_levels = FineLevels::everywhere;
    else if (name == "coarse-only")
        c.fine_levels = FineLevels::none;
    else if (name == "no-depth")
        c.depth_prior = false;
    else if (name == "no-normals")
        c.normal_prior = false;
    else if (name == "smpl-init")
        c.joints = JointSet::trunk_and_limbs, c.region_samples = false;
    else if (name == "pose-ao")
        c.avatar.ao = AmbientOcclusion::pose;
    else if (name == "light") {
        c.avatar.light = true;
        c.avatar.model.sh_start = 0.3; // when gains have been found
        // A small field takes what no light explains, such as folds of cloth, once light and colours have settled.
        c.avatar.occlusion.width = 16;
        c.avatar.occlusion.grid.table_size = 1u << 14;
        c.avatar.occlusion.most_points = 8192;
        c.avatar.model.occlusion_start = 0.5;
        c.train.gain.rate = 0.03;
        c.schedule = ScheduleParams{.stride = 2, .all_points = 0.1, .stored = 0.2};
        // A run has stages so that it can be short. In a tenth of the steps of 3DGS, each of them must lead further.
        c.avatar.appearance.stored_sh_rate = 5e-3;
        c.avatar.appearance.stored_displacement_rate = 1e-4;
        c.avatar.model.log_scale_rate = 0.03;
        c.avatar.model.quat_rate = 4e-3;
    } else {
        std::string message(where);
        message.append(where.empty() ? "" : ": ").append("there is no configuration '").append(detail::shortened(name));
        message.append("', expected one of ");
        for (const std::string_view known : configuration_names)
            message.append(known == configuration_names.front() ? "" : ", ").append(known);
        throw ValueError(message.append(also));
    }
    return c;
}

/// Checks settings that depend on each other, once all are set. `where` names the caller in messages, and Parts lists
/// the parts that an avatar may have.
/// Errors  ValueError that names the settings that contradict each other.
template <class Parts = AvatarParts>
void check_settings(const Configuration& c, const std::string& where) {
    check_parts<Parts>(c.avatar, where);
    if (c.stage_at(1, 0).stored) {
        ConfiguredAvatarParams stored = c.avatar;
        stored.appearance_type = stored_appearance;
        check_part_names<Parts>(stored, where + ": schedule.stored");
    }
    check_value(
        !c.region_samples || c.region.samples_base > 0 || c.region.samples_high > 0, where,
        "region.samples_base and region.samples_high are 0, expected one of them above, or region.samples false");
}

} // namespace gsh
