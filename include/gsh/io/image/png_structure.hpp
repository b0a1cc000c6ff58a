// SPDX-License-Identifier: Apache-2.0
/// @file  The structure of a PNG, checked before it is decoded: damage, and sizes that it cannot hold.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/image/image_bounds.hpp>

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::detail {

/// Checks a PNG and returns the same image with its pixels unpacked: its deflate stream consists of stored blocks.
///
/// stb_image validates no checksum, and inflates a stream to its end, however far that is beyond the image's size.
/// Here exactly the bytes that the size asks for are inflated.
///
/// Errors  IoError for a truncated or damaged file, and for more pixels than 2^26 or than the file can hold.
[[nodiscard]] inline std::string unpacked_png(std::string_view bytes, const std::string& name);

// -------------------------------------------------------------------------------------------------------------

/// Four bytes of a PNG, most significant first.
inline std::uint32_t png_number(std::string_view bytes, std::size_t at) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(bytes[at + i]);
    return value;
}

/// Appends four bytes of a PNG, most significant first.
inline void append_png_number(std::string& out, std::size_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<char>(value >> shift & 255));
}

/// The header of a PNG.
struct PngHeader {
    std::uint32_t width = 0, height = 0;
    int bits = 0; ///< of a pixel
    bool interlaced = false;

    /// Bytes of all rows, each with its filter, as they are before compression.
    [[nodiscard]] std::size_t row_bytes() const {
        struct Pass {
            std::uint32_t x, y, dx, dy;
        };
        static constexpr std::array<Pass, 7> adam7{
            {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4}, {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}}};
        const auto rows = [&](std::size_t columns, std::size_t count) {
            return columns ? count * (1 + (columns * static_cast<std::size_t>(bits) + 7) / 8) : 0;
        };
        if (!interlaced) return rows(width, height);
        std::size_t sum = 0;
        for (const Pass& p : adam7)
            if (p.x < width && p.y < height)
                sum += rows((width - p.x + p.dx - 1) / p.dx, (height - p.y + p.dy - 1) / p.dy);
        return sum;
    }
};

/// Visits the chunks of a PNG as visit(type, data, whole chunk).
template <class Visit>
void visit_png_chunks(std::string_view bytes, const std::string& name, const Visit& visit) {
    for (std::size_t at = 8; at + 12 <= bytes.size();) {
        const std::size_t length = png_number(bytes, at);
        if (length > bytes.size() - at - 12) break;
        Crc32 crc;
        crc.add(bytes.data() + at + 4, length + 4);
        if (crc.value() != png_number(bytes, at + 8 + length))
            throw IoError(name + ": the image is damaged: a checksum does not fit");
        const std::string_view type = bytes.substr(at + 4, 4);
        if ((at == 8) != (type == "IHDR") || (at == 8 && length != 13))
            throw IoError(name + ": the image is damaged: it does not begin with its one header");
        visit(type, bytes.substr(at + 8, length), bytes.substr(at, length + 12));
        if (type == "IEND") return;
        at += length + 12;
    }
    throw IoError(name + ": the image is truncated");
}

inline PngHeader read_png_header(std::string_view data, const std::string& name) {
    PngHeader header;
    header.width = png_number(data, 0), header.height = png_number(data, 4);
    check_pixel_count(name, header.width, header.height);
    const int depth = static_cast<unsigned char>(data[8]), color = static_cast<unsigned char>(data[9]);
    constexpr std::array<int, 7> channels{1, 0, 3, 1, 2, 0, 4};
    const int count = color < 7 ? channels[static_cast<std::size_t>(color)] : 0;
    if (count == 0 || (depth != 1 && depth != 2 && depth != 4 && depth != 8 && depth != 16))
        throw IoError(name + ": the image is damaged: its header has depth " + std::to_string(depth) +
                      ", colour type " + std::to_string(color));
    header.bits = depth * count;
    header.interlaced = data[12] != 0;
    return header;
}

/// Inflates a zlib stream that lies in pieces, into exactly as many bytes as `out` has.
class PngInflater {
public:
    PngInflater(std::string& out, const std::string& name) : name_(name) {
        if (inflateInit(&stream_) != Z_OK) throw IoError(name_ + ": out of memory");
        stream_.next_out = reinterpret_cast<Bytef*>(out.data());
        stream_.avail_out = static_cast<uInt>(out.size()); // 2^26 pixels of 8 bytes at most
    }
    ~PngInflater() { inflateEnd(&stream_); }
    PngInflater(const PngInflater&) = delete;
    PngInflater& operator=(const PngInflater&) = delete;

    void add(std::string_view piece) {
        stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(piece.data()));
        stream_.avail_in = static_cast<uInt>(piece.size());
        while (stream_.avail_in > 0 && stream_.avail_out > 0 && !ended_) {
            const int code = inflate(&stream_, Z_NO_FLUSH);
            ended_ = code == Z_STREAM_END;
            if (code != Z_OK && !ended_ && stream_.avail_out > 0) // what follows the pixels does not matter
                throw IoError(name_ + ": the image is damaged: its pixels cannot be inflated");
        }
    }
    [[nodiscard]] bool is_full() const { return stream_.avail_out == 0; }

private:
    const std::string& name_;
    z_stream stream_{};
    bool ended_ = false;
};

inline std::string unpacked_png(std::string_view bytes, const std::string& name) {
    PngHeader header;
    std::vector<std::string_view> pieces;
    std::size_t packed = 0;
    std::string result(png_signature);
    visit_png_chunks(bytes, name, [&](std::string_view type, std::string_view data, std::string_view whole) {
        if (type == "IHDR") header = read_png_header(data, name);
        if (type == "IDAT")
            pieces.push_back(data), packed += data.size();
        else if (type == "IHDR" || type == "PLTE" || type == "tRNS")
            result += whole;
    });
    const std::size_t size = header.row_bytes();
    constexpr std::size_t most = 1032; // times that deflate can compress
    if (size / most > packed)
        throw IoError(name + ": the image claims " + std::to_string(header.width) + " x " +
                      std::to_string(header.height) + " pixels, more than its " + std::to_string(packed) +
                      " bytes can hold");
    std::string rows(size, '\0');
    PngInflater inflater(rows, name);
    for (const std::string_view piece : pieces) inflater.add(piece);
    if (!inflater.is_full()) throw IoError(name + ": the image is truncated: it has too few pixels");

    constexpr std::size_t block = 65535;
    const auto number = [&](std::size_t value) { append_png_number(result, value); };
    const std::size_t blocks = (size + block - 1) / block;
    result.reserve(result.size() + size + 5 * blocks + 32);
    number(2 + size + 5 * blocks + 4);
    result += "IDAT\x78\x01";
    for (std::size_t at = 0; at < size; at += block) {
        const std::size_t count = std::min(block, size - at);
        result.push_back(at + count == size ? 1 : 0);
        for (const std::size_t value : {count, ~count})
            result.push_back(static_cast<char>(value & 255)), result.push_back(static_cast<char>(value >> 8 & 255));
        result.append(rows, at, count);
    }
    number(0), number(0); // the checksums of stream and chunk, which stb_image does not compare
    number(0);
    result += "IEND";
    number(0);
    return result;
}

} // namespace gsh::detail
