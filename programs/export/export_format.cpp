// SPDX-License-Identifier: Apache-2.0
#include "export/export_format.hpp"

#include <string_view>

namespace gsh::programs {

namespace {

/// A longer ending stands before a shorter one that it ends with.
constexpr FormatTraits export_formats[] = {
    {.format = ExportFormat::compressed_ply, .ending = ".compressed.ply", .y_down = true, .is_sequence = true},
    {.format = ExportFormat::ply, .ending = ".ply", .y_down = true, .is_sequence = true},
    {.format = ExportFormat::spz, .ending = ".spz", .is_sequence = true},
    {.format = ExportFormat::splat, .ending = ".splat", .y_down = true, .is_sequence = true, .sh_degree = 0},
    {.format = ExportFormat::glb, .ending = ".glb"},
    {.format = ExportFormat::usda, .ending = ".usda"},
    {.format = ExportFormat::html, .ending = ".html", .sh_degree = 4},
    {.format = ExportFormat::gsh, .ending = ".gsh", .sh_degree = 4},
};

} // namespace

std::optional<FormatTraits> format_of(const std::filesystem::path& path) {
    const std::string name = path.filename().string();
    for (const FormatTraits& traits : export_formats)
        if (name.size() > std::string_view(traits.ending).size() && name.ends_with(traits.ending)) return traits;
    return std::nullopt;
}

std::string known_endings() {
    std::string list;
    for (const FormatTraits& traits : export_formats) list += (list.empty() ? "" : ", ") + std::string(traits.ending);
    return list;
}

std::filesystem::path without_ending(const std::filesystem::path& path, const FormatTraits& traits) {
    const std::string text = path.string();
    return text.substr(0, text.size() - std::string_view(traits.ending).size());
}

} // namespace gsh::programs
