// SPDX-License-Identifier: Apache-2.0
/// @file  glTF files of sample rigs, written independently of gsh's writer and of tinygltf.
#pragma once

#include "support/sample_rig.hpp"

#include <nlohmann/json.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace gsh::test {

using Json = nlohmann::json;

/// A quaternion x y z w of a rotation, by its axis and angle.
inline std::array<double, 4> quaternion_of(const mat3<double>& R) {
    // The largest of the four squares is at least a quarter.
    const double t[4] = {1 + R[0].x - R[1].y - R[2].z, 1 - R[0].x + R[1].y - R[2].z, 1 - R[0].x - R[1].y + R[2].z,
                         1 + R[0].x + R[1].y + R[2].z};
    int k = 0;
    for (int i = 1; i < 4; ++i)
        if (t[i] > t[k]) k = i;
    const double w[4][4] = {{t[0], R[0].y + R[1].x, R[2].x + R[0].z, R[1].z - R[2].y},
                            {R[0].y + R[1].x, t[1], R[1].z + R[2].y, R[2].x - R[0].z},
                            {R[2].x + R[0].z, R[1].z + R[2].y, t[2], R[0].y - R[1].x},
                            {R[1].z - R[2].y, R[2].x - R[0].z, R[0].y - R[1].x, t[3]}};
    const double s = 0.5 / std::sqrt(t[k]);
    return {w[k][0] * s, w[k][1] * s, w[k][2] * s, w[k][3] * s};
}

struct GltfOptions {
    unsigned axes = 0;                    ///< not 0: every joint has rest axes of its own, by this seed
    bool armature = false;                ///< a node above, which scales by 0.01 and turns z up to y up
    bool skin = false;                    ///< with the rest pose as inverse bind matrices
    bool posed_nodes = false;             ///< the nodes' own transforms are those of frame 1, not of the rest pose
    bool vrm = false;                     ///< nodes have numbers for names; VRM's extension names the bones
    double step = 1.0 / 30;               ///< seconds
    std::string interpolation = "LINEAR"; ///< or STEP, CUBICSPLINE
};

[[nodiscard]] inline std::string base64_of(const std::string& bytes) {
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        std::uint32_t three = 0;
        for (std::size_t k = 0; k < 3; ++k)
            three = three << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
        for (std::size_t k = 0; k < 4; ++k)
            out.push_back(i + k > bytes.size() ? '=' : digits[three >> (18 - 6 * k) & 63]);
    }
    return out;
}

/// The JSON and the bytes of one buffer.
struct GltfFiles {
    Json json;
    std::string bytes;

    /// Appends floats and returns the number of their accessor.
    int add(const std::vector<double>& numbers, const std::string& type, std::size_t width) {
        const std::size_t offset = bytes.size();
        for (const double number : numbers) {
            const auto value = static_cast<float>(number);
            bytes.append(reinterpret_cast<const char*>(&value), 4);
        }
        json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", 4 * numbers.size()}});
        json["accessors"].push_back({{"bufferView", json["bufferViews"].size() - 1},
                                     {"componentType", 5126},
                                     {"count", numbers.size() / width},
                                     {"type", type}});
        json["buffers"] = Json::array({{{"byteLength", bytes.size()}}});
        return static_cast<int>(json["accessors"].size()) - 1;
    }

    [[nodiscard]] std::string glb() const {
        std::string text = json.dump(), body = bytes, out("glTF", 4);
        text.resize((text.size() + 3) / 4 * 4, ' '), body.resize((body.size() + 3) / 4 * 4, '\0');
        const auto number = [&](std::size_t value) {
            const auto n = static_cast<std::uint32_t>(value);
            out.append(reinterpret_cast<const char*>(&n), 4);
        };
        number(2), number(20 + text.size() + 8 + body.size());
        number(text.size()), out.append("JSON").append(text);
        number(body.size()), out.append("BIN\0", 4).append(body);
        return out;
    }
    /// As text, with a URI for the buffer; without one, the bytes themselves in base64.
    [[nodiscard]] std::string gltf(const std::string& uri = {}) const {
        Json copy = json;
        copy["buffers"][0]["uri"] = uri.empty() ? "data:application/octet-stream;base64," + base64_of(bytes) : uri;
        return copy.dump(1);
    }
};

/// The sample's angles are turned in the order Z, X, Y.
inline GltfFiles gltf_of(const SampleRig& rig, const GltfOptions& o = {}) {
    const std::size_t J = rig.names.size(), T = rig.root.size();
    GltfFiles files;
    Json& json = files.json;
    json["asset"] = {{"version", "2.0"}, {"generator", "a test"}};
    const double scale = o.armature ? 0.01 : 1;
    const mat3<double> world = o.armature ? turn_about(0, -1.5707963267948966) : mat3<double>(1.0);
    const std::size_t first = o.armature ? 1 : 0;
    Rng rng(o.axes);
    std::vector<mat3<double>> axes; // world_from_joint at rest
    for (std::size_t j = 0; j < J; ++j)
        axes.push_back(o.axes ? turn_about(0, rng.uniform(-3, 3)) * turn_about(1, rng.uniform(-3, 3))
                              : mat3<double>(1.0));
    const auto list = [](const auto& values) {
        return Json(std::vector<double>(std::begin(values), std::end(values)));
    };
    const auto three = [](const vec3<double>& v) { return std::array<double, 3>{v.x, v.y, v.z}; };
    json["nodes"] = Json::array();
    if (o.armature)
        json["nodes"].push_back({{"name", "Armature"},
                                 {"rotation", list(quaternion_of(world))},
                                 {"scale", list(std::array<double, 3>{scale, scale, scale})}});
    std::vector<SamplePose> poses;
    for (std::size_t t = 0; t < T; ++t) poses.push_back(pose_of(rig, t, "ZXY"));
    std::vector<double> times, inverse;
    for (std::size_t t = 0; t < T; ++t) times.push_back(0.5 + o.step * static_cast<double>(t));
    const int input = files.add(times, "SCALAR", 1);
    Json channels = Json::array(), samplers = Json::array(), joints = Json::array(), bones = Json::object();
    const auto animate = [&](std::size_t node, const char* path, const std::vector<double>& numbers,
                             std::size_t width) {
        std::vector<double> stored;
        if (o.interpolation == "CUBICSPLINE") // with tangents of zero
            for (std::size_t t = 0; t < T; ++t)
                for (std::size_t k = 0; k < 3 * width; ++k)
                    stored.push_back(k / width == 1 ? numbers[t * width + k % width] : 0.0);
        else
            stored = numbers;
        samplers.push_back({{"input", input},
                            {"output", files.add(stored, width == 4 ? "VEC4" : "VEC3", width)},
                            {"interpolation", o.interpolation}});
        channels.push_back({{"sampler", samplers.size() - 1}, {"target", {{"node", node}, {"path", path}}}});
    };
    for (std::size_t j = 0; j < J; ++j) {
        const int p = rig.parents[j];
        const auto parent = static_cast<std::size_t>(p < 0 ? 0 : p);
        const auto turn = [&](std::size_t t, std::size_t k) { return poses[t].rotations[k] * axes[k]; };
        const auto local = [&](const mat3<double>& own, const mat3<double>& above) {
            return quaternion_of(transpose(p < 0 ? world : above) * own);
        };
        const vec3<double> place = transpose(p < 0 ? world : axes[parent]) *
                                   (p < 0 ? rig.rest[j] : rig.rest[j] - rig.rest[parent]) * (1 / scale);
        Json node = {{"name", o.vrm ? std::to_string(j) : rig.names[j]}, {"translation", list(three(place))}};
        node["rotation"] =
            list(o.posed_nodes && T > 1 ? local(turn(1, j), turn(1, parent)) : local(axes[j], axes[parent]));
        json["nodes"].push_back(node);
        if (p >= 0)
            json["nodes"][first + parent]["children"].push_back(first + j);
        else if (o.armature)
            json["nodes"][0]["children"].push_back(first + j);
        bones[rig.names[j]] = {{"node", first + j}};
        joints.push_back(first + j);
        std::vector<double> turns, places;
        for (std::size_t t = 0; t < T; ++t) {
            for (const double x : local(turn(t, j), turn(t, parent))) turns.push_back(x);
            for (const double x : three(transpose(world) * rig.root[t] * (1 / scale))) places.push_back(x);
        }
        animate(first + j, "rotation", turns, 4);
        if (p < 0) animate(first + j, "translation", places, 3);
        const mat3<double> bind = transpose(world) * axes[j]; // in the armature's axes and unit
        const vec3<double> at = transpose(world) * rig.rest[j] * (1 / scale), back = transpose(bind) * at * -1.0;
        for (int c = 0; c < 3; ++c)
            for (const double x : {bind[0][c], bind[1][c], bind[2][c], 0.0}) inverse.push_back(x);
        for (const double x : {back.x, back.y, back.z, 1.0}) inverse.push_back(x);
    }
    json["animations"] = Json::array({{{"name", "walk"}, {"channels", channels}, {"samplers", samplers}}});
    if (o.skin)
        json["skins"] = Json::array({{{"joints", joints}, {"inverseBindMatrices", files.add(inverse, "MAT4", 16)}}});
    if (o.vrm) json["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"] = bones;
    json["scenes"] = Json::array({{{"nodes", Json::array({0})}}});
    json["scene"] = 0;
    return files;
}

} // namespace gsh::test
