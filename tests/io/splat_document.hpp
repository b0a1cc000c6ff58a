// SPDX-License-Identifier: Apache-2.0
/// @file  A glTF document of Gaussians whose JSON and arrays a test changes before it is written.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/io/splat/gltf_primitive.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::test {

/// One node, one mesh, one primitive.
struct SplatDocument {
    using Json = nlohmann::ordered_json;
    GlbWriter file;

    explicit SplatDocument(const GaussianCloud<float>& cloud) {
        begin_gltf_splats(file, {});
        const GltfSplatArrays arrays(file, cloud);
        file.json["scenes"] = Json::parse(R"([{"nodes": [0]}])");
        file.json["nodes"] = Json::parse(R"([{"mesh": 0}])");
        file.json["meshes"] = Json::array();
        file.json["meshes"].push_back({{"primitives", Json::array({arrays.primitive(0, cloud.size())})}});
    }
    [[nodiscard]] Json& primitive() { return file.json["meshes"][0]["primitives"][0]; }
    [[nodiscard]] Json& extension() { return primitive()["extensions"]["KHR_gaussian_splatting"]; }
    /// The accessor of an attribute, by its name without the extension's prefix.
    [[nodiscard]] Json& accessor(const std::string& name) {
        const Json& attributes = primitive()["attributes"];
        const std::string whole = attributes.contains(name) ? name : "KHR_gaussian_splatting:" + name;
        return file.json["accessors"][attributes[whole].get<std::size_t>()];
    }
    /// Replaces the numbers of an attribute.
    template <class T>
    void set(const std::string& name, const std::vector<T>& numbers, const GlbWriter::Array& array) {
        primitive()["attributes"][name == "POSITION" ? name : "KHR_gaussian_splatting:" + name] =
            file.add(Span<const T>(numbers), array);
    }
};

/// The three numbers of each element, one after the other.
[[nodiscard]] inline std::vector<float> numbers_of(const std::vector<vec3<float>>& vectors) {
    std::vector<float> result;
    for (const vec3<float>& v : vectors) result.insert(result.end(), {v.x, v.y, v.z});
    return result;
}

} // namespace gsh::test
