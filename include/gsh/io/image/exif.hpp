// SPDX-License-Identifier: Apache-2.0
/// @file  The orientation that a JPEG or PNG file states in its Exif data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace gsh::detail {

/// The orientation tag of a JPEG or PNG file, 1 to 8: how the stored picture is to be turned for display. 1 (as stored)
/// if the file states none, or if its Exif data are damaged. Nothing else of Exif is read.
/// Source  Exif 2.32: JPEG's segment APP1, and TIFF 6.0's first directory with tag 0x0112; PNG's chunk eXIf.
[[nodiscard]] inline int exif_orientation(std::string_view file);

// -------------------------------------------------------------------------------------------------------------

/// A TIFF structure in memory; numbers beyond its end are 0.
class TiffBytes {
public:
    explicit TiffBytes(std::string_view bytes) : bytes_(bytes), little_(bytes.starts_with("II")) {}

    [[nodiscard]] std::uint32_t number(std::size_t at, std::size_t size) const {
        if (at > bytes_.size() || size > bytes_.size() - at) return 0;
        std::uint32_t value = 0;
        for (std::size_t i = 0; i < size; ++i)
            value = value << 8 | static_cast<unsigned char>(bytes_[at + (little_ ? size - 1 - i : i)]);
        return value;
    }
    /// A tag of one small integer in the first directory; 0 if it is missing.
    [[nodiscard]] std::uint32_t tag(std::uint32_t wanted) const {
        if (!(little_ || bytes_.starts_with("MM")) || number(2, 2) != 42) return 0;
        const std::size_t directory = number(4, 4), count = number(directory, 2);
        for (std::size_t i = 0; i < count; ++i) {
            const std::size_t entry = directory + 2 + 12 * i; // tag, type, count, value
            if (entry + 12 > bytes_.size()) break;
            if (number(entry, 2) != wanted || number(entry + 4, 4) != 1) continue;
            const std::uint32_t type = number(entry + 2, 2);
            return type == 3 ? number(entry + 8, 2) : type == 4 ? number(entry + 8, 4) : 0; // SHORT, LONG
        }
        return 0;
    }

private:
    std::string_view bytes_;
    bool little_;
};

/// The TIFF structure of a file's Exif data; empty if there is none.
inline std::string_view exif_of(std::string_view file) {
    constexpr std::string_view lead("Exif\0\0", 6);
    const auto big_endian = [&](std::size_t at, std::size_t size) {
        std::size_t value = 0;
        for (std::size_t i = 0; i < size; ++i) value = value << 8 | static_cast<unsigned char>(file[at + i]);
        return value;
    };
    if (file.starts_with("\xFF\xD8")) { // segments FF, kind, length with its own two bytes
        for (std::size_t at = 2; at + 4 <= file.size() && file[at] == '\xFF';) {
            const auto kind = static_cast<unsigned char>(file[at + 1]);
            if (kind == 0xFF) { // a filling byte
                ++at;
                continue;
            }
            const std::size_t length = big_endian(at + 2, 2);
            if (kind == 0xDA || kind == 0xD9 || length < 2 || length > file.size() - at - 2) break; // pixels begin
            const std::string_view segment = file.substr(at + 4, length - 2);
            if (kind == 0xE1 && segment.starts_with(lead)) return segment.substr(lead.size());
            at += 2 + length;
        }
    } else if (file.starts_with("\x89PNG\r\n\x1a\n")) { // chunks length, kind, contents, checksum
        for (std::size_t at = 8; at + 12 <= file.size();) {
            const std::size_t length = big_endian(at, 4);
            if (length > file.size() - at - 12) break;
            const std::string_view kind = file.substr(at + 4, 4), chunk = file.substr(at + 8, length);
            if (kind == "eXIf") return chunk.starts_with(lead) ? chunk.substr(lead.size()) : chunk;
            if (kind == "IEND") break;
            at += 12 + length;
        }
    }
    return {};
}

inline int exif_orientation(std::string_view file) {
    const std::uint32_t found = TiffBytes(exif_of(file)).tag(0x0112);
    return found >= 1 && found <= 8 ? static_cast<int>(found) : 1;
}

} // namespace gsh::detail
