// SPDX-License-Identifier: Apache-2.0
/// @file  Writes an avatar as a skinned mesh in glTF (.glb): joints, colours, expressions, and a motion.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/colored_mesh.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/math/rotation.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// A displacement per vertex as an accessor. Where most are zero, as of an expression, it is sparse.
///
/// glTF allows to leave out byteOffset, and to have neither bytes nor sparse elements where all are zero. VTK 9.7.2 and
/// F3D 4.0.0, which reads by VTK, refuse such a file, so both are written.
inline int add_displacements(GlbWriter& file, const std::vector<vec3<float>>& displacements) {
    std::vector<std::uint32_t> indices;
    std::vector<float> moved, all;
    vec3<float> low(0), high(0);
    for (std::size_t v = 0; v < displacements.size(); ++v) {
        const vec3<float>& d = displacements[v];
        all.insert(all.end(), {d.x, d.y, d.z});
        low = glm::min(low, d), high = glm::max(high, d);
        if (d == vec3<float>(0)) continue;
        indices.push_back(static_cast<std::uint32_t>(v));
        moved.insert(moved.end(), {d.x, d.y, d.z});
    }
    if (2 * indices.size() > displacements.size()) return file.add(all, {.width = 3, .bounds = true});
    nlohmann::ordered_json accessor{{"componentType", 5126},
                                    {"count", displacements.size()},
                                    {"type", "VEC3"},
                                    {"min", {low.x, low.y, low.z}},
                                    {"max", {high.x, high.y, high.z}}};
    if (indices.empty()) indices = {0}, moved = {0, 0, 0};
    accessor["sparse"] = {
        {"count", indices.size()},
        {"indices",
         {{"bufferView", file.add_view(indices.data(), indices.size() * sizeof(std::uint32_t))},
          {"byteOffset", 0},
          {"componentType", 5125}}},
        {"values", {{"bufferView", file.add_view(moved.data(), moved.size() * sizeof(float))}, {"byteOffset", 0}}}};
    file.json["accessors"].push_back(std::move(accessor));
    return static_cast<int>(file.json["accessors"].size()) - 1;
}

/// The vertices, triangles, expressions and the material of a mesh as mesh 0.
inline void add_gltf_mesh(GlbWriter& file, const ColoredMesh& mesh) {
    using OrderedJson = nlohmann::ordered_json;
    std::vector<float> positions, normals, colors, weights;
    std::vector<std::uint16_t> joints;
    std::vector<std::uint32_t> indices;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const vec3<float> p(mesh.vertices[v]);
        // glTF demands unit normals; a vertex without triangles has any.
        const vec3<float> n = length(mesh.normals[v]) > 0 ? vec3<float>(mesh.normals[v]) : vec3<float>(0, 1, 0);
        positions.insert(positions.end(), {p.x, p.y, p.z});
        normals.insert(normals.end(), {n.x, n.y, n.z});
        for (int c = 0; c < 3; ++c) colors.push_back(srgb_to_linear(mesh.colors[v][c]));
        joints.insert(joints.end(), mesh.joints[v].begin(), mesh.joints[v].end());
        weights.insert(weights.end(), mesh.weights[v].begin(), mesh.weights[v].end());
    }
    for (const auto& face : mesh.faces)
        for (const int v : face) indices.push_back(static_cast<std::uint32_t>(v));
    constexpr int vertices = 34962, elements = 34963;
    OrderedJson attributes{{"POSITION", file.add(positions, {.width = 3, .bounds = true, .target = vertices})},
                           {"NORMAL", file.add(normals, {.width = 3, .target = vertices})},
                           {"COLOR_0", file.add(colors, {.width = 3, .target = vertices})},
                           {"JOINTS_0", file.add(joints, {.width = 4, .target = vertices})},
                           {"WEIGHTS_0", file.add(weights, {.width = 4, .target = vertices})}};
    OrderedJson primitive{
        {"attributes", std::move(attributes)}, {"indices", file.add(indices, {.target = elements})}, {"material", 0}};
    const std::size_t E = mesh.expressions.size();
    OrderedJson names = OrderedJson::array();
    for (std::size_t e = 0; e < E; ++e) {
        primitive["targets"].push_back({{"POSITION", add_displacements(file, mesh.expressions[e])}});
        names.push_back("expression_" + std::to_string(e));
    }
    file.json["materials"] = OrderedJson::array();
    file.json["materials"].push_back({{"name", "avatar"},
                                      {"pbrMetallicRoughness", {{"metallicFactor", 0.0}, {"roughnessFactor", 1.0}}},
                                      {"extensions", {{"KHR_materials_unlit", OrderedJson::object()}}}});
    OrderedJson body{{"name", "body"}, {"primitives", OrderedJson::array({primitive})}};
    if (E) body["weights"] = std::vector<float>(E, 0.0f), body["extras"] = {{"targetNames", names}};
    file.json["meshes"] = OrderedJson::array({body});
}

/// Node j is joint j; the last node holds the mesh. It is beside the bones, whose transforms do not apply to it.
inline void add_gltf_skin(GlbWriter& file, const BodyModel& model, const std::vector<vec3<double>>& rest_joints) {
    using OrderedJson = nlohmann::ordered_json;
    const std::size_t J = rest_joints.size();
    OrderedJson nodes = OrderedJson::array(), skin_joints = OrderedJson::array();
    std::vector<float> inverse;
    for (std::size_t j = 0; j < J; ++j) {
        const int parent = model.parents[j];
        const vec3<double> from = parent < 0 ? vec3<double>(0) : rest_joints[static_cast<std::size_t>(parent)];
        const vec3<double> step = rest_joints[j] - from, &at = rest_joints[j];
        const auto& known = model.joint_names;
        nodes.push_back({{"name", known.empty() ? "joint_" + std::to_string(j) : known[j]},
                         {"translation", {step.x, step.y, step.z}}});
        if (parent >= 0) nodes[static_cast<std::size_t>(parent)]["children"].push_back(j);
        skin_joints.push_back(j);
        inverse.insert(inverse.end(),
                       {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, float(-at.x), float(-at.y), float(-at.z), 1});
    }
    nodes.push_back({{"name", "avatar"}, {"mesh", 0}, {"skin", 0}});
    file.json["nodes"] = std::move(nodes);
    file.json["scenes"] = OrderedJson::array();
    file.json["scenes"].push_back({{"nodes", {0, J}}});
    file.json["skins"] = OrderedJson::array();
    file.json["skins"].push_back(
        {{"inverseBindMatrices", file.add(inverse, {.width = 16})}, {"joints", skin_joints}, {"skeleton", 0}});
}

/// Rotations of the bones, places of the root and weights of E expressions, with the times of accessor `input`.
inline void animate_gltf_mesh(GlbWriter& file, int input, const Motion& motion, Span<const std::size_t> frames,
                              const vec3<double>& root, std::size_t E) {
    const std::size_t J = motion.joint_count;
    for (std::size_t j = 0; j < J; ++j) {
        std::vector<mat3<double>> turns;
        for (const std::size_t f : frames) turns.push_back(rotation_from_axis_angle(motion.pose_at(f)[j]));
        file.animate(j, "rotation", input, file.add(rotation_keys(turns), {.width = 4}));
    }
    std::vector<float> places, shares;
    for (const std::size_t f : frames) {
        const vec3<double> place = root + motion.transl[f];
        places.insert(places.end(), {float(place.x), float(place.y), float(place.z)});
        for (std::size_t e = 0; e < E; ++e)
            shares.push_back(e < motion.expression_count ? float(motion.expression_at(f)[e]) : 0.0f);
    }
    file.animate(0, "translation", input, file.add(places, {.width = 3}));
    if (E && motion.expression_count) file.animate(J, "weights", input, file.add(shares, {}));
}

} // namespace detail

/// Writes the mesh of an avatar, atomically. Bones are named as the body's joints. With frames, an animation turns the
/// bones, moves the root and sets the expressions.
///
/// The material is unlit (KHR_materials_unlit), because the colours contain the light of the capture; programs without
/// that extension shade it once more.
///
/// times has one entry, in ascending seconds, for each of `frames`; both may be empty.
/// Errors  those of colored_mesh; ShapeError unless times fits the frames and the motion fits the body; ValueError for
///         times that do not ascend as floats.
inline void write_gltf_mesh(const std::filesystem::path& path, const AvatarData& avatar, const Motion& motion,
                            Span<const std::size_t> frames, Span<const double> times) {
    constexpr auto where = "write_gltf_mesh";
    check_size(where, "times", times.size(), frames.size(), "one for each frame");
    check_size(where, "the motion's joints", motion.joint_count, avatar.rig.joint_count());
    const ColoredMesh mesh = colored_mesh(avatar, motion.betas);
    GlbWriter file;
    file.json["extensionsUsed"] = {"KHR_materials_unlit"};
    detail::add_gltf_mesh(file, mesh);
    detail::add_gltf_skin(file, avatar.rig.body, mesh.rest_joints);
    if (!frames.empty())
        detail::animate_gltf_mesh(file, file.add_times(times, where), motion, frames, mesh.rest_joints[0],
                                  mesh.expressions.size());
    file.write(path);
}

} // namespace gsh
