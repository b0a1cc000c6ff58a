// SPDX-License-Identifier: Apache-2.0
/// @file  The JSON of a glTF file before tinygltf sees it: removal of what is not read.
#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

namespace gsh::detail {

/// Removes extras and extensions, at most 256 levels deep, but not the extensions that are read.
inline void strip_gltf(nlohmann::json& value) {
    nlohmann::json kept;
    if (value.is_object()) {
        if (const auto all = value.find("extensions"); all != value.end() && all->is_object())
            for (const char* name : {"KHR_gaussian_splatting", "EXT_mesh_gpu_instancing", "KHR_node_visibility"})
                if (const auto own = all->find(name); own != all->end() && own->is_object())
                    kept[name] = std::move(*own);
        value.erase("extras"), value.erase("extensions");
    }
    if (value.is_structured())
        for (auto& child : value) strip_gltf(child);
    if (kept.is_object()) value["extensions"] = std::move(kept);
}

/// Leaves the attributes of primitives and what `strip_gltf` left of their extensions; of Gaussians also mode and
/// indices.
inline void strip_gltf_meshes(nlohmann::json& meshes) {
    for (auto& mesh : meshes)
        for (auto& primitive : mesh["primitives"]) {
            nlohmann::json kept = nlohmann::json::object();
            for (const char* key : {"attributes", "extensions", "mode", "indices"})
                if (primitive.contains(key)) kept[key] = std::move(primitive[key]);
            if (!kept.contains("extensions")) kept.erase("mode"), kept.erase("indices");
            primitive = std::move(kept);
        }
}

/// JSON as tinygltf receives it.
[[nodiscard]] inline std::string gltf_text(const nlohmann::json& json) {
    return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// A URI in which %2B stands for each plus.
[[nodiscard]] inline std::string with_escaped_plus(std::string_view uri) {
    std::string text;
    for (const char c : uri) c == '+' ? text.append("%2B") : text.append(1, c);
    return text;
}

/// A URI's text with %20 and other escapes resolved.
[[nodiscard]] inline std::string decoded_uri(std::string_view uri) {
    const auto digit = [](char c) {
        return c >= '0' && c <= '9'   ? c - '0'
               : c >= 'a' && c <= 'f' ? c - 'a' + 10
               : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                      : -1;
    };
    std::string text;
    for (std::size_t i = 0; i < uri.size(); ++i)
        if (uri[i] == '%' && i + 2 < uri.size() && digit(uri[i + 1]) >= 0 && digit(uri[i + 2]) >= 0) {
            text.push_back(static_cast<char>(16 * digit(uri[i + 1]) + digit(uri[i + 2])));
            i += 2;
        } else {
            text.push_back(uri[i]);
        }
    return text;
}

} // namespace gsh::detail
