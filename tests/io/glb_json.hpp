// SPDX-License-Identifier: Apache-2.0
/// @file  The JSON of a GLB file, read and replaced without gsh's reader.
#pragma once

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>

namespace gsh::test {

inline std::uint32_t word_of_glb(const std::string& bytes, std::size_t at) {
    std::uint32_t word = 0;
    std::memcpy(&word, bytes.data() + at, 4);
    return word;
}

inline nlohmann::ordered_json json_of_glb(const std::filesystem::path& path) {
    const std::string bytes = read_file(path);
    return nlohmann::ordered_json::parse(bytes.substr(20, word_of_glb(bytes, 12)));
}

/// Writes the file anew with another JSON.
inline void replace_json_of_glb(const std::filesystem::path& path, const nlohmann::ordered_json& json) {
    std::string bytes = read_file(path), text = json.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    bytes.replace(20, word_of_glb(bytes, 12), text);
    for (const auto& [at, size] : {std::pair<std::size_t, std::size_t>{8, bytes.size()}, {12, text.size()}}) {
        const auto word = static_cast<std::uint32_t>(size);
        std::memcpy(bytes.data() + at, &word, 4);
    }
    write_file(path, bytes);
}

} // namespace gsh::test
