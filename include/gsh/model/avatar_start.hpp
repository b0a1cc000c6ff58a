// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of an avatar's model, and the Gaussians that it starts from.
#pragma once

#include <gsh/avatar/deformation.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/error.hpp>
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
    double shadow_start = 0.1;        ///< share of the run after which the shadow is used and learned; ao is 1 before
    /// Share of the run after which colours depend on the direction. If they do from the start, one camera's colours
    /// explain what its exposure does while the person turns.
    double sh_start = 0;
    double joint_rate = 5e-4;         ///< metres
    double quat_rate = 1e-3;
    double log_scale_rate = 5e-3;
    double opacity_logit_rate = 0.05;
    /// Of normal offsets, in units of a normal's length. If it is 0, a light reads the normals of the mesh.
    double normal_offset_rate = 0;
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
        check_value(params.initial_opacity > 0 && params.initial_opacity < 1, where,
                    "initial_opacity must lie between 0 and 1");
        check_value(params.initial_thickness > 0 && params.initial_thickness <= 1, where,
                    "initial_thickness must lie above 0 and be at most 1");
        check_value(params.shadow_start >= 0, where, "shadow_start must not be negative");
        check_value(params.sh_start >= 0, where, "sh_start must not be negative");
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
