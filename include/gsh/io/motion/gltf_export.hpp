// SPDX-License-Identifier: Apache-2.0
/// @file  Writes motions as GLB files: a skeleton of nodes with a skin's bind pose, and an animation of it.
#pragma once

#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Writes a rig as a GLB file, atomically: a node for each joint, at rest in the rig's rest pose, rotations of all
/// joints and positions of the roots as animation `name`, and a skin with the rest pose as bind pose, which makes
/// programs see bones. Numbers are floats.
///
/// Frame   y up, metres, as in glTF.
/// Errors  ValueError for an invalid rig, or times that do not ascend; IoError.
inline void save_gltf_motion(const std::filesystem::path& path, const RigMotion& rig,
                             const std::string& name = "motion");

// -------------------------------------------------------------------------------------------------------------

inline void save_gltf_motion(const std::filesystem::path& path, const RigMotion& rig, const std::string& name) {
    validate(rig, "save_gltf_motion");
    const std::size_t J = rig.joint_count(), T = rig.frame_count();
    std::vector<float> inverse;
    const auto append = [](std::vector<float>& numbers, const vec3<double>& v) {
        numbers.insert(numbers.end(), {float(v.x), float(v.y), float(v.z)});
    };
    using Json = nlohmann::ordered_json;
    GlbWriter file;
    const int input = file.add_times(rig.timestamps, path.string());
    Json nodes = Json::array(), roots = Json::array(), joints = Json::array();
    for (std::size_t j = 0; j < J; ++j) {
        const int parent = rig.parents[j];
        const auto p = static_cast<std::size_t>(std::max(parent, 0));
        const mat3<double> above = parent < 0 ? mat3<double>(1.0) : rig.rest_rotations[p];
        const vec3<double> from = parent < 0 ? vec3<double>(0) : rig.rest_joints[p];
        const vec3<double> place = transpose(above) * (rig.rest_joints[j] - from);
        const quat<double> rest = quat_from_rotation(transpose(above) * rig.rest_rotations[j]);
        nodes.push_back({{"name", rig.names[j]}, {"translation", {place.x, place.y, place.z}}});
        if (rest.w < 1) nodes[j]["rotation"] = {rest.x, rest.y, rest.z, rest.w};
        if (parent < 0)
            roots.push_back(j);
        else
            nodes[p]["children"].push_back(j);
        joints.push_back(j);
        const mat3<double> back = transpose(rig.rest_rotations[j]);
        for (int column = 0; column < 3; ++column) append(inverse, back[column]), inverse.push_back(0);
        append(inverse, back * rig.rest_joints[j] * -1.0), inverse.push_back(1);

        std::vector<mat3<double>> turns;
        std::vector<float> places;
        for (std::size_t t = 0; t < T; ++t) {
            const mat3<double> world = rig.rotation(t, static_cast<int>(j));
            turns.push_back(parent < 0 ? world : transpose(rig.rotation(t, parent)) * world);
            if (parent < 0) append(places, rig.joint(t, static_cast<int>(j)));
        }
        file.animate(j, "rotation", input, file.add(rotation_keys(turns), {.width = 4}), name);
        if (parent < 0) file.animate(j, "translation", input, file.add(places, {.width = 3}), name);
    }
    file.json["skins"] = Json::array();
    file.json["skins"].push_back(
        {{"inverseBindMatrices", file.add(inverse, {.width = 16})}, {"joints", std::move(joints)}});
    if (roots.size() == 1) file.json["skins"][0]["skeleton"] = roots[0]; // a root of all joints, which glTF demands
    file.json["scenes"] = Json::array();
    file.json["scenes"].push_back({{"nodes", std::move(roots)}});
    file.json["nodes"] = std::move(nodes);
    file.write(path);
}

} // namespace gsh
