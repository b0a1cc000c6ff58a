// SPDX-License-Identifier: Apache-2.0
/// @file  Writes moving Gaussians as glTF (.glb): a node for each rigid piece, and an animation that moves the nodes.
#pragma once

#include <gsh/avatar/moving_pieces.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/io/splat/gltf_primitive.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Writes pieces on animated nodes, atomically. At rest the nodes are where the first frame has them.
///
/// times [T] are in seconds and ascend.
/// Errors  ShapeError unless there is a time for each frame; ValueError for times that do not ascend as floats, no
///         piece, a piece without Gaussians, or SH above degree 3.
inline void write_gltf_pieces(const std::filesystem::path& path, const MovingPieces& pieces, Span<const double> times,
                              std::optional<PixelFilter> filter = {}) {
    constexpr auto where = "write_gltf_pieces";
    check_value(pieces.begins.size() > 1 && !times.empty(), where, "there must be a piece and a frame");
    check_size(where, "times", times.size(), pieces.poses.size(), "one for each frame");
    GlbWriter file;
    begin_gltf_splats(file, {.filter = filter});
    const GltfSplatArrays arrays(file, pieces.cloud);
    const std::size_t K = pieces.begins.size() - 1;
    check_size(where, "the pieces", pieces.begins[K], pieces.cloud.size(), "they must hold all Gaussians");
    for (std::size_t k = 0; k < K; ++k)
        check_value(pieces.begins[k] < pieces.begins[k + 1], where,
                    "piece " + std::to_string(k) + " has no Gaussian, but a mesh of glTF must have one");
    using Json = nlohmann::ordered_json;
    Json children = Json::array(), nodes = Json::array(), meshes = Json::array();
    nodes.push_back({{"name", "avatar"}});
    const int input = file.add_times(times, where);
    std::vector<float> turns, places; // of all pieces, so that they share two views
    for (std::size_t k = 0; k < K; ++k) {
        std::vector<mat3<double>> rotations;
        for (const auto& pose : pieces.poses) {
            rotations.push_back(pose[k].linear);
            const vec3<double>& t = pose[k].translation;
            places.insert(places.end(), {float(t.x), float(t.y), float(t.z)});
        }
        const std::vector<float> keys = rotation_keys(rotations);
        turns.insert(turns.end(), keys.begin(), keys.end());
    }
    const int turn_view = file.add_view(turns.data(), turns.size() * sizeof(float)),
              place_view = file.add_view(places.data(), places.size() * sizeof(float));
    const std::size_t T = times.size();
    for (std::size_t k = 0; k < K; ++k) {
        const float *q = turns.data() + 4 * T * k, *t = places.data() + 3 * T * k;
        children.push_back(k + 1);
        nodes.push_back({{"mesh", k}, {"rotation", {q[0], q[1], q[2], q[3]}}, {"translation", {t[0], t[1], t[2]}}});
        Json primitives = Json::array();
        primitives.push_back(arrays.primitive(pieces.begins[k], pieces.begins[k + 1] - pieces.begins[k]));
        meshes.push_back({{"primitives", std::move(primitives)}});
        if (T == 1) continue;
        const int turn = file.add_accessor(turn_view, 16 * T * k, Span<const float>(q, 4 * T), {.width = 4}),
                  place = file.add_accessor(place_view, 12 * T * k, Span<const float>(t, 3 * T), {.width = 3});
        file.animate(k + 1, "rotation", input, turn);
        file.animate(k + 1, "translation", input, place);
    }
    nodes[0]["children"] = std::move(children);
    file.json["scenes"] = Json::array({{{"nodes", {0}}}});
    file.json["nodes"] = std::move(nodes);
    file.json["meshes"] = std::move(meshes);
    file.write(path);
}

} // namespace gsh
