// SPDX-License-Identifier: Apache-2.0
/// @file  Images whose Exif data state an orientation.
#pragma once

#include <gsh/io/file/crc32.hpp>
#include <gsh/io/image/image_file.hpp>

#include <stb/stb_image_write.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

namespace gsh::test {

/// A number of `size` bytes.
inline std::string stored_number(std::uint32_t value, std::size_t size, bool little) {
    std::string bytes;
    for (std::size_t i = 0; i < size; ++i)
        bytes.push_back(static_cast<char>(value >> 8 * (little ? i : size - 1 - i) & 255));
    return bytes;
}

/// A TIFF structure with two tags, of which the second is the orientation.
inline std::string orientation_tiff(int orientation, bool little = false) {
    const auto number = [&](std::uint32_t value, std::size_t size) { return stored_number(value, size, little); };
    std::string text = (little ? "II" : "MM") + number(42, 2) + number(8, 4) + number(2, 2);
    text += number(0x010F, 2) + number(2, 2) + number(4, 4) + "gsh" + std::string(1, '\0'); // the maker
    text += number(0x0112, 2) + number(3, 2) + number(1, 4) + number(static_cast<std::uint32_t>(orientation), 2) +
            number(0, 2);
    return text + number(0, 4);
}

/// A JPEG or PNG file with Exif data behind its beginning.
inline std::string with_exif(std::string_view file, std::string_view tiff) {
    const std::string text(tiff);
    if (file.starts_with("\xFF\xD8")) {
        const std::string segment = std::string("Exif\0\0", 6) + text;
        return "\xFF\xD8\xFF\xE1" + stored_number(static_cast<std::uint32_t>(segment.size() + 2), 2, false) + segment +
               std::string(file.substr(2));
    }
    constexpr std::size_t header = 8 + 25; // signature, IHDR
    const std::string chunk = "eXIf" + text;
    Crc32 crc;
    crc.add(chunk.data(), chunk.size());
    return std::string(file.substr(0, header)) + stored_number(static_cast<std::uint32_t>(text.size()), 4, false) +
           chunk + stored_number(crc.value(), 4, false) + std::string(file.substr(header));
}

inline std::string jpeg_bytes(const PixelImage& image, int quality = 95) {
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    stbi_write_jpg_to_func(append, &bytes, image.width, image.height, image.channels, image.data.data(), quality);
    return bytes;
}

/// How a picture is stored so that an orientation shows it upright: Exif says on which side of the visible picture the
/// first row and the first column lie.
inline PixelImage stored_lying(const PixelImage& visible, int orientation) {
    const bool on_its_side = orientation >= 5;
    PixelImage stored(visible.channels, on_its_side ? visible.width : visible.height,
                      on_its_side ? visible.height : visible.width);
    const char first_row = " TTBBLRRL"[orientation], first_column = " LRRLTTBB"[orientation];
    for (int row = 0; row < stored.height; ++row)
        for (int column = 0; column < stored.width; ++column) {
            int x = 0, y = 0;
            for (const auto& [side, distance] : {std::pair(first_row, row), std::pair(first_column, column)}) {
                if (side == 'T') y = distance;
                if (side == 'B') y = visible.height - 1 - distance;
                if (side == 'L') x = distance;
                if (side == 'R') x = visible.width - 1 - distance;
            }
            std::copy_n(visible.pixel(y, x), visible.channels, stored.pixel(row, column));
        }
    return stored;
}

} // namespace gsh::test
