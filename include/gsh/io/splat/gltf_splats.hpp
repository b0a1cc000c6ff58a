// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as glTF (.glb) with the extension KHR_gaussian_splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/glb.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/splat/gltf_primitive.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Writes a cloud as one node, atomically. glTF has y up, as gsh has. The document states author and filter.
///
/// Errors  ValueError for an empty cloud or SH above degree 3; IoError for more than 4 GiB.
inline void write_gltf_splats(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                              std::optional<PixelFilter> filter = {}) {
    GlbWriter file;
    begin_gltf_splats(file, {.filter = filter});
    const GltfSplatArrays arrays(file, cloud);
    file.json["scenes"] = {{{"nodes", {0}}}};
    file.json["nodes"] = {{{"name", "gaussians"}, {"mesh", 0}}};
    nlohmann::ordered_json primitives = nlohmann::ordered_json::array();
    primitives.push_back(arrays.primitive(0, cloud.size()));
    file.json["meshes"] = nlohmann::ordered_json::array();
    file.json["meshes"].push_back({{"primitives", std::move(primitives)}});
    file.write(path);
}

/// Reads all Gaussians that the scene of a GLB file shows, in the world, in the order of its nodes. Other meshes are
/// left out. With a time in seconds, nodes are where the first animation has them.
///
/// Errors  those of GlbReader, gltf_world_maps and gaussians_of_primitive; IoError for a file without Gaussians, and
///         for Gaussians in a compression that is another extension.
[[nodiscard]] inline StillSplats read_gltf_splats(const std::filesystem::path& path, std::optional<double> time = {}) {
    const GlbReader file(path);
    const auto maps = gltf_world_maps(file, time);
    struct Piece {
        GaussianCloud<float> cloud;
        Affine<double> map;
    };
    std::vector<Piece> pieces;
    std::size_t count = 0;
    int degree = 0;
    for (std::size_t n = 0; n < maps.size(); ++n) {
        const nlohmann::json& node = file.at("nodes", n);
        if (!maps[n] || !node.contains("mesh")) continue;
        const nlohmann::json& mesh = file.at("meshes", node["mesh"]);
        if (!mesh.contains("primitives") || !mesh["primitives"].is_array()) file.fail("a mesh has no primitives");
        for (const nlohmann::json& primitive : mesh["primitives"]) {
            if (!primitive.is_object() || !primitive.contains("extensions")) continue;
            const nlohmann::json& extensions = primitive["extensions"];
            if (!extensions.is_object() || !extensions.contains("KHR_gaussian_splatting")) continue;
            if (const nlohmann::json& extension = extensions["KHR_gaussian_splatting"];
                extension.is_object() && extension.contains("extensions"))
                file.fail("holds compressed Gaussians, which this version does not read");
            pieces.push_back({gaussians_of_primitive(file, primitive), *maps[n]});
            count += pieces.back().cloud.size();
            degree = std::max(degree, pieces.back().cloud.sh_degree);
            // One mesh may be shown by many nodes.
            if (count > (std::size_t(1) << 28)) file.fail("shows more than 268 million Gaussians");
        }
    }
    if (count == 0) file.fail("shows no Gaussians (KHR_gaussian_splatting)");
    StillSplats splats{GaussianCloud<float>(0, degree), notes_of_gltf(file)};
    GaussianCloud<float>& all = splats.cloud;
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    for (Piece& piece : pieces) {
        const mat3<double>& L = piece.map.linear;
        const bool rests = L == mat3<double>(1.0);
        if (rests)
            for (vec3<float>& mean : piece.cloud.means) mean += vec3<float>(piece.map.translation);
        else
            move_cloud(piece.cloud, piece.map);
        append(all.means, piece.cloud.means);
        append(all.quats, piece.cloud.quats);
        append(all.log_scales, piece.cloud.log_scales);
        append(all.opacity_logits, piece.cloud.opacity_logits);
        const auto width = static_cast<std::size_t>(sh_basis_count(piece.cloud.sh_degree));
        for (std::size_t i = 0; i < piece.cloud.size(); ++i)
            for (std::size_t k = 0; k < basis; ++k)
                all.sh.push_back(k < width ? piece.cloud.sh[i * width + k] : vec3<float>(0));
    }
    return splats;
}

} // namespace gsh
