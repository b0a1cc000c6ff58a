// SPDX-License-Identifier: Apache-2.0
/// @file  How many pixels an image may claim, and the bytes that PNG and JPEG files begin with.
#pragma once

#include <gsh/core/error.hpp>

#include <cstdint>
#include <string>
#include <string_view>

namespace gsh::detail {

inline constexpr std::string_view png_signature = "\x89PNG\r\n\x1a\n", jpeg_signature = "\xFF\xD8\xFF";

/// Throws IoError unless an image has at least one pixel and at most 2^26.
inline void check_pixel_count(const std::string& name, std::int64_t width, std::int64_t height) {
    constexpr std::int64_t most = std::int64_t(1) << 26;
    if (width <= 0 || height <= 0 || width > most || height > most || width * height > most)
        throw IoError(name + ": the image claims " + std::to_string(width) + " x " + std::to_string(height) +
                      " pixels, expected at most " + std::to_string(most) + " in all");
}

} // namespace gsh::detail
