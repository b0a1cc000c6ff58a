// SPDX-License-Identifier: Apache-2.0
/// @file  Ways of reconstructing a person, as plain data with names: the paper's, its baseline's, what lies between.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/train/avatar_model.hpp>
#include <gsh/train/refinement_config.hpp>
#include <gsh/train/trainer.hpp>

#include <array>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Which joints move the avatar.
enum class JointSet {
    all,            ///< the body's own, with expression
    trunk_and_limbs ///< fingers, jaw and eyes merged into their parents, no expression: SMPL's
};

/// Everything about a reconstruction but its input, its seed and its length. Settings have names, for files and command
/// lines: for_each_setting lists them.
struct Configuration {
    std::string name = "paper";
    JointSet joints = JointSet::all;
    bool region_samples = true; ///< K(x): more Gaussians on face and hands; else the same number at every vertex
    bool multi_scale = true;    ///< fine hash levels only where the region mask says so; else everywhere
    RegionMaskParams region;
    SampleWeights sample_weights = SampleWeights::barycentric;
    double sample_jitter = 0; ///< SurfaceSampleOptions::jitter
    bool depth_prior = true;   ///< φ_d: four depths of the body's mesh
    bool normal_prior = true;  ///< φ_n: two normals of the body's mesh
    PriorFeatureParams prior;
    AvatarConfig avatar{.ao = AmbientOcclusion::time};
    TrainConfig train;
    RefinementConfig refinement; ///< of a run that refines
    double finger_rate = 1;      ///< factor on the rate of refined poses at fingers
    double face_rate = 1;        ///< and at jaw and eyes
    std::size_t test_steps = 60; ///< steps in which a test frame's pose is fitted
    double test_mask_weight = 0; ///< PoseFitParams::mask_weight of that fit
};

/// Names that named_configuration knows: the paper's method, its direct baseline with a body's 22 joints and with all
/// of them, and the paper's less one part each.
inline constexpr std::array<std::string_view, 11> configuration_names{
    "paper",         "baseline", "baseline-x",    "no-ao",     "no-hash-sh", "no-hash-vd",
    "no-multiscale", "no-depth", "no-normals", "smpl-init", "pose-ao"};

namespace detail {

template <class E>
struct EnumNames;
template <>
struct EnumNames<JointSet> {
    static constexpr std::array<std::string_view, 2> names{"all", "trunk_and_limbs"};
};
template <>
struct EnumNames<Heads> {
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

template <class V>
[[nodiscard]] std::string setting_text(const V& value) {
    if constexpr (std::is_same_v<V, bool>) {
        return value ? "true" : "false";
    } else if constexpr (std::is_enum_v<V>) {
        return std::string(EnumNames<V>::names[static_cast<std::size_t>(value)]);
    } else {
        char text[32];
        const auto end = std::to_chars(text, text + sizeof text, value); // the shortest that reads back as the same
        return {text, end.ptr};
    }
}

/// Errors  ValueError that names the setting, what was found and what was expected.
template <class V>
void set_from_text(std::string_view where, const std::string& text, V& value) {
    const auto refuse = [&](const std::string& expected) {
        throw ValueError(std::string(where) + " is '" + text + "', expected " + expected);
    };
    if constexpr (std::is_same_v<V, bool>) {
        if (text != "true" && text != "false") refuse("true or false");
        value = text == "true";
    } else if constexpr (std::is_enum_v<V>) {
        std::string all;
        for (std::size_t i = 0; i < EnumNames<V>::names.size(); ++i) {
            if (text == EnumNames<V>::names[i]) {
                value = static_cast<V>(i);
                return;
            }
            all += (i ? ", " : "") + std::string(EnumNames<V>::names[i]);
        }
        refuse("one of " + all);
    } else {
        V number{};
        const auto end = std::from_chars(text.data(), text.data() + text.size(), number);
        if (end.ec != std::errc() || end.ptr != text.data() + text.size()) refuse("a number");
        if constexpr (std::is_floating_point_v<V>)
            if (!std::isfinite(number)) refuse("a finite number");
        value = number;
    }
}

} // namespace detail

/// Calls f(name, value) for every setting of a configuration but its own name.
template <class C, class F>
    requires std::same_as<std::remove_const_t<C>, Configuration>
void for_each_setting(C& c, const F& f) {
    f("joints", c.joints);
    f("region.samples", c.region_samples);
    f("region.sigma", c.region.sigma);
    f("region.samples_base", c.region.samples_base);
    f("region.samples_high", c.region.samples_high);
    f("sample_weights", c.sample_weights);
    f("sample_jitter", c.sample_jitter);
    f("multi_scale", c.multi_scale);
    f("prior.depth", c.depth_prior);
    f("prior.normals", c.normal_prior);
    f("prior.depth_feature", c.prior.depth);
    f("prior.depth_unit", c.prior.depth_unit);
    f("prior.scale", c.avatar.prior_scale);
    f("hash.base", c.avatar.hash_base);
    f("hash.growth", c.avatar.hash_growth);
    f("hash.table_size", c.avatar.hash_table_size);
    f("hash.fine_level", c.avatar.fine_level);
    f("hash.separate_tables", c.avatar.separate_tables);
    f("mlp.width", c.avatar.mlp_width);
    f("mlp.hidden_layers", c.avatar.mlp_hidden_layers);
    f("heads", c.avatar.heads);
    f("heads.time", c.avatar.head_time);
    f("hash_sh", c.avatar.hash_sh);
    f("hash_displacement", c.avatar.hash_displacement);
    f("sh_dc_scale", c.avatar.sh_dc_scale);
    f("ao", c.avatar.ao);
    f("ao.table_size", c.avatar.ao_table_size);
    f("ao.initial", c.avatar.initial_ao);
    f("ao.largest", c.avatar.largest_ao);
    f("ao.start", c.train.ao_start);
    f("deformation", c.avatar.deformation);
    f("initial_opacity", c.avatar.initial_opacity);
    f("initial_thickness", c.avatar.initial_thickness);
    f("bounds", c.avatar.bounds);
    f("bounds_margin", c.avatar.bounds_margin);
    f("color_clamp", c.avatar.clamping);
    f("rate.joints", c.train.rates.joints);
    f("rate.quats", c.train.rates.quats);
    f("rate.log_scales", c.train.rates.log_scales);
    f("rate.opacity_logits", c.train.rates.opacity_logits);
    f("rate.displacement", c.train.rates.displacement);
    f("rate.sh", c.train.rates.sh);
    f("rate.stored_displacements", c.train.rates.stored_displacements);
    f("rate.stored_sh", c.train.rates.stored_sh);
    f("rate.ao", c.train.rates.ao);
    f("rate.decay_start", c.train.decay_start);
    f("rate.final", c.train.final_rate);
    f("ssim_weight", c.train.ssim_weight);
    f("background.random", c.train.random_background);
    f("filter.dilation", c.train.filter.dilation);
    f("filter.compensate_opacity", c.train.filter.compensate_opacity);
    const auto refined = [&](const std::string& group, auto& how, bool in_time) {
        f(group + ".rate", how.rate);
        f(group + ".start", how.start);
        f(group + ".pull", how.terms.pull);
        if (!in_time) return;
        f(group + ".drift", how.terms.drift);
        f(group + ".acceleration", how.terms.acceleration);
    };
    refined("refine.pose", c.refinement.pose, true);
    refined("refine.transl", c.refinement.transl, true);
    refined("refine.expression", c.refinement.expression, true);
    refined("refine.betas", c.refinement.betas, false);
    refined("refine.camera_rotation", c.refinement.camera_rotation, false);
    refined("refine.camera_translation", c.refinement.camera_translation, false);
    refined("refine.camera_focal", c.refinement.camera_focal, false);
    refined("refine.camera_center", c.refinement.camera_center, false);
    f("refine.fingers", c.finger_rate);
    f("refine.face", c.face_rate);
    f("refine.final", c.refinement.final_rate);
    f("refine.test_steps", c.test_steps);
    f("refine.test_mask_weight", c.test_mask_weight);
}

/// A configuration by its name.
/// Errors  ValueError that lists the names there are.
[[nodiscard]] inline Configuration named_configuration(std::string_view name) {
    Configuration c;
    c.name = name;
    // Liu et al., "Animatable 3D Gaussian", 2024, as its code has it, but that samples lie on the surface: there they
    // are copies of the vertices, moved by a squared length taken for a length.
    const auto make_baseline = [&] {
        c.sample_weights = SampleWeights::copied;
        c.avatar.bounds = FieldBounds::box;
        c.region_samples = c.multi_scale = c.depth_prior = c.normal_prior = false;
        c.avatar.heads = Heads::separate;
        c.avatar.ao_table_size = 1u << 19;
        c.avatar.largest_ao = 1;
        c.avatar.initial_ao = 0.5;
        c.avatar.hash_growth = 1.5;
        c.avatar.initial_thickness = 1;
        c.avatar.sh_dc_scale = 20;
        c.train = baseline_config();
    };
    if (name == "paper") return c;
    if (name == "baseline") make_baseline(), c.joints = JointSet::trunk_and_limbs;
    else if (name == "baseline-x") make_baseline();
    else if (name == "no-ao") c.avatar.ao = AmbientOcclusion::none;
    else if (name == "no-hash-sh") c.avatar.hash_sh = false;
    else if (name == "no-hash-vd") c.avatar.hash_displacement = false;
    else if (name == "no-multiscale") c.multi_scale = false;
    else if (name == "no-depth") c.depth_prior = false;
    else if (name == "no-normals") c.normal_prior = false;
    else if (name == "smpl-init") c.joints = JointSet::trunk_and_limbs, c.region_samples = false;
    else if (name == "pose-ao") c.avatar.ao = AmbientOcclusion::pose;
    else {
        std::string all;
        for (const std::string_view known : configuration_names) all += (all.empty() ? "" : ", ") + std::string(known);
        throw ValueError("there is no configuration '" + std::string(name) + "', expected one of " + all);
    }
    return c;
}

/// Sets one setting from text, of a configuration or whatever else for_each_setting knows. `where` says who asks, for
/// messages.
/// Errors  ValueError for a setting that does not exist or text that it cannot be.
template <class C>
void set_setting(C& c, std::string_view key, const std::string& text, const std::string& where) {
    bool found = false;
    for_each_setting(c, [&](std::string_view name, auto& value) {
        if (name != key) return;
        found = true;
        detail::set_from_text(where + ": " + std::string(key), text, value);
    });
    if (!found)
        throw ValueError(where + ": there is no setting '" + std::string(key) + "'; docs/configurations.md lists them");
}

/// Text of each setting, in order: what a report prints.
template <class C>
[[nodiscard]] std::vector<std::pair<std::string, std::string>> settings_of(const C& c) {
    std::vector<std::pair<std::string, std::string>> result;
    for_each_setting(c, [&](std::string_view name, const auto& value) {
        result.emplace_back(std::string(name), detail::setting_text(value));
    });
    return result;
}

} // namespace gsh
