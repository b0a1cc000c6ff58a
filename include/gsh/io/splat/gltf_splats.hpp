// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as glTF (.glb) with the extension KHR_gaussian_splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/moved_cloud.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_nodes.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
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

/// Reads all Gaussians that the scene of a glTF file shows, in the world, in the order of its nodes. Other meshes are
/// left out. With a time in seconds, nodes are where the first animation has them.
///
/// Errors  IoError for a file that is damaged or shows no Gaussians, and for Gaussians in a compression that is another
///         extension; ValueError for values that no Gaussian has.
[[nodiscard]] inline StillSplats read_gltf_splats(const std::filesystem::path& path, std::optional<double> time = {}) {
    const detail::GltfFile file(path, detail::GltfParts::meshes);
    const detail::GltfNodes nodes(file);
    detail::GltfNumbers numbers(file, std::size_t(1) << 29); // 2 GiB; many nodes may show the same mesh
    const tinygltf::Model& model = file.model();
    detail::GltfNodes::Channels channels;
    if (time && !model.animations.empty()) channels = nodes.channels(model.animations[0], numbers, "animation 0");
    const auto maps = nodes.world_maps(channels, time.value_or(0));
    struct Piece {
        GaussianCloud<float> cloud;
        Affine<double> map;
    };
    std::vector<Piece> pieces;
    std::size_t count = 0;
    int degree = 0;
    for (std::size_t n = 0; n < maps.size(); ++n) {
        const int index = model.nodes[n].mesh;
        if (!maps[n] || index == -1) continue;
        file.check_index(index, model.meshes.size(), "node " + std::to_string(n) + ": mesh");
        for (const auto& primitive : model.meshes[static_cast<std::size_t>(index)].primitives) {
            const auto extension = primitive.extensions.find("KHR_gaussian_splatting");
            if (extension == primitive.extensions.end()) continue;
            if (extension->second.Has("extensions"))
                file.fail("holds compressed Gaussians, which this version does not read");
            pieces.push_back(
                {detail::gaussians_of_primitive(file, numbers, primitive, "mesh " + std::to_string(index)), *maps[n]});
            count += pieces.back().cloud.size();
            degree = std::max(degree, pieces.back().cloud.sh_degree);
        }
    }
    if (count == 0) file.fail("shows no Gaussians (KHR_gaussian_splatting)");
    StillSplats splats{GaussianCloud<float>(0, degree), detail::notes_of_gltf(file)};
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
