// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations of a reconstruction as plain data with names: the paper's, its baseline's, ablations.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/model/avatar_config.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/refine/refinement_config.hpp>
#include <gsh/train/train_config.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Which joints move the avatar.
enum class JointSet {
    all,            ///< all joints of the body, with expression
    trunk_and_limbs ///< fingers, jaw and eyes merged into their parents, no expression: as in SMPL
};

/// Which points read the fine levels of the hash grid, AvatarConfig::fine_level and above.
enum class FineLevels {
    region,     ///< those in the region mask, where τ > 0
    everywhere, ///< all points
    none        ///< no point
};

/// Everything about a reconstruction except its input, its seed and its length. Settings have names, for files and
/// command lines; for_each_setting lists them.
struct Configuration {
    std::string name = "paper";
    JointSet joints = JointSet::all;
    bool region_samples = true; ///< K(x): more Gaussians on face and hands; if false, as many at every vertex
    FineLevels fine_levels = FineLevels::region;
    RegionMaskParams region;
    SampleWeights sample_weights = SampleWeights::barycentric;
    double sample_jitter = 0; ///< SurfaceSampleOptions::jitter
    bool depth_prior = true;  ///< φ_d: four depths of the body's mesh
    bool normal_prior = true; ///< φ_n: two normals of the body's mesh
    PriorFeatureParams prior;
    AvatarConfig avatar{.ao = AmbientOcclusion::time};
    TrainConfig train;
    /// Share of an image's height on either side of a mask's outline where the mask is not believed: Photo::unknown.
    double unknown_band = 0.01;
    bool half_chroma = true; ///< whether photographs with colours of half resolution are found: Photo::half_chroma
    /// Whether Gaussians that no photograph saw are filled after training (setup/unseen_points.hpp).
    bool fill_unseen = true;
    RefinementConfig refinement; ///< used by runs with refinement
    double finger_rate = 1;      ///< factor on the rate of refined poses at fingers
    double face_rate = 1;        ///< the same at jaw and eyes
    std::size_t test_steps = 60; ///< number of steps that fit a test frame's pose
    double test_mask_weight = 0; ///< PoseFitParams::mask_weight of that fit

    /// Whether a region mask is needed: samples or fine levels depend on it.
    [[nodiscard]] bool has_regions() const { return region_samples || fine_levels == FineLevels::region; }
    /// Whether fields read depths or normals.
    [[nodiscard]] bool has_priors() const { return depth_prior || normal_prior; }
};

/// The names of named_configuration: the paper's method, its direct baseline with 22 joints and with all joints, and
/// the paper's method with one part changed.
inline constexpr std::array<std::string_view, 13> configuration_names{
    "paper",         "baseline",    "baseline-x", "no-ao",      "no-hash-sh", "no-hash-vd",
    "no-multiscale", "coarse-only", "no-depth",   "no-normals", "smpl-init",  "pose-ao",
    "light"};

/// The configuration of a run for which none is chosen.
inline constexpr std::string_view default_configuration = "light";

namespace detail {

template <>
struct EnumNames<JointSet> {
    static constexpr std::array<std::string_view, 2> names{"all", "trunk_and_limbs"};
};
template <>
struct EnumNames<FineLevels> {
    static constexpr std::array<std::string_view, 3> names{"region", "everywhere", "none"};
};
template <>
struct EnumNames<Heads> { // files and options have "joint" for Heads::shared
    static constexpr std::array<std::string_view, 2> names{"joint", "separate"};
};
template <>
struct EnumNames<AmbientOcclusion> {
    static constexpr std::array<std::string_view, 3> names{"none", "time", "pose"};
};
template <>
struct EnumNames<Deformation> {
    static constexpr std::array<std::string_view, 3> names{"linear", "polar", "dual_quaternion"};
};
template <>
struct EnumNames<SampleWeights> {
    static constexpr std::array<std::string_view, 2> names{"barycentric", "copied"};
};
template <>
struct EnumNames<DepthFeature> {
    static constexpr std::array<std::string_view, 2> names{"difference", "raw"};
};
template <>
struct EnumNames<FieldBounds> {
    static constexpr std::array<std::string_view, 2> names{"cube", "box"};
};
template <>
struct EnumNames<ColorClamp> {
    static constexpr std::array<std::string_view, 2> names{"both", "below"};
};

} // namespace detail

/// Calls f(name, value, range) for every setting of a configuration except the configuration's name. The range is that
/// of the setting alone; check_settings checks those that depend on each other.
template <class C, class F>
    requires std::same_as<std::remove_const_t<C>, Configuration>
void for_each_setting(C& c, const F& f) {
    using R = SettingRange;
    constexpr R any, share = R::at_least(0).up_to(1);
    f("joints", c.joints, any);
    f("region.samples", c.region_samples, any);
    f("region.sigma", c.region.sigma, R::above(0));
    f("region.samples_base", c.region.samples_base, R::at_least(0));
    f("region.samples_high", c.region.samples_high, R::at_least(0));
    f("sample_weights", c.sample_weights, any);
    f("sample_jitter", c.sample_jitter, R::at_least(0));
    f("fine_levels", c.fine_levels, any);
    f("prior.depth", c.depth_prior, any);
    f("prior.normals", c.normal_prior, any);
    f("prior.depth_feature", c.prior.depth, any);
    f("prior.depth_unit", c.prior.depth_unit, R::above(0));
    f("prior.scale", c.avatar.prior_scale, R::above(0));
    f("hash.base", c.avatar.hash_base, R::above(1));
    f("hash.growth", c.avatar.hash_growth, R::at_least(1));
    f("hash.table_size", c.avatar.hash_table_size, R::power_of_two());
    f("hash.fine_level", c.avatar.fine_level, R::at_least(0).up_to(16));
    f("hash.separate_tables", c.avatar.separate_tables, any);
    f("mlp.width", c.avatar.mlp_width, R::at_least(1));
    f("mlp.hidden_layers", c.avatar.mlp_hidden_layers, R::at_least(0));
    f("heads", c.avatar.heads, any);
    f("heads.time", c.avatar.head_time, any);
    f("hash_sh", c.avatar.hash_sh, any);
    f("hash_displacement", c.avatar.hash_displacement, any);
    f("sh_dc_scale", c.avatar.sh_dc_scale, any);
    f("sh_start", c.avatar.sh_start, share);
    f("ao", c.avatar.ao, any);
    f("ao.growth", c.avatar.ao_growth, R::at_least(1));
    f("ao.width", c.avatar.ao_width, R::at_least(1));
    f("ao.table_size", c.avatar.ao_table_size, R::power_of_two());
    f("ao.initial", c.avatar.initial_ao, R::above(0));
    f("ao.largest", c.avatar.largest_ao, R::above(0));
    f("ao.start", c.avatar.ao_start, share);
    f("light", c.avatar.light, any);
    f("light.points", c.avatar.light_points, R::at_least(1).up_to(64));
    f("light.directions", c.avatar.light_directions, R::at_least(0).up_to(256));
    f("light.shadows", c.avatar.light_shadows, any);
    f("light.distance", c.avatar.light_distance, R::above(0));
    f("deformation", c.avatar.deformation, any);
    f("initial_opacity", c.avatar.initial_opacity, R::above(0).below(1));
    f("initial_thickness", c.avatar.initial_thickness, R::above(0).up_to(1));
    f("bounds", c.avatar.bounds, any);
    f("bounds_margin", c.avatar.bounds_margin, R::at_least(1));
    f("color_clamp", c.avatar.clamping, any);
    f("rate.joints", c.avatar.rates.joints, R::at_least(0));
    f("rate.quats", c.avatar.rates.quats, R::at_least(0));
    f("rate.log_scales", c.avatar.rates.log_scales, R::at_least(0));
    f("rate.opacity_logits", c.avatar.rates.opacity_logits, R::at_least(0));
    f("rate.displacement", c.avatar.rates.displacement, R::at_least(0));
    f("rate.sh", c.avatar.rates.sh, R::at_least(0));
    f("rate.stored_displacements", c.avatar.rates.stored_displacements, R::at_least(0));
    f("rate.stored_sh", c.avatar.rates.stored_sh, R::at_least(0));
    f("rate.ao", c.avatar.rates.ao, R::at_least(0));
    f("rate.light_points", c.avatar.rates.light.points, R::at_least(0));
    f("rate.light_intensities", c.avatar.rates.light.log_intensities, R::at_least(0));
    f("rate.light_gloss", c.avatar.rates.light.gloss, R::at_least(0));
    f("rate.light_normals", c.avatar.rates.light_normals, R::at_least(0));
    f("rate.decay_start", c.train.decay_start, share);
    f("rate.final", c.train.final_rate, R::above(0).up_to(1));
    f("ssim_weight", c.train.ssim_weight, share);
    f("gradient_transmittance_min", c.train.gradient_transmittance_min, share);
    f("background.random", c.train.random_background, any);
    f("unknown_band", c.unknown_band, R::at_least(0).up_to(0.1));
    f("half_chroma", c.half_chroma, any);
    f("fill_unseen", c.fill_unseen, any);
    f("gain.rate", c.train.gain.rate, R::at_least(0));
    f("gain.start", c.train.gain.start, share);
    f("filter.dilation", c.train.filter.dilation, R::at_least(0));
    f("filter.compensate_opacity", c.train.filter.compensate_opacity, any);
    const auto refined = [&](const std::string& group, auto& how, bool in_time) {
        f(group + ".rate", how.rate, R::at_least(0));
        f(group + ".start", how.start, R::at_least(0));
        f(group + ".pull", how.terms.pull, R::at_least(0));
        if (!in_time) return;
        f(group + ".drift", how.terms.drift, R::at_least(0));
        f(group + ".acceleration", how.terms.acceleration, R::at_least(0));
    };
    refined("refine.pose", c.refinement.pose, true);
    refined("refine.transl", c.refinement.transl, true);
    refined("refine.expression", c.refinement.expression, true);
    refined("refine.betas", c.refinement.betas, false);
    refined("refine.camera_rotation", c.refinement.camera_rotation, false);
    refined("refine.camera_translation", c.refinement.camera_translation, false);
    refined("refine.camera_focal", c.refinement.camera_focal, false);
    refined("refine.camera_principal_point", c.refinement.camera_principal_point, false);
    f("refine.fingers", c.finger_rate, R::at_least(0));
    f("refine.face", c.face_rate, R::at_least(0));
    f("refine.final", c.refinement.final_rate, R::above(0).up_to(1));
    f("refine.test_steps", c.test_steps, R::at_least(0));
    f("refine.test_mask_weight", c.test_mask_weight, R::at_least(0));
}

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
        c.sample_weights = SampleWeights::copied;
        c.avatar.bounds = FieldBounds::box;
        c.region_samples = c.depth_prior = c.normal_prior = false;
        c.fine_levels = FineLevels::everywhere;
        c.avatar.heads = Heads::separate;
        c.avatar.ao_growth = 1.5;
        c.avatar.ao_width = 64;
        c.avatar.ao_table_size = 1u << 19;
        c.avatar.largest_ao = 1;
        c.avatar.initial_ao = 0.5;
        c.avatar.hash_growth = 1.5;
        c.avatar.initial_thickness = 1;
        c.avatar.sh_dc_scale = 20;
        c.avatar.rates = baseline_rates();
        c.avatar.ao_start = 0.4;
        c.train = baseline_config();
        c.unknown_band = 0;
        c.half_chroma = false;
        c.fill_unseen = false;
    };
    if (name == "paper") return c;
    if (name == "baseline") make_baseline(), c.joints = JointSet::trunk_and_limbs;
    else if (name == "baseline-x") make_baseline();
    else if (name == "no-ao") c.avatar.ao = AmbientOcclusion::none;
    else if (name == "no-hash-sh") c.avatar.hash_sh = false;
    else if (name == "no-hash-vd") c.avatar.hash_displacement = false;
    else if (name == "no-multiscale") c.fine_levels = FineLevels::everywhere;
    else if (name == "coarse-only") c.fine_levels = FineLevels::none;
    else if (name == "no-depth") c.depth_prior = false;
    else if (name == "no-normals") c.normal_prior = false;
    else if (name == "smpl-init") c.joints = JointSet::trunk_and_limbs, c.region_samples = false;
    else if (name == "pose-ao") c.avatar.ao = AmbientOcclusion::pose;
    else if (name == "light") {
        c.avatar.ao = AmbientOcclusion::none;
        c.avatar.light = true;
        c.avatar.sh_start = 0.3; // when gains have been found
        c.train.gain.rate = 0.03;
    } else {
        std::string message(where);
        message.append(where.empty() ? "" : ": ").append("there is no configuration '").append(name);
        message.append("', expected one of ");
        for (const std::string_view known : configuration_names)
            message.append(known == configuration_names.front() ? "" : ", ").append(known);
        throw ValueError(message.append(also));
    }
    return c;
}

/// Sets one setting from text, of a configuration or any other type with for_each_setting. `where` names the caller in
/// messages.
/// Errors  ValueError for a setting that does not exist, text that cannot be read, or a number out of range; then
///         nothing changes.
template <class C>
void set_setting(C& c, std::string_view key, const std::string& text, const std::string& where) {
    bool found = false;
    for_each_setting(c, [&](std::string_view name, auto& value, const SettingRange& range) {
        if (name != key) return;
        found = true;
        detail::set_from_text(where + ": " + std::string(key), text, value, range);
    });
    if (!found)
        throw ValueError(where + ": there is no setting '" + std::string(key) + "'; docs/configurations.md lists them");
}

/// Checks settings that depend on each other, once all are set. `where` names the caller in messages.
/// Errors  ValueError that names the settings that contradict each other.
inline void check_settings(const Configuration& c, const std::string& where) {
    const auto text = [](double value) { return detail::setting_text(value); };
    check_value(c.avatar.initial_ao < c.avatar.largest_ao, where,
                "ao.initial is " + text(c.avatar.initial_ao) + " and ao.largest " + text(c.avatar.largest_ao) +
                    ", expected ao.initial below ao.largest");
    check_value(
        !c.region_samples || c.region.samples_base > 0 || c.region.samples_high > 0, where,
        "region.samples_base and region.samples_high are 0, expected one of them above, or region.samples false");
    check_value(
        !c.avatar.head_time || c.avatar.hash_sh || c.avatar.hash_displacement, where,
        "heads.time is true and neither hash_sh nor hash_displacement is, expected a field that reads the time");
}

/// Name and text of each setting, in order, for reports.
template <class C>
[[nodiscard]] std::vector<std::pair<std::string, std::string>> settings_of(const C& c) {
    std::vector<std::pair<std::string, std::string>> result;
    for_each_setting(c, [&](std::string_view name, const auto& value, const SettingRange&) {
        result.emplace_back(std::string(name), detail::setting_text(value));
    });
    return result;
}

} // namespace gsh
