// SPDX-License-Identifier: Apache-2.0
/// @file  Writes and reads avatars as files (.gsh) with everything that animation needs.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/compact_arrays.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh {

/// Version 5 stores sparse arrays without their zeros, and may be compact; version 4, which is dense, is read as well.
inline constexpr int avatar_file_version = 5, oldest_avatar_file_version = 4;

namespace detail {

inline void add_occlusion_field(ArchiveWriter& file, const OcclusionFieldData& field, bool compact) {
    const auto width = static_cast<std::size_t>(field.width);
    if (compact)
        add_quantised<std::int8_t, float>(file, "occlusion_neurons", field.neurons, width);
    else
        file.add("occlusion_neurons", field.neurons, {field.neurons.size() / width, width});
    file.add("occlusion_pose_weights", field.pose_weights, {width, field.pose_weights.size() / width});
    file.add("occlusion_weights", field.weights);
    file.add("occlusion_hidden_layers", std::int32_t(field.hidden_layers));
    file.add("occlusion_bias", field.bias);
    file.add("occlusion_largest", field.largest);
}

inline OcclusionFieldData read_occlusion_field(const ArchiveReader& file) {
    const auto neurons = read_numbers<float>(file.file(), "occlusion_neurons", Numbers::exact),
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
    file.add_rows<double>(
        "light_upright",
        std::vector<vec3<double>>{{A[0].x, A[1].x, A[2].x}, {A[0].y, A[1].y, A[2].y}, {A[0].z, A[1].z, A[2].z}});
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

/// What a file holds of each Gaussian, number by number.
inline void add_exact_points(ArchiveWriter& file, const AvatarData& avatar) {
    const RigData& rig = avatar.rig;
    const GaussianCloud<float>& g = avatar.gaussians;
    file.add_rows<int>("triangles", rig.triangles);
    file.add_rows<double>("barycentric", rig.barycentric);
    file.add("skin_joints", rig.skin.joints, {rig.point_count(), rig.skin.influences});
    file.add("skin_weights", rig.skin.weights, {rig.point_count(), rig.skin.influences});
    file.add_rows<float>("means", g.means);
    file.add_rows<float>("quats", g.quats);
    file.add_rows<float>("log_scales", g.log_scales);
    file.add("opacity_logits", g.opacity_logits);
    file.add_rows<float>("sh", g.sh);
    file.add("ao", avatar.ao);
    if (!avatar.mean_irradiance.empty()) file.add("mean_irradiance", avatar.mean_irradiance);
}

/// The same, quantised. Opacities beyond 0.0003 to 0.9997 end there, which no picture shows.
inline void add_compact_points(ArchiveWriter& file, const AvatarData& avatar) {
    const RigData& rig = avatar.rig;
    const GaussianCloud<float>& g = avatar.gaussians;
    const std::size_t N = rig.point_count();
    file.add_rows<int>("triangles", rig.triangles); // repeats the faces, so that it deflates to two bytes
    std::vector<float> shares, logits, quats;
    for (std::size_t i = 0; i < N; ++i) {
        shares.insert(shares.end(), {float(rig.barycentric[i].x), float(rig.barycentric[i].y)});
        logits.push_back(std::clamp(g.opacity_logits[i], -8.0f, 8.0f));
        const quat<float> q = normalize(g.quats[i]);
        const float sign = q.w < 0 ? -1.0f : 1.0f;
        quats.insert(quats.end(), {sign * q.w, sign * q.x, sign * q.y, sign * q.z});
    }
    add_quantised<std::int16_t, float>(file, "barycentric", shares, 2);
    file.add("skin_joints", rig.skin.joints, {N, rig.skin.influences});
    std::vector<double> weights = rig.skin.weights;
    for (double& weight : weights) weight = std::round(weight * 4096) / 4096;
    add_quantised<std::int16_t, double>(file, "skin_weights", weights, rig.skin.influences, true);
    const auto numbers = [](const auto& rows) {
        return Span<const float>(rows.empty() ? nullptr : &rows[0].x, 3 * rows.size());
    };
    const std::size_t channels = 3 * static_cast<std::size_t>(sh_basis_count(g.sh_degree));
    add_quantised<std::int16_t, float>(file, "means", numbers(g.means), 3);
    add_quantised<std::int16_t, float>(file, "quats", quats, 4);
    add_quantised<std::int8_t, float>(file, "log_scales", numbers(g.log_scales), 3);
    add_quantised<std::int8_t, float>(file, "opacity_logits", logits, 1);
    add_quantised<std::int8_t, float>(file, "sh", numbers(g.sh), channels);
    if (avatar.ao.empty())
        file.add("ao", avatar.ao);
    else
        add_quantised<std::int8_t, float>(file, "ao", avatar.ao, 1);
    if (!avatar.mean_irradiance.empty())
        add_quantised<std::int8_t, float>(file, "mean_irradiance", avatar.mean_irradiance, 1);
}

/// Rows of numbers in any form, as structs that consist only of T.
template <class T, class Row>
[[nodiscard]] std::vector<Row> read_points(const ArchiveReader& file, const char* key) {
    constexpr std::size_t width = sizeof(Row) / sizeof(T);
    if (file.has(key)) return file.read_rows<T, Row>(key);
    const auto array = read_numbers<T>(file.file(), key, Numbers::exact);
    if (array.size() % width != 0) throw ShapeError(file.file().name_of(key) + " has no whole rows");
    std::vector<Row> rows(array.size() / width);
    if (!rows.empty()) std::memcpy(static_cast<void*>(rows.data()), array.data.data(), rows.size() * sizeof(Row));
    return rows;
}

/// Where the Gaussians are attached, from their first two barycentric coordinates in a compact file.
inline std::vector<vec3<double>> read_barycentric(const ArchiveReader& file) {
    if (file.has("barycentric")) return file.read_rows<double, vec3<double>>("barycentric");
    std::vector<vec3<double>> rows;
    for (const vec2<double>& share : read_points<double, vec2<double>>(file, "barycentric"))
        rows.push_back({share.x, share.y, 1 - share.x - share.y});
    return rows;
}

/// Skinning weights; those of a compact file are made to sum to 1 again.
inline SkinWeightTable<double> read_skin(const ArchiveReader& file) {
    const auto joints = file.read<std::uint16_t>("skin_joints");
    if (joints.shape.size() != 2) throw ShapeError(file.file().name_of("skin_joints") + " must have two axes");
    SkinWeightTable<double> skin{joints.data, read_numbers<double>(file.file(), "skin_weights", Numbers::exact).data,
                                 joints.dim(1)};
    if (file.has("skin_weights")) return skin;
    check_size(file.file().name_of("skin_weights"), "weights", skin.weights.size(), skin.joints.size());
    for (std::size_t i = 0; i < skin.size(); ++i) {
        double sum = 0;
        double* const row = skin.weights.data() + i * skin.influences;
        for (std::size_t k = 0; k < skin.influences; ++k) sum += row[k] = std::max(row[k], 0.0);
        check_value(sum > 0, file.file().name_of("skin_weights"), "are zero for a Gaussian");
        for (std::size_t k = 0; k < skin.influences; ++k) row[k] /= sum;
    }
    return skin;
}

/// Throws ShapeError or ValueError, beginning with `where`, unless sizes fit each other, numbers are finite, and
/// triangles and joints exist.
inline void check_avatar(const std::string& where, const AvatarData& avatar) {
    const RigData& rig = avatar.rig;
    const GaussianCloud<float>& g = avatar.gaussians;
    const auto check_each = [&](const char* name, const std::vector<float>& values) { // one per Gaussian, or none
        if (!values.empty()) check_size(where, name, values.size(), rig.point_count(), "one per Gaussian, or none");
        check_finite<float>(where, name, values);
    };
    check_each("ao", avatar.ao);
    check_each("mean_irradiance", avatar.mean_irradiance);
    if (!avatar.normal_offsets.empty())
        check_size(where, "normal_offsets", avatar.normal_offsets.size(), rig.body.vertex_count(),
                   "one per vertex, or none");
    if (avatar.occlusion_field)
        check_occlusion_field(where, *avatar.occlusion_field, rig.point_count(), rig.joint_count());
    check_value(g.sh_degree >= 0 && g.sh_degree <= 4, where,
                "sh_degree is " + std::to_string(g.sh_degree) + ", expected 0 to 4");
    check_gaussians(where, "avatar", g.view(), rig.point_count());
    check_size(where, "joints", rig.joints.size(), rig.joint_count(), "one per joint of the body");
    check_triangles(where, "triangles", rig.triangles, rig.body.vertex_count());
    check_size(where, "barycentric", rig.barycentric.size(), rig.point_count());
    check_skin(where, rig.skin.view(), rig.point_count());
    for (const std::uint16_t joint : rig.skin.joints)
        check_value(joint < rig.joint_count(), where,
                    "skin_joints names joint " + std::to_string(joint) + ", the body has " +
                        std::to_string(rig.joint_count()));
    check_value(avatar.filter.dilation >= 0 && avatar.filter.dilation < 1e6, where,
                "dilation must be square pixels, not negative");
    check_coordinates(where, "joints", rig.joints);
    check_coordinates(where, "barycentric", rig.barycentric);
    check_magnitude(where, "betas", rig.betas);
    check_finite<double>(where, "skin_weights", rig.skin.weights);
    check_value(rig.skin.influences >= 1 || rig.point_count() == 0, where,
                "skin_joints has no columns, expected at least one joint a Gaussian");
    for (std::size_t i = 0; i < rig.point_count(); ++i) {
        double sum = 0, least = 0;
        for (std::size_t k = 0; k < rig.skin.influences; ++k) {
            const double weight = rig.skin.weights[i * rig.skin.influences + k];
            sum += weight, least = std::min(least, weight);
        }
        check_value(least >= -1e-3 && std::abs(sum - 1) <= 1e-2, where,
                    "skin_weights of Gaussian " + std::to_string(i) + " sum to " + number_text(sum) + " with " +
                        number_text(least) + " as the least, expected 1 without negative weights");
    }
    check_finite<float>(where, "normal_offsets", view_as<const float>(Span<const vec3<float>>(avatar.normal_offsets)));
    check_writable(where, g);
}

} // namespace detail

/// Writes an avatar, atomically. The archive opens in NumPy; the body's members begin with "body/".
///
/// A file is exact unless `storage` is compact. A compact one holds quantised numbers, deflated: positions and weights
/// in two bytes, scales, quaternions, opacities and colours in one to two.
inline void save_avatar(const std::filesystem::path& path, const AvatarData& avatar,
                        ArrayStorage storage = ArrayStorage::sparse) {
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
    const bool compact = storage == ArrayStorage::compact;
    ArchiveWriter file(path, "avatar", avatar_file_version, compact ? Packing::deflated : Packing::stored);
    add_body_model(file, rig.body, "body/", storage);
    file.add("betas", rig.betas);
    file.add_rows<double>("joints", rig.joints);
    if (compact)
        detail::add_compact_points(file, avatar);
    else
        detail::add_exact_points(file, avatar);
    file.add("sh_degree", std::int32_t(g.sh_degree));
    file.add("clamp_above", std::int32_t(avatar.clamping == ColorClamp::both));
    file.add("dilation", avatar.filter.dilation);
    file.add("compensate_opacity", std::int32_t(avatar.filter.compensate_opacity));
    file.add("deformation", std::int32_t(avatar.deformation));
    if (avatar.occlusion_field) detail::add_occlusion_field(file, *avatar.occlusion_field, compact);
    if (avatar.light) detail::add_light(file, *avatar.light, avatar.light_place);
    if (!avatar.normal_offsets.empty()) file.add_rows<float>("normal_offsets", avatar.normal_offsets);
    file.commit();
}

/// Reads a file written by save_avatar.
///
/// Errors  IoError, ShapeError, ValueError naming the file and the member that is missing or does not fit.
[[nodiscard]] inline AvatarData load_avatar(const InputFile& input) {
    const ArchiveReader file(input, "avatar", avatar_file_version, oldest_avatar_file_version);
    AvatarData avatar;
    RigData& rig = avatar.rig;
    rig.body = read_body_model(file.file(), "body/");
    rig.betas = file.read<double>("betas").data;
    rig.joints = file.read_rows<double, vec3<double>>("joints");
    rig.triangles = file.read_rows<int, std::array<int, 3>>("triangles");
    rig.barycentric = detail::read_barycentric(file);
    rig.skin = detail::read_skin(file);

    GaussianCloud<float>& g = avatar.gaussians;
    g.means = detail::read_points<float, vec3<float>>(file, "means");
    g.quats = detail::read_points<float, quat<float>>(file, "quats");
    g.log_scales = detail::read_points<float, vec3<float>>(file, "log_scales");
    g.opacity_logits = read_numbers<float>(file.file(), "opacity_logits", Numbers::exact).data;
    g.sh = detail::read_points<float, vec3<float>>(file, "sh");
    g.sh_degree = file.read_number<std::int32_t>("sh_degree");
    avatar.clamping = file.read_number<std::int32_t>("clamp_above") ? ColorClamp::both : ColorClamp::below;
    avatar.filter = {file.read_number<double>("dilation"), file.read_number<std::int32_t>("compensate_opacity") != 0};

    avatar.ao = read_numbers<float>(file.file(), "ao", Numbers::exact).data;
    if (has_numbers(file.file(), "occlusion_neurons")) avatar.occlusion_field = detail::read_occlusion_field(file);
    if (file.has("light_points")) {
        avatar.light = detail::read_light(file);
        avatar.light_place = detail::read_light_place(file);
    }
    if (file.has("normal_offsets")) avatar.normal_offsets = file.read_rows<float, vec3<float>>("normal_offsets");
    if (has_numbers(file.file(), "mean_irradiance"))
        avatar.mean_irradiance = read_numbers<float>(file.file(), "mean_irradiance", Numbers::exact).data;
    const auto deformation = file.read_number<std::int32_t>("deformation");
    check_value(deformation >= 0 && deformation <= 2, input.name(),
                "deformation is " + std::to_string(deformation) + ", expected 0 to 2");
    avatar.deformation = static_cast<Deformation>(deformation);
    detail::check_avatar(input.name(), avatar);
    return avatar;
}

} // namespace gsh
