// SPDX-License-Identifier: Apache-2.0
/// @file  The formats that gsh-export writes, by the ending of a file's name.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace gsh::programs {

enum class ExportFormat { ply, compressed_ply, spz, splat, glb, usda, html, gsh };

/// What a format needs to be known for before it is written.
struct FormatTraits {
    ExportFormat format;
    const char* ending;       ///< ".compressed.ply"
    bool y_down = false;      ///< by custom; --up applies
    bool is_sequence = false; ///< frames are files of their own, in a folder
    int sh_degree = 3;        ///< the highest that it holds
};

/// The format whose ending a path has, the longest first; none for an unknown ending.
std::optional<FormatTraits> format_of(const std::filesystem::path& path);

/// The endings as a list for messages: ".ply, .compressed.ply, …".
std::string known_endings();

/// The path without the ending of its format: the folder of a sequence.
std::filesystem::path without_ending(const std::filesystem::path& path, const FormatTraits& traits);

} // namespace gsh::programs
