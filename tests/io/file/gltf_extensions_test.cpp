// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/gltf_extensions.hpp>

#include <doctest/doctest.h>

#include <string>

using namespace gsh::detail;

TEST_CASE("which extensions a file may require") {
    const auto reads = [](const char* name, GltfParts parts) { return reads_despite_gltf_extension(name, parts); };
    for (const auto parts : {GltfParts::nodes, GltfParts::meshes}) {
        for (const char* name :
             {"KHR_gaussian_splatting", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_node_visibility",
              "KHR_materials_unlit", "KHR_materials_variants", "ADOBE_materials_clearcoat_tint",
              "KHR_texture_transform", "EXT_texture_webp", "KHR_lights_punctual", "EXT_lights_image_based",
              "KHR_xmp_json_ld", "VRMC_vrm", "VRMC_materials_mtoon", "EXT_structural_metadata"}) {
            INFO(std::string(name));
            CHECK(reads(name, parts));
        }
        for (const char* name : {"", "materials", "VENDOR_x", "EXT_meshopt_compression", "KHR_meshopt_compression",
                                 "KHR_animation_pointer", "CESIUM_RTC", "khr_gaussian_splatting"}) {
            INFO(std::string(name));
            CHECK(!reads(name, parts));
        }
    }
    // What is compressed in meshes does not concern a motion.
    for (const char* name : {"KHR_draco_mesh_compression", "KHR_gaussian_splatting_compression_spz_2"}) {
        CHECK(reads(name, GltfParts::nodes));
        CHECK(!reads(name, GltfParts::meshes));
    }
}
