// SPDX-License-Identifier: Apache-2.0
/// @file  Names the formats of images that are not read, with the way to convert them.
#pragma once

#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace gsh::detail {

/// The name of a format of images (or what else is often found in their place) by a file's first bytes; empty if it is
/// not known.
inline std::string_view image_format(std::string_view bytes) {
    const auto at = [&](std::size_t place, std::string_view text) {
        return bytes.size() >= place && bytes.substr(place).starts_with(text);
    };
    if (at(0, "RIFF") && at(8, "WEBP")) return "a WebP image";
    if (at(4, "ftyp")) {
        const std::string_view brand = bytes.substr(8, 4);
        if (brand == "avif" || brand == "avis") return "an AVIF image";
        constexpr std::array<std::string_view, 8> heif{"heic", "heix", "heim", "heis", "hevc", "hevx", "mif1", "msf1"};
        return std::find(heif.begin(), heif.end(), brand) != heif.end() ? "a HEIC image" : "a video";
    }
    constexpr std::array<std::array<std::string_view, 2>, 13> known{{{"II*", "a TIFF image (or a camera's raw image)"},
                                                                     {"BM", "a BMP image"},
                                                                     {"GIF8", "a GIF image"},
                                                                     {"\xFF\x0A", "a JPEG XL image"},
                                                                     {"v/1\x01", "an OpenEXR image"},
                                                                     {"8BPS", "a Photoshop image"},
                                                                     {"P5", "a PGM image"},
                                                                     {"P6", "a PPM image"},
                                                                     {"#?RADIANCE", "a Radiance HDR image"},
                                                                     {"\x93NUMPY", "a NumPy array"},
                                                                     {"version https://git-lfs", "a Git LFS pointer"},
                                                                     {"<!DOCTYPE", "a web page"},
                                                                     {"<html", "a web page"}}};
    for (const auto& [begin, name] : known)
        if (at(0, begin)) return name;
    if (at(0, std::string_view("MM\0*", 4))) return known[0][1];
    if (at(4, "JXL ")) return "a JPEG XL image";
    if (at(4, "jP  ")) return "a JPEG 2000 image";
    return {};
}

/// "is a WebP image, expected …; convert it": the message about a file that is not in an expected format.
inline std::string not_an_image(std::string_view bytes, std::string_view expected) {
    const std::string_view format = image_format(bytes);
    if (format.empty()) return "is not " + std::string(expected);
    std::string text = "is " + std::string(format) + ", expected " + std::string(expected);
    if (format.ends_with("pointer")) return text + "; fetch the file itself with git lfs pull";
    if (format.ends_with("video")) return text + "; extract its frames, for instance with ffmpeg -i VIDEO %04d.png";
    return format.find("image") == std::string_view::npos
               ? text
               : text + "; convert it to PNG, for instance with ImageMagick: mogrify -format png FILES";
}

/// Whether a file's name ends as those of images do that are not read.
inline bool is_foreign_image(const std::filesystem::path& path) {
    constexpr std::array<std::string_view, 16> endings{".webp", ".heic", ".heif", ".avif", ".tif", ".tiff",
                                                       ".bmp",  ".gif",  ".jxl",  ".jp2",  ".exr", ".tga",
                                                       ".dng",  ".cr2",  ".nef",  ".arw"};
    const std::string ending = path.extension().string();
    return std::any_of(endings.begin(), endings.end(), [&](std::string_view one) { return is_word(ending, one); });
}

} // namespace gsh::detail
