// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of an avatar's model, and the Gaussians that it starts from.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// Settings of the arrays that the model itself owns, and of how its Gaussians are posed.
struct AvatarModelParams {
    double initial_opacity = 0.2;
    /// Standard deviation along the surface's normal, as a share of that along the surface. With 1, and at samples
    /// without a normal, Gaussians start round and unturned.
    double initial_thickness = 0.1;
    ColorClamp clamping = ColorClamp::both;
    Deformation deformation = Deformation::linear;
    double occlusion_start = 0.1; ///< share of the run after which ao is used and learned; 1 before; paper: 0.4
    /// Share of the run after which colours depend on the direction. If they do from the start, one camera's colours
    /// explain what its exposure does while the person turns.
    double sh_start = 0;
    double joint_rate = 5e-4; ///< metres
    double quat_rate = 1e-3;
    double log_scale_rate = 5e-3;
    double opacity_logit_rate = 0.05;
    /// Of normal offsets, in units of a normal's length. If it is 0, a light reads the normals of the mesh.
    double normal_offset_rate = 0;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("deformation", self.deformation, SettingRange());
        f("initial_opacity", self.initial_opacity, SettingRange::above(0).below(1));
        f("initial_thickness", self.initial_thickness, SettingRange::above(0).up_to(1));
        f("color_clamp", self.clamping, SettingRange());
        f("ao.start", self.occlusion_start, SettingRange::share());
        f("sh_start", self.sh_start, SettingRange::share());
        f("rate.joints", self.joint_rate, SettingRange::at_least(0));
        f("rate.quats", self.quat_rate, SettingRange::at_least(0));
        f("rate.log_scales", self.log_scale_rate, SettingRange::at_least(0));
        f("rate.opacity_logits", self.opacity_logit_rate, SettingRange::at_least(0));
        f("rate.light_normals", self.normal_offset_rate, SettingRange::at_least(0));
    }
};

namespace detail {

/// Initial Gaussians of an avatar: flat on the surface, turned to its normal.
template <class T>
struct GaussianStart {
    std::vector<vec3<T>> joints, log_scales;
    std::vector<quat<T>> quats;
    std::vector<T> opacity_logits;

    /// Errors  ShapeError, ValueError: samples that are not the rig's points, settings out of range.
    GaussianStart(const RigData& rig, const SurfaceSamples& samples, const AvatarModelParams& params) {
        constexpr const char* where = "AvatarModel";
        check_size(where, "samples", samples.size(), rig.point_count(), "the rig must be made of these samples");
        check_size(where, "samples.normals", samples.normals.size(), samples.size(), "one per sample");
        check_value(samples.size() > 0, where, "there are no samples, expected at least one");
        check_ranges(where, params);
        for (const auto& joint : rig.joints) joints.push_back(vec3<T>(joint));
        for (std::size_t i = 0; i < samples.size(); ++i) {
            const double scale = samples.scales[i];
            const bool round = params.initial_thickness == 1 || samples.normals[i] == vec3<double>(0);
            const quat<double> q = round ? quat<double>() : quat_from_z_axis(samples.normals[i]);
            const double thickness = round ? scale : scale * params.initial_thickness;
            log_scales.push_back({T(std::log(scale)), T(std::log(scale)), T(std::log(thickness))});
            quats.push_back({T(q.w), T(q.x), T(q.y), T(q.z)});
        }
        opacity_logits.assign(samples.size(), static_cast<T>(logit(params.initial_opacity)));
    }
};

} // namespace detail

} // namespace gsh
