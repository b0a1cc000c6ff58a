// SPDX-License-Identifier: Apache-2.0
/// @file  The nodes of a glTF document: their transforms to the world, at rest or at a time of its first animation.
#pragma once

#include <gsh/io/file/glb.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

/// For each node, the map from its frame to the world; none for nodes that the scene does not show.
///
/// With a time in seconds, nodes move as the first animation says: translation, rotation and scale, LINEAR or STEP.
/// Before its first and after its last key a channel keeps the nearest value.
///
/// Errors  IoError, naming the file, for nodes that do not form trees, for numbers that are no transform, and for an
///         animation that is damaged or has cubic splines.
[[nodiscard]] inline std::vector<std::optional<Affine<double>>> gltf_world_maps(const GlbReader& file,
                                                                                std::optional<double> time = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The parts of a node's own transform.
struct GltfPose {
    vec3<double> translation = vec3<double>(0), scale = vec3<double>(1);
    quat<double> rotation = {};
    std::optional<Affine<double>> matrix = {}; // instead of the parts

    [[nodiscard]] Affine<double> map() const {
        if (matrix) return *matrix;
        const mat3<double> R = rotation_matrix(normalize(rotation));
        return {mat3<double>(R[0] * scale.x, R[1] * scale.y, R[2] * scale.z), translation};
    }
};

inline GltfPose pose_of_gltf(const GlbReader& file, const nlohmann::json& node, const std::string& where) {
    const auto numbers = [&](const char* member, std::vector<double> otherwise) {
        const auto found = node.find(member);
        if (found == node.end()) return otherwise;
        const auto bad = [](const nlohmann::json& n) { return !n.is_number() || !std::isfinite(n.get<double>()); };
        if (!found->is_array() || found->size() != otherwise.size() || std::any_of(found->begin(), found->end(), bad))
            file.fail(where + "." + member + " is not a list of " + std::to_string(otherwise.size()) + " numbers");
        return found->get<std::vector<double>>();
    };
    GltfPose pose;
    const auto t = numbers("translation", {0, 0, 0}), s = numbers("scale", {1, 1, 1}),
               r = numbers("rotation", {0, 0, 0, 1});
    pose.translation = {t[0], t[1], t[2]}, pose.scale = {s[0], s[1], s[2]}, pose.rotation = {r[3], r[0], r[1], r[2]};
    if (!(dot(pose.rotation, pose.rotation) > 0)) file.fail(where + ".rotation is 0");
    if (node.contains("matrix")) {
        const auto m = numbers("matrix", std::vector<double>(16));
        pose.matrix = Affine<double>(mat3<double>({m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}),
                                     {m[12], m[13], m[14]});
    }
    return pose;
}

/// Moves the poses of nodes to a time of an animation.
inline void animate_gltf(const GlbReader& file, const nlohmann::json& animation, double time,
                         std::vector<GltfPose>& poses) {
    const auto member = [&](const nlohmann::json& object, const char* name) -> const nlohmann::json& {
        if (!object.is_object() || !object.contains(name))
            file.fail(std::string("animations[0] lacks the member ") + name);
        return object[name];
    };
    const nlohmann::json &channels = member(animation, "channels"), &samplers = member(animation, "samplers");
    if (!channels.is_array() || !samplers.is_array()) file.fail("animations[0] is damaged");
    for (const nlohmann::json& channel : channels) {
        const nlohmann::json &index = member(channel, "sampler"), &target = member(channel, "target");
        if (!index.is_number_unsigned() || index >= samplers.size() || !target.is_object())
            file.fail("animations[0] has a channel with no sampler or target");
        if (!target.contains("node")) continue;
        const nlohmann::json &sampler = samplers[index.get<std::size_t>()], &path = member(target, "path");
        (void)file.at("nodes", target["node"]);
        GltfPose& pose = poses[target["node"].get<std::size_t>()];
        const bool turns = path == "rotation";
        if (!turns && path != "translation" && path != "scale") continue; // weights of morph targets
        const std::string kind = sampler.contains("interpolation") ? sampler["interpolation"].dump() : "\"LINEAR\"";
        if (kind != "\"LINEAR\"" && kind != "\"STEP\"")
            file.fail("animations[0] has the interpolation " + kind.substr(0, 20) + ", expected LINEAR or STEP");
        const std::size_t width = turns ? 4 : 3;
        const auto times = file.floats(member(sampler, "input"), 1),
                   values = file.floats(member(sampler, "output"), width);
        if (times.empty() || values.size() != times.size() * width || !std::is_sorted(times.begin(), times.end()))
            file.fail("animations[0] has " + std::to_string(times.size()) + " times and " +
                      std::to_string(values.size() / width) + " values, expected as many, in ascending order");
        const auto after = static_cast<std::size_t>(
            std::upper_bound(times.begin(), times.end(), static_cast<float>(time)) - times.begin());
        const std::size_t b = std::min(after, times.size() - 1), a = after > 0 ? after - 1 : 0;
        double share = b > a && times[b] > times[a] ? (time - times[a]) / (double(times[b]) - times[a]) : 0;
        if (kind == "\"STEP\"") share = 0;
        const auto value = [&](std::size_t key, std::size_t c) { return double(values[key * width + c]); };
        const auto mixed = [&](std::size_t c) { return value(a, c) + (value(b, c) - value(a, c)) * share; };
        if (turns) {
            const quat<double> from{value(a, 3), value(a, 0), value(a, 1), value(a, 2)},
                to{value(b, 3), value(b, 0), value(b, 1), value(b, 2)};
            // The arc from one key to the next; near keys are mixed in a straight line.
            const double cosine = std::clamp(std::abs(dot(from, to)), 0.0, 1.0), angle = std::acos(cosine);
            const double p = angle > 1e-3 ? std::sin((1 - share) * angle) / std::sin(angle) : 1 - share;
            const double q =
                (angle > 1e-3 ? std::sin(share * angle) / std::sin(angle) : share) * (dot(from, to) < 0 ? -1 : 1);
            pose.rotation = {p * from.w + q * to.w, p * from.x + q * to.x, p * from.y + q * to.y,
                             p * from.z + q * to.z};
            if (!(dot(pose.rotation, pose.rotation) > 0)) file.fail("animations[0] has a rotation of length 0");
        } else {
            (path == "scale" ? pose.scale : pose.translation) = {mixed(0), mixed(1), mixed(2)};
        }
        pose.matrix.reset();
    }
}

} // namespace detail

inline std::vector<std::optional<Affine<double>>> gltf_world_maps(const GlbReader& file, std::optional<double> time) {
    const nlohmann::json& nodes = file.list("nodes");
    std::vector<detail::GltfPose> poses;
    for (std::size_t n = 0; n < nodes.size(); ++n)
        poses.push_back(detail::pose_of_gltf(file, file.at("nodes", n), "nodes[" + std::to_string(n) + "]"));
    if (time && !file.list("animations").empty()) detail::animate_gltf(file, file.at("animations", 0), *time, poses);

    std::vector<std::optional<Affine<double>>> maps(nodes.size());
    std::vector<std::size_t> open;
    const auto visit = [&](const nlohmann::json& list, const char* what, const Affine<double>& parent) {
        if (!list.is_array()) file.fail(std::string(what) + " is not a list");
        for (const nlohmann::json& index : list) {
            (void)file.at("nodes", index);
            const auto n = index.get<std::size_t>();
            if (maps[n]) file.fail("nodes[" + std::to_string(n) + "] has two parents, or lies on a cycle");
            maps[n] = parent * poses[n].map();
            open.push_back(n);
        }
    };
    const nlohmann::json shown = file.json().contains("scene") ? file.json()["scene"] : nlohmann::json(0);
    if (file.list("scenes").empty()) return maps;
    const nlohmann::json& scene = file.at("scenes", shown);
    if (scene.contains("nodes")) visit(scene["nodes"], "scenes.nodes", Affine<double>());
    while (!open.empty()) {
        const std::size_t n = open.back();
        open.pop_back();
        const Affine<double> map = *maps[n];
        if (nodes[n].contains("children")) visit(nodes[n]["children"], "nodes.children", map);
    }
    return maps;
}

} // namespace gsh
