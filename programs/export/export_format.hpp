// SPDX-License-Identifier: Apache-2.0
/// @file  The formats that gsh-export writes, by the ending of a file's name.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace gsh {
enum class SplatFormat;
struct SplatFormatTraits;
} // namespace gsh

namespace gsh::programs {

/// Gaussians alone, or one of the formats that hold more: a page, and an avatar that still moves.
enum class ExportKind { splats, page, avatar };

/// A format: a row of the library's table, or one of gsh-export's own.
struct FormatTraits {
    std::string_view ending; ///< ".compressed.ply"
    ExportKind kind = ExportKind::splats;
    const SplatFormatTraits* splats = nullptr; ///< the row, for a kind of splats

    [[nodiscard]] bool is(SplatFormat format) const;
    [[nodiscard]] bool is_y_down() const; ///< by custom; --up applies
};

/// The format whose ending a path has, the longest first; none for an unknown ending.
std::optional<FormatTraits> format_of(const std::filesystem::path& path);

/// The endings as a list for messages: ".ply, .compressed.ply, …".
std::string known_endings();
/// Those of files that have y down by custom: ".ply, .compressed.ply and …".
std::string y_down_endings();

/// True for a scene in a format that has y down unless it states otherwise.
bool is_y_down(const std::filesystem::path& scene);

/// The path without the ending of its format: the folder of a sequence.
std::filesystem::path without_ending(const std::filesystem::path& path, const FormatTraits& traits);

} // namespace gsh::programs
