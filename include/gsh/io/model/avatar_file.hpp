// SPDX-License-Identifier: Apache-2.0
/// @file  Writes and reads avatars as files (.gsh) with everything that animation needs.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/math/rotation.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh {

inline constexpr int avatar_file_version = 4;

namespace detail {

inline void add_occlusion_field(ArchiveWriter& file, const OcclusionFieldData& field) {
    const auto width = static_cast<std::size_t>(field.width);
    file.add("occlusion_neurons", field.neurons, {field.neurons.size() / width, width});
    file.add("occlusion_pose_weights", field.pose_weights, {width, field.pose_weights.size() / width});
    file.add("occlusion_weights", field.weights);
    file.add("occlusion_hidden_layers", std::int32_t(field.hidden_layers));
    file.add("occlusion_bias", field.bias);
    file.add("occlusion_largest", field.largest);
}

inline OcclusionFieldData read_occlusion_field(const ArchiveReader& file) {
    const auto neurons = file.read<float>("occlusion_neurons"),
               pose_weights = file.read<float>("occlusion_pose_weights");
    const std::string where = file.file().path().string();
    if (neurons.shape.size() != 2) throw ShapeError(where + ": occlusion_neurons must have two axes");
    check_value(neurons.dim(1) >= 1 && neurons.dim(1) <= 4096, where,
                "occlusion_neurons has " + std::to_string(neurons.dim(1)) + " columns, expected 1 to 4096");
    return {.neurons = neurons.data,
            .pose_weights = pose_weights.data,
            .weights = file.read<float>("occlusion_weights").data,
            .width = static_cast<int>(neurons.dim(1)),
            .hidden_layers = file.read_number<std::int32_t>("occlusion_hidden_layers"),
            .bias = file.read_number<double>("occlusion_bias"),
            .largest = file.read_number<double>("occlusion_largest")};
}

inline void add_light(ArchiveWriter& file, const LightData& light, const MotionPlace& place) {
    file.add_rows<double>("light_points", light.points);
    file.add_rows<double>("light_directions", light.directions);
    file.add("light_log_intensities", light.log_intensities);
    file.add("light_gloss", light.gloss);
    file.add("light_shadows", std::int32_t(light.shadows));
    file.add_rows<double>("light_place", std::vector<vec3<double>>{place.low, place.high});
    if (!place.upright) return;
    const mat3<double>& A = *place.upright; // in rows
    file.add_rows<double>("light_upright", std::vector<vec3<double>>{{A[0].x, A[1].x, A[2].x},
                                                                     {A[0].y, A[1].y, A[2].y},
                                                                     {A[0].z, A[1].z, A[2].z}});
}

inline LightData read_light(const ArchiveReader& file) {
    LightData light{.points = file.read_rows<double, vec3<double>>("light_points"),
                    .directions = file.read_rows<double, vec3<double>>("light_directions"),
                    .log_intensities = file.read<double>("light_log_intensities").data,
                    .gloss = file.read<double>("light_gloss").data,
                    .shadows = file.read_number<std::int32_t>("light_shadows") != 0};
    check_light(file.file().path().string(), light);
    return light;
}

inline MotionPlace read_light_place(const ArchiveReader& file) {
    const std::string where = file.file().path().string();
    const auto rows = [&](const char* name, std::size_t count) {
        const auto values = file.read_rows<double, vec3<double>>(name);
        check_size(where, name, values.size(), count, "rows of three numbers");
        check_finite<double>(where, name, view_as<const double>(Span<const vec3<double>>(values)));
        return values;
    };
    const auto box = rows("light_place", 2);
    MotionPlace place{.low = box[0], .high = box[1]};
    if (!file.has("light_upright")) return place;
    const auto A = rows("light_upright", 3);
    place.upright = transpose(mat3<double>(A[0], A[1], A[2]));
    check_value(is_rotation(*place.upright, 1e-6), where, "light_upright is not a rotation");
    return place;
}

} // namespace detail

/// Writes an avatar, atomically. The archive opens in NumPy; the body's members begin with "body/".
inline void save_avatar(const std::filesystem::path& path, const AvatarData& avatar) {
    const RigData& rig = avatar.rig;
    const GaussianCloud<float>& g = avatar.gaussians;
    check_size("save_avatar", "gaussians", g.size(), rig.point_count(), "one per point of the rig");
    if (avatar.occlusion_field)
        check_occlusion_field("save_avatar", *avatar.occlusion_field, rig.point_count(), rig.joint_count());
    if (avatar.light) check_light("save_avatar", *avatar.light);
    if (!avatar.mean_irradiance.empty())
        check_size("save_avatar", "mean_irradiance", avatar.mean_irradiance.size(), rig.point_count(),
                   "one per Gaussian, or none");
    if (!avatar.normal_offsets.empty())
        check_size("save_avatar", "normal_offsets", avatar.normal_offsets.size(), rig.body.vertex_count(),
                   "one per vertex, or none");
    ArchiveWriter file(path, "avatar", avatar_file_version);
    add_body_model(file, rig.body, "body/");
    file.add("betas", rig.betas);
    file.add_rows<double>("joints", rig.joints);
    file.add_rows<int>("triangles", rig.triangles);
    file.add_rows<double>("barycentric", rig.barycentric);
    file.add("skin_joints", rig.skin.joints, {rig.point_count(), rig.skin.influences});
    file.add("skin_weights", rig.skin.weights, {rig.point_count(), rig.skin.influences});
    file.add_rows<float>("means", g.means);
    file.add_rows<float>("quats", g.quats);
    file.add_rows<float>("log_scales", g.log_scales);
    file.add("opacity_logits", g.opacity_logits);
    file.add_rows<float>("sh", g.sh);
    file.add("sh_degree", std::int32_t(g.sh_degree));
    file.add("clamp_above", std::int32_t(avatar.clamping == ColorClamp::both));
    file.add("dilation", avatar.filter.dilation);
    file.add("compensate_opacity", std::int32_t(avatar.filter.compensate_opacity));
    file.add("deformation", std::int32_t(avatar.deformation));
    file.add("ao", avatar.ao);
    if (avatar.occlusion_field) detail::add_occlusion_field(file, *avatar.occlusion_field);
    if (avatar.light) detail::add_light(file, *avatar.light, avatar.light_place);
    if (!avatar.normal_offsets.empty()) file.add_rows<float>("normal_offsets", avatar.normal_offsets);
    if (!avatar.mean_irradiance.empty()) file.add("mean_irradiance", avatar.mean_irradiance);
    file.commit();
}

/// Reads a file written by save_avatar.
///
/// Errors  IoError, ShapeError, ValueError naming the file and the member that is missing or does not fit.
[[nodiscard]] inline AvatarData load_avatar(const std::filesystem::path& path) {
    const ArchiveReader file(path, "avatar", avatar_file_version);
    AvatarData avatar;
    RigData& rig = avatar.rig;
    rig.body = read_body_model(file.file(), "body/");
    rig.betas = file.read<double>("betas").data;
    rig.joints = file.read_rows<double, vec3<double>>("joints");
    rig.triangles = file.read_rows<int, std::array<int, 3>>("triangles");
    rig.barycentric = file.read_rows<double, vec3<double>>("barycentric");
    const auto joints = file.read<std::uint16_t>("skin_joints");
    if (joints.shape.size() != 2) throw ShapeError(path.string() + ": skin_joints must have two axes");
    rig.skin = {joints.data, file.read<double>("skin_weights").data, joints.dim(1)};

    GaussianCloud<float>& g = avatar.gaussians;
    g.means = file.read_rows<float, vec3<float>>("means");
    g.quats = file.read_rows<float, quat<float>>("quats");
    g.log_scales = file.read_rows<float, vec3<float>>("log_scales");
    g.opacity_logits = file.read<float>("opacity_logits").data;
    g.sh = file.read_rows<float, vec3<float>>("sh");
    g.sh_degree = file.read_number<std::int32_t>("sh_degree");
    avatar.clamping = file.read_number<std::int32_t>("clamp_above") ? ColorClamp::both : ColorClamp::below;
    avatar.filter = {file.read_number<double>("dilation"), file.read_number<std::int32_t>("compensate_opacity") != 0};

    avatar.ao = file.read<float>("ao").data;
    if (file.has("occlusion_neurons")) avatar.occlusion_field = detail::read_occlusion_field(file);
    if (file.has("light_points")) {
        avatar.light = detail::read_light(file);
        avatar.light_place = detail::read_light_place(file);
    }
    if (file.has("normal_offsets")) avatar.normal_offsets = file.read_rows<float, vec3<float>>("normal_offsets");
    if (file.has("mean_irradiance")) avatar.mean_irradiance = file.read<float>("mean_irradiance").data;
    const auto deformation = file.read_number<std::int32_t>("deformation");

    const std::string where = path.string();
    check_value(deformation >= 0 && deformation <= 2, where,
                "deformation is " + std::to_string(deformation) + ", expected 0 to 2");
    avatar.deformation = static_cast<Deformation>(deformation);
    if (!avatar.ao.empty()) check_size(where, "ao", avatar.ao.size(), rig.point_count(), "one per Gaussian, or none");
    check_finite<float>(where, "ao", avatar.ao);
    if (!avatar.mean_irradiance.empty())
        check_size(where, "mean_irradiance", avatar.mean_irradiance.size(), rig.point_count(),
                   "one per Gaussian, or none");
    check_finite<float>(where, "mean_irradiance", avatar.mean_irradiance);
    if (!avatar.normal_offsets.empty())
        check_size(where, "normal_offsets", avatar.normal_offsets.size(), rig.body.vertex_count(),
                   "one per vertex, or none");
    check_finite<float>(where, "normal_offsets", view_as<const float>(Span<const vec3<float>>(avatar.normal_offsets)));
    if (avatar.occlusion_field)
        check_occlusion_field(where, *avatar.occlusion_field, rig.point_count(), rig.joint_count());
    check_value(g.sh_degree >= 0 && g.sh_degree <= 4, where,
                "sh_degree is " + std::to_string(g.sh_degree) + ", expected 0 to 4");
    check_gaussians(where, "avatar", std::as_const(g).view(), rig.point_count());
    check_size(where, "barycentric", rig.barycentric.size(), rig.point_count());
    check_skin(where, rig.skin.view(), rig.point_count());
    for (const std::uint16_t joint : rig.skin.joints)
        check_value(joint < rig.joint_count(), where,
                    "skin_joints names joint " + std::to_string(joint) + ", the body has " +
                        std::to_string(rig.joint_count()));
    check_value(avatar.filter.dilation >= 0 && avatar.filter.dilation < 1e6, where,
                "dilation must be square pixels, not negative");
    check_finite<float>(where, "means", view_as<const float>(Span<const vec3<float>>(g.means)));
    check_finite<float>(where, "sh", view_as<const float>(Span<const vec3<float>>(g.sh)));
    check_finite<float>(where, "log_scales", view_as<const float>(Span<const vec3<float>>(g.log_scales)));
    check_finite<float>(where, "opacity_logits", g.opacity_logits);
    return avatar;
}

} // namespace gsh
