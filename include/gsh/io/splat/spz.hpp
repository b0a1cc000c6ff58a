// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes SPZ files, a compact format for 3D Gaussians: versions 1 to 4, written as 3 or 4.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/zstd.hpp>
#include <gsh/io/splat/spz_extensions.hpp>
#include <gsh/io/splat/spz_points.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/sh.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>

namespace gsh {

/// How an SPZ file is written.
struct SpzOptions {
    int version = 3;         ///< 3 (one gzip stream), which more programs read, or 4 (streams of Zstandard)
    PixelFilter filter = {}; ///< a file states only whether opacity is compensated
};

/// Reads an SPZ file. The format has y up, as gsh has, unless an extension states another coordinate system, from which
/// the Gaussians are then turned. Extensions that may change them and are not known are warnings.
///
/// What the Gaussians take, inflated and in memory, is checked against the size of the file before anything is
/// allocated: 64 MiB, or 200 times the file (io/file/claimed_size.hpp).
///
/// Errors  IoError for a file that is missing, truncated, damaged, of another version, or whose counts disagree;
///         ValueError for positions that are not finite, which version 1 can hold.
/// Source  Niantic's library "spz", its load-spz.cc and splat-types.h.
[[nodiscard]] inline StillSplats read_spz(const InputFile& input);

/// Writes an SPZ file in its own frame, RUB, atomically. Returns how many numbers do not fit and end at what the format
/// holds. Positions have spz_fractional_bits, or fewer where a large scene loses less by that.
///
/// Errors  ValueError for another version, no Gaussian, or SH above degree 3.
inline SplatLosses write_spz(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                             const SpzOptions& options = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::uint32_t spz_magic = 0x5053474e;

struct SpzHeader {
    std::uint32_t magic = spz_magic, version = 0, count = 0;
    std::uint8_t sh_degree = 0, fractional_bits = spz_fractional_bits, flags = 0, stream_count = 0;
};
static_assert(sizeof(SpzHeader) == 16);

inline void check_spz(const SpzHeader& header, const std::string& name, std::uint64_t file_size) {
    const auto fail = [&](const std::string& reason) { throw IoError(name + ": " + reason); };
    if (header.magic != spz_magic) fail("is not an SPZ file");
    if (header.version < 1 || header.version > 4)
        fail("has SPZ version " + std::to_string(header.version) + ", expected 1 to 4");
    if (header.sh_degree > 4) fail("has SH of degree " + std::to_string(header.sh_degree) + ", expected 0 to 4");
    if (header.fractional_bits > 24) fail("has " + std::to_string(header.fractional_bits) + " fractional bits of 24");
    if (header.count == 0) fail("holds no Gaussians");
    std::uint64_t row = sizeof(float) * static_cast<std::uint64_t>(11 + 3 * sh_basis_count(header.sh_degree));
    for (const std::size_t width : SpzStreams::widths(static_cast<int>(header.version), header.sh_degree)) row += width;
    if (!may_take(header.count * row, file_size)) // row: of a Gaussian, in its streams and in memory
        fail("claims " + std::to_string(header.count) + " Gaussians of degree " + std::to_string(header.sh_degree) +
             " in " + std::to_string(file_size) + " bytes; it is damaged or made to exhaust memory");
}

/// Versions 1 to 3: everything in one gzip stream.
inline SpzStreams read_spz_gzip(std::string_view bytes, const std::string& name, SpzHeader& header,
                                std::string& extensions) {
    GzipReader reader(bytes, name);
    reader.read(&header, sizeof header);
    check_spz(header, name, bytes.size());
    if (header.version > 3) throw IoError(name + ": has SPZ version 4 within gzip, expected 1 to 3");
    SpzStreams streams;
    const auto widths = SpzStreams::widths(static_cast<int>(header.version), header.sh_degree);
    for (std::size_t k = 0; k < SpzStreams::count; ++k) {
        streams.bytes[k].resize(header.count * widths[k]);
        reader.read(streams.bytes[k].data(), streams.bytes[k].size());
    }
    extensions = reader.finish(std::size_t(1) << 28, std::size_t(1) << 20); // they follow the streams
    return streams;
}

/// Version 4: a plain header, a table, and a frame of Zstandard for each stream that is not empty.
inline SpzStreams read_spz_zstd(std::string_view bytes, const std::string& name, SpzHeader& header,
                                std::string& extensions) {
    const auto fail = [&](const std::string& reason) { throw IoError(name + ": " + reason); };
    if (bytes.size() < 32) fail("is truncated: " + std::to_string(bytes.size()) + " bytes, expected a header of 32");
    std::memcpy(&header, bytes.data(), sizeof header);
    check_spz(header, name, bytes.size());
    if (header.version != 4) fail("has SPZ version " + std::to_string(header.version) + " outside of gzip, expected 4");
    std::uint32_t table = 0;
    std::memcpy(&table, bytes.data() + 16, 4);
    const auto widths = SpzStreams::widths(4, header.sh_degree);
    const std::size_t streams_expected = SpzStreams::count - (widths[5] == 0);
    if (header.stream_count != streams_expected)
        fail("has " + std::to_string(header.stream_count) + " streams, expected " + std::to_string(streams_expected));
    if (table < 32 || table > bytes.size() || bytes.size() - table < 16 * streams_expected)
        fail("is truncated: the table of streams begins at byte " + std::to_string(table) + " of " +
             std::to_string(bytes.size()));
    extensions = bytes.substr(32, table - 32);
    std::uint64_t begin = table + 16 * streams_expected;
    std::array<std::string_view, SpzStreams::count> frames;
    for (std::size_t k = 0; k < streams_expected; ++k) {
        std::uint64_t sizes[2];
        std::memcpy(sizes, bytes.data() + table + 16 * k, sizeof sizes);
        if (sizes[0] > bytes.size() - begin) fail("is truncated in stream " + std::to_string(k));
        if (sizes[1] != header.count * widths[k])
            fail("stream " + std::to_string(k) + " claims " + std::to_string(sizes[1]) + " bytes, expected " +
                 std::to_string(header.count * widths[k]));
        frames[k] = bytes.substr(begin, sizes[0]);
        begin += sizes[0];
    }
    if (begin != bytes.size()) fail("has " + std::to_string(bytes.size() - begin) + " bytes after the last stream");
    SpzStreams streams;
    for (std::size_t k = 0; k < streams_expected; ++k)
        streams.bytes[k] =
            zstd_decompressed(frames[k], header.count * widths[k], name + ": stream " + std::to_string(k));
    return streams;
}

} // namespace detail

inline StillSplats read_spz(const InputFile& input) {
    const std::string name = input.name(), bytes = read_file(input, std::size_t(4) << 30);
    detail::SpzHeader header;
    std::string extensions;
    const SpzStreams streams = bytes.starts_with("\x1f\x8b") ? detail::read_spz_gzip(bytes, name, header, extensions)
                                                             : detail::read_spz_zstd(bytes, name, header, extensions);
    StillSplats splats{gaussians_of_spz(streams, header.count, static_cast<int>(header.version), header.sh_degree,
                                        header.fractional_bits)};
    for (std::size_t i = 0; i < splats.cloud.size(); ++i)
        for (int axis = 0; axis < 3; ++axis)
            check_value(std::isfinite(splats.cloud.means[i][axis]), name,
                        "position " + std::to_string(i) + " is not finite");
    const SpzStatements stated = spz_statements(header.flags & 2 ? extensions : std::string(), name);
    turn_axes(splats.cloud, *axes_of_letters(stated.axes));
    splats.notes.up = stated.up, splats.warnings = stated.warnings;
    if (header.flags & 1) splats.notes.filter = PixelFilter{.dilation = 0.3, .compensate_opacity = true};
    return splats;
}

inline SplatLosses write_spz(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                             const SpzOptions& options) {
    check_writable("write_spz", cloud);
    check_value(options.version == 3 || options.version == 4, "write_spz", "the version must be 3 or 4");
    check_value(cloud.sh_degree <= 3, "write_spz", "SPZ holds SH up to degree 3; use with_bands_up_to");
    check_value(cloud.size() > 0 && cloud.size() <= 0xFFFFFFFFu, "write_spz", "there must be a Gaussian");
    const int bits = spz_bits_for(cloud);
    SplatLosses losses;
    const SpzStreams streams = spz_streams(cloud, bits, losses);
    const std::size_t count = SpzStreams::count - (cloud.sh_degree == 0);
    const detail::SpzHeader header{.version = static_cast<std::uint32_t>(options.version),
                                   .count = static_cast<std::uint32_t>(cloud.size()),
                                   .sh_degree = static_cast<std::uint8_t>(cloud.sh_degree),
                                   .fractional_bits = static_cast<std::uint8_t>(bits),
                                   .flags = static_cast<std::uint8_t>(options.filter.compensate_opacity),
                                   .stream_count = static_cast<std::uint8_t>(options.version == 4 ? count : 0)};
    std::string bytes(reinterpret_cast<const char*>(&header), sizeof header);
    AtomicFile file(path);
    if (options.version == 3) {
        for (const std::string& stream : streams.bytes) bytes += stream;
        file.write(gzip(bytes));
    } else {
        const std::uint32_t rest[4] = {32, 0, 0, 0}; // where the table begins, and zeros
        bytes.append(reinterpret_cast<const char*>(rest), sizeof rest);
        std::string frames;
        for (std::size_t k = 0; k < count; ++k) {
            const std::string frame = zstd_compressed(streams.bytes[k]);
            const std::uint64_t sizes[2] = {frame.size(), streams.bytes[k].size()};
            bytes.append(reinterpret_cast<const char*>(sizes), sizeof sizes);
            frames += frame;
        }
        file.write(bytes);
        file.write(frames);
    }
    file.commit();
    return losses;
}

} // namespace gsh
