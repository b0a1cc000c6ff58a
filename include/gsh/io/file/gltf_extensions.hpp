// SPDX-License-Identifier: Apache-2.0
/// @file  The one list of glTF extensions without which gsh still reads a file as its author meant it.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

namespace gsh::detail {

/// What is read of a glTF file.
enum class GltfParts {
    nodes,  ///< nodes, skins, animations
    meshes, ///< also the attributes of meshes, and their extension KHR_gaussian_splatting
};

/// Whether a file that lists an extension in `extensionsRequired` can be read: gsh reads the extension, or it concerns
/// what gsh does not read. All others must be refused (glTF 2.0, section 3.12), also those that are not known.
[[nodiscard]] inline bool reads_despite_gltf_extension(std::string_view name, GltfParts parts) {
    // The look of surfaces, sounds, and notes: they move nothing and shape nothing. A vendor's prefix comes first.
    static constexpr std::array looks{"materials_", "texture_", "lights_", "audio", "xmp"};
    static constexpr std::array notes{"EXT_structural_metadata",
                                      "EXT_mesh_features",
                                      "EXT_instance_features",
                                      "EXT_feature_metadata",
                                      "CESIUM_primitive_outline",
                                      "KHR_techniques_webgl",
                                      "KHR_node_selectability",
                                      "KHR_node_hoverability",
                                      "MOZ_lightmap",
                                      "MSFT_lod",
                                      "VRM",
                                      "VRMC_vrm",
                                      "VRMC_vrm_animation",
                                      "VRMC_springBone",
                                      "VRMC_springBone_extended_collider",
                                      "VRMC_node_constraint"};
    static constexpr std::array read{"KHR_gaussian_splatting", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing",
                                     "KHR_node_visibility"};
    const auto lists = [&](const auto& list) { return std::find(list.begin(), list.end(), name) != list.end(); };
    if (lists(notes) || lists(read)) return true;
    if (parts == GltfParts::nodes &&
        (name == "KHR_draco_mesh_compression" || name.starts_with("KHR_gaussian_splatting")))
        return true; // of meshes
    const auto prefix = name.find('_');
    const std::string_view own = prefix == std::string_view::npos ? name : name.substr(prefix + 1);
    return std::any_of(looks.begin(), looks.end(), [&](std::string_view look) { return own.starts_with(look); });
}

} // namespace gsh::detail
