// SPDX-License-Identifier: Apache-2.0
/// @file  Text between UTF-8 and UTF-32, in which NumPy stores it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh::detail {

/// Text as one unicode scalar ('<U5'), so that str(array) returns it in Python.
inline std::string utf8_to_utf32(std::string_view text) {
    std::string result;
    for (std::size_t i = 0; i < text.size();) {
        const auto lead = static_cast<unsigned char>(text[i]);
        const std::size_t length = lead < 0x80 ? 1 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;
        std::uint32_t code = length == 1 ? lead : lead & (0x7Fu >> length);
        for (std::size_t k = 1; k < length && i + k < text.size(); ++k)
            code = code << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3Fu);
        for (int shift = 0; shift < 32; shift += 8) result.push_back(static_cast<char>(code >> shift & 255));
        i += length;
    }
    return result;
}

inline std::string utf32_to_utf8(const std::uint32_t* codes, std::size_t count) {
    std::string text;
    for (std::size_t i = 0; i < count && codes[i] != 0; ++i) {
        const std::uint32_t c = codes[i];
        const auto put = [&](std::uint32_t byte) { text.push_back(static_cast<char>(byte)); };
        if (c < 0x80) put(c);
        else if (c < 0x800) put(0xC0 | c >> 6), put(0x80 | (c & 63));
        else if (c < 0x10000) put(0xE0 | c >> 12), put(0x80 | (c >> 6 & 63)), put(0x80 | (c & 63));
        else put(0xF0 | (c >> 18 & 7)), put(0x80 | (c >> 12 & 63)), put(0x80 | (c >> 6 & 63)), put(0x80 | (c & 63));
    }
    return text;
}

} // namespace gsh::detail
