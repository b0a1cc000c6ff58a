// SPDX-License-Identifier: Apache-2.0
/// @file  Endings of the names of images in formats that are not read.
#pragma once

#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string>
#include <string_view>

namespace gsh::detail {

/// Whether a file's name ends as those of images do that are not read.
inline bool is_foreign_image(const std::filesystem::path& path) {
    constexpr std::array<std::string_view, 16> endings{".webp", ".heic", ".heif", ".avif", ".tif", ".tiff",
                                                       ".bmp",  ".gif",  ".jxl",  ".jp2",  ".exr", ".tga",
                                                       ".dng",  ".cr2",  ".nef",  ".arw"};
    const std::string ending = path.extension().string();
    return std::any_of(endings.begin(), endings.end(), [&](std::string_view one) { return is_word(ending, one); });
}

} // namespace gsh::detail
