// SPDX-License-Identifier: Apache-2.0
/// @file  Checks JPEG images before they are decoded: damage, tables that a scan lacks, sizes that they cannot hold.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/image/image_bounds.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::detail {

/// Checks the structure of a JPEG, on which stb_image relies:
/// - it ends after its last scan, since a truncated image would be filled with grey, and has at most 100 scans, each of
///   which goes over all pixels;
/// - a Huffman table has at most 256 codes, and the tables that a scan names stand before it;
/// - scans begin every component, and have all marks at which decoding starts anew. Otherwise, pixels would be what
///   happened to be in memory.
///
/// Errors  IoError beginning with `name`.
/// Source  ITU-T T.81, annex B.
inline void check_jpeg(std::string_view bytes, const std::string& name);

/// Checks, once a JPEG's size in pixels is known, that it holds a bit for each block of 64 pixels, as it must.
/// Errors  IoError.
inline void check_jpeg_size(std::string_view bytes, const std::string& name, std::int64_t width, std::int64_t height);

// -------------------------------------------------------------------------------------------------------------

class JpegStructure {
public:
    JpegStructure(std::string_view bytes, const std::string& name) : bytes_(bytes), name_(name) {}

    void check() {
        std::size_t scans = 0;
        for (std::size_t at = 2;;) {
            std::size_t restarts = 0;
            at = next_marker(at, restarts);
            if (scans > 0 && restarts < restarts_) damaged("a part of a scan is missing");
            restarts_ = 0;
            const std::uint8_t marker = byte(at + 1);
            if (marker == end_of_image && scans > 0) break; // what follows, such as a film of a phone, is not of it
            if (marker == end_of_image || at + 3 >= bytes_.size()) truncated();
            const std::size_t length = number(at + 2);
            if (length < 2) damaged("a part has the length " + std::to_string(length));
            if (at + 2 + length > bytes_.size()) truncated();
            const Part part{at + 4, at + 2 + length};
            if (marker == quantization) read_quantization(part);
            if (marker == huffman) read_huffman(part);
            if (marker == restart_interval && length == 4) interval_ = number(part.begin);
            if (marker >= baseline && marker <= progressive) read_frame(part, marker == progressive);
            if (marker == scan) {
                if (++scans > 100) damaged("it has more than 100 scans, each over all pixels");
                read_scan(part);
            }
            at = part.end;
        }
        for (const Component& component : components_)
            if (!component.begun) damaged("it has no scan of component " + std::to_string(component.id));
    }

private:
    static constexpr std::uint8_t baseline = 0xC0, progressive = 0xC2, huffman = 0xC4, first_restart = 0xD0,
                                  last_restart = 0xD7, end_of_image = 0xD9, scan = 0xDA, quantization = 0xDB,
                                  restart_interval = 0xDD;

    /// A marker's bytes behind its length.
    struct Part {
        std::size_t begin, end;
    };
    struct Component {
        int id;
        std::size_t across, down; // blocks of 8 x 8 in a unit of interleaved components
        std::size_t quantization;
        bool begun = false;
    };

    std::string_view bytes_;
    const std::string& name_;
    std::array<bool, 4> quantization_{}, dc_{}, ac_{}; // tables that stood before
    std::vector<Component> components_;
    std::size_t width_ = 0, height_ = 0; // pixels
    std::size_t interval_ = 0;           // units between two marks at which decoding starts anew
    std::size_t restarts_ = 0;           // such marks that the scan before must have
    bool is_progressive_ = false;

    [[noreturn]] void truncated() const { throw IoError(name_ + ": the image is truncated"); }
    [[noreturn]] void damaged(const std::string& what) const {
        throw IoError(name_ + ": the image is damaged: " + what);
    }
    [[nodiscard]] std::uint8_t byte(std::size_t at) const { return static_cast<std::uint8_t>(bytes_[at]); }
    [[nodiscard]] std::size_t number(std::size_t at) const { return std::size_t(byte(at)) << 8 | byte(at + 1); }

    /// The place of the next marker. Within a scan, 0xFF 0x00 is a byte.
    std::size_t next_marker(std::size_t at, std::size_t& restarts) const {
        for (; at + 1 < bytes_.size(); ++at) {
            if (byte(at) != 0xFF) continue;
            const std::uint8_t next = byte(at + 1);
            if (next >= first_restart && next <= last_restart)
                ++restarts;
            else if (next != 0 && next != 0xFF)
                return at;
        }
        truncated();
    }

    void read_quantization(Part part) {
        while (part.begin < part.end) {
            const std::uint8_t head = byte(part.begin);
            const std::size_t size = head >> 4 ? 129 : 65;
            if (head >> 4 > 1 || (head & 15) > 3 || size > part.end - part.begin)
                damaged("its quantization tables are none");
            quantization_[head & 15] = true;
            part.begin += size;
        }
    }

    void read_huffman(Part part) {
        while (part.begin < part.end) {
            const std::uint8_t head = byte(part.begin);
            if (head >> 4 > 1 || (head & 15) > 3 || part.end - part.begin < 17) damaged("its Huffman tables are none");
            std::size_t codes = 0;
            for (std::size_t k = 1; k <= 16; ++k) codes += byte(part.begin + k);
            if (codes > 256) damaged("a Huffman table has " + std::to_string(codes) + " codes, expected at most 256");
            if (codes > part.end - part.begin - 17) damaged("its Huffman tables are none");
            (head >> 4 ? ac_ : dc_)[head & 15] = true;
            part.begin += 17 + codes;
        }
    }

    void read_frame(const Part& part, bool is_progressive) {
        if (!components_.empty()) damaged("it has two frames");
        if (part.end - part.begin < 6 || part.end - part.begin != 6 + 3 * std::size_t(byte(part.begin + 5)))
            damaged("its frame has another length than its components");
        height_ = number(part.begin + 1), width_ = number(part.begin + 3);
        for (std::size_t at = part.begin + 6; at < part.end; at += 3) {
            components_.push_back({byte(at), std::size_t(byte(at + 1) >> 4), std::size_t(byte(at + 1) & 15),
                                   std::size_t(byte(at + 2))});
            if (components_.back().across == 0 || components_.back().down == 0 || components_.back().quantization > 3)
                damaged("component " + std::to_string(byte(at)) + " has no size or table");
        }
        is_progressive_ = is_progressive;
    }

    void read_scan(const Part& part) {
        if (components_.empty()) damaged("a scan stands before the frame");
        const std::size_t size = part.end - part.begin, count = size > 0 ? byte(part.begin) : 0;
        if (count == 0 || size != 4 + 2 * count) damaged("a scan has another length than its components");
        // A progressive scan is one of the first coefficient of all blocks, or of others. It begins or refines them.
        const bool is_dc = byte(part.end - 3) == 0, begins = byte(part.end - 1) >> 4 == 0;
        auto component = components_.end();
        for (std::size_t at = part.begin + 1; at < part.end - 3; at += 2) {
            component = std::find_if(components_.begin(), components_.end(),
                                     [&](const Component& other) { return other.id == byte(at); });
            if (component == components_.end())
                damaged("a scan is of component " + std::to_string(byte(at)) + ", which the frame does not have");
            if (!quantization_[component->quantization])
                damaged("quantization table " + std::to_string(component->quantization) + " is missing");
            const std::size_t dc = byte(at + 1) >> 4, ac = byte(at + 1) & 15;
            const auto need = [&](const std::array<bool, 4>& tables, std::size_t table) {
                if (table > 3 || !tables[table])
                    damaged("a scan needs Huffman table " + std::to_string(table) + ", which is missing");
            };
            if (!is_progressive_ || (is_dc && begins)) need(dc_, dc);
            if (!is_progressive_ || !is_dc) need(ac_, ac);
            if (is_progressive_ && !(is_dc && begins) && !component->begun)
                damaged("a scan refines component " + std::to_string(component->id) + " before one begins it");
            component->begun = true;
        }
        if (interval_ > 0) restarts_ = (units_of(count == 1 ? &*component : nullptr) - 1) / interval_;
    }

    /// The number of units of a scan: blocks of its only component, or groups of blocks of several.
    [[nodiscard]] std::size_t units_of(const Component* only) const {
        std::size_t across = 1, down = 1;
        for (const Component& component : components_)
            across = std::max(across, component.across), down = std::max(down, component.down);
        const auto up = [](std::size_t a, std::size_t b) { return (a + b - 1) / b; };
        std::size_t columns = up(width_, 8 * across), rows = up(height_, 8 * down);
        if (only) columns = up(up(width_ * only->across, across), 8), rows = up(up(height_ * only->down, down), 8);
        return std::max<std::size_t>(columns * rows, 1);
    }
};

inline void check_jpeg(std::string_view bytes, const std::string& name) {
    JpegStructure(bytes, name).check();
}

inline void check_jpeg_size(std::string_view bytes, const std::string& name, std::int64_t width, std::int64_t height) {
    check_pixel_count(name, width, height);
    const auto blocks = static_cast<std::uint64_t>((width + 7) / 8 * ((height + 7) / 8));
    if (blocks / 8 > bytes.size())
        throw IoError(name + ": the image claims " + std::to_string(width) + " x " + std::to_string(height) +
                      " pixels, more than its " + std::to_string(bytes.size()) + " bytes can hold");
}

} // namespace gsh::detail
