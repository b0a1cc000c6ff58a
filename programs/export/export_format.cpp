// SPDX-License-Identifier: Apache-2.0
#include "export/export_format.hpp"

#include <gsh/io/splat/any_splats.hpp>
#include <gsh/io/splat/splat_formats.hpp>

#include <algorithm>
#include <vector>

namespace gsh::programs {

namespace {

/// The library's formats, then those of gsh-export. A longer ending stands before a shorter one that it ends with.
const std::vector<FormatTraits>& export_formats() {
    static const std::vector<FormatTraits> formats = [] {
        std::vector<FormatTraits> list;
        for (const SplatFormatTraits& row : splat_formats) {
            if (!row.write) continue;
            const auto shorter =
                std::ranges::find_if(list, [&](const FormatTraits& f) { return row.ending.ends_with(f.ending); });
            list.insert(shorter, {.ending = row.ending, .splats = &row});
        }
        list.push_back({.ending = ".html", .kind = ExportKind::page});
        list.push_back({.ending = ".gsh", .kind = ExportKind::avatar});
        return list;
    }();
    return formats;
}

} // namespace

bool FormatTraits::is(SplatFormat format) const {
    return splats && splats->format == format;
}

bool FormatTraits::is_y_down() const {
    return splats && splats->is_y_down;
}

std::optional<FormatTraits> format_of(const std::filesystem::path& path) {
    const std::string name = path.filename().string();
    for (const FormatTraits& traits : export_formats())
        if (name.size() > traits.ending.size() && name.ends_with(traits.ending)) return traits;
    return std::nullopt;
}

std::string known_endings() {
    std::string list;
    for (const FormatTraits& traits : export_formats()) list += (list.empty() ? "" : ", ") + std::string(traits.ending);
    return list;
}

std::string y_down_endings() {
    return splat_endings(SplatEndings::y_down, " and ");
}

bool is_y_down(const std::filesystem::path& scene) {
    return is_y_down_by_custom(recognise_splats(scene));
}

std::filesystem::path without_ending(const std::filesystem::path& path, const FormatTraits& traits) {
    const std::string text = path.string();
    return text.substr(0, text.size() - traits.ending.size());
}

} // namespace gsh::programs
