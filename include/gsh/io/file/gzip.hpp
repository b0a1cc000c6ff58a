// SPDX-License-Identifier: Apache-2.0
/// @file  gzip, zlib and raw deflate streams in memory: compresses, and inflates no more than is asked for.
#pragma once

#include <gsh/core/error.hpp>

#include <zlib.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

namespace gsh {

/// Inflates a gzip stream piece by piece.
///
/// Errors  IoError, which begins with `what`, for a stream that is damaged or too short.
class GzipReader {
public:
    /// `bytes` must outlive this object.
    GzipReader(std::string_view bytes, std::string what) : what_(std::move(what)), rest_(bytes) {
        if (inflateInit2(&stream_, 15 + 16) != Z_OK) throw IoError(what_ + ": out of memory");
    }
    ~GzipReader() { inflateEnd(&stream_); }
    GzipReader(const GzipReader&) = delete;
    GzipReader& operator=(const GzipReader&) = delete;

    /// Writes exactly `size` bytes to `data`.
    void read(void* data, std::size_t size) {
        auto* out = static_cast<unsigned char*>(data);
        while (size > 0) {
            constexpr std::size_t most = std::numeric_limits<uInt>::max();
            const std::size_t in_size = std::min(rest_.size(), most), out_size = std::min(size, most);
            stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(rest_.data()));
            stream_.avail_in = static_cast<uInt>(in_size);
            stream_.next_out = out;
            stream_.avail_out = static_cast<uInt>(out_size);
            const int code = inflate(&stream_, Z_NO_FLUSH);
            rest_.remove_prefix(in_size - stream_.avail_in);
            const std::size_t written = out_size - stream_.avail_out;
            out += written, size -= written;
            if (size == 0) return;
            if (code == Z_STREAM_END || (code == Z_BUF_ERROR && rest_.empty()))
                throw IoError(what_ + ": is truncated: " + std::to_string(size) + " bytes are missing");
            if (code != Z_OK) throw IoError(what_ + ": is damaged: the compressed data cannot be read");
        }
    }

    /// Inflates the rest of the stream, keeps its first `kept` bytes, and checks the checksum at its end.
    /// Errors  IoError for another checksum, a stream without its end, or more than `most` bytes of rest.
    std::string finish(std::size_t most = std::size_t(1) << 28, std::size_t kept = 0) {
        char scratch[1 << 14];
        std::string rest;
        for (std::size_t total = 0;;) {
            const std::size_t in_size = std::min<std::size_t>(rest_.size(), std::numeric_limits<uInt>::max());
            stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(rest_.data()));
            stream_.avail_in = static_cast<uInt>(in_size);
            stream_.next_out = reinterpret_cast<Bytef*>(scratch);
            stream_.avail_out = sizeof scratch;
            const int code = inflate(&stream_, Z_NO_FLUSH);
            rest_.remove_prefix(in_size - stream_.avail_in);
            const std::size_t written = sizeof scratch - stream_.avail_out;
            rest.append(scratch, std::min(written, kept - rest.size()));
            if ((total += written) > most)
                throw IoError(what_ + ": goes on for more than " + std::to_string(most) + " bytes");
            if (code == Z_STREAM_END) return rest;
            if (code == Z_BUF_ERROR && rest_.empty()) throw IoError(what_ + ": is truncated: its checksum is missing");
            if (code != Z_OK) throw IoError(what_ + ": is damaged: the rest cannot be read, or its checksum differs");
        }
    }

private:
    std::string what_;
    std::string_view rest_;
    z_stream stream_{};
};

namespace detail {

/// window_bits 15 + 16 for gzip, 15 for zlib, -15 for deflate without a header.
inline std::string compressed_by_zlib(std::string_view bytes, int level, int window_bits) {
    z_stream stream{};
    if (deflateInit2(&stream, level, Z_DEFLATED, window_bits, 9, Z_DEFAULT_STRATEGY) != Z_OK)
        throw IoError("zlib: out of memory");
    const auto end = [](z_stream* open) { deflateEnd(open); };
    const std::unique_ptr<z_stream, decltype(end)> opened(&stream, end); // also where there is no memory for `out`
    std::string out;
    char block[1 << 16];
    int code = Z_OK;
    do {
        constexpr std::size_t most = std::numeric_limits<uInt>::max();
        const std::size_t in_size = std::min(bytes.size(), most);
        stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
        stream.avail_in = static_cast<uInt>(in_size);
        stream.next_out = reinterpret_cast<Bytef*>(block);
        stream.avail_out = sizeof block;
        code = deflate(&stream, in_size == bytes.size() ? Z_FINISH : Z_NO_FLUSH);
        bytes.remove_prefix(in_size - stream.avail_in);
        out.append(block, sizeof block - stream.avail_out);
    } while (code == Z_OK || code == Z_BUF_ERROR);
    return out;
}

} // namespace detail

/// A gzip stream. The same bytes give the same stream: it has no time and no name.
[[nodiscard]] inline std::string gzip(std::string_view bytes, int level = 9) {
    return detail::compressed_by_zlib(bytes, level, 15 + 16);
}

/// A zlib stream, as PNG images have it.
[[nodiscard]] inline std::string zlib_stream(std::string_view bytes, int level = 9) {
    return detail::compressed_by_zlib(bytes, level, 15);
}

/// A deflate stream without header and checksum, as members of zip archives have it.
[[nodiscard]] inline std::string deflated(std::string_view bytes, int level = 9) {
    return detail::compressed_by_zlib(bytes, level, -15);
}

} // namespace gsh
