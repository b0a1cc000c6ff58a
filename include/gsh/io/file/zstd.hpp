// SPDX-License-Identifier: Apache-2.0
/// @file  Zstandard frames in memory.
#pragma once

#include <gsh/core/error.hpp>

#include <zstd.h>

#include <cstddef>
#include <string>
#include <string_view>

namespace gsh {

[[nodiscard]] inline std::string zstd_compressed(std::string_view bytes, int level = 12) {
    std::string out(ZSTD_compressBound(bytes.size()), '\0');
    const std::size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), level);
    if (ZSTD_isError(size)) throw IoError(std::string("zstd: ") + ZSTD_getErrorName(size));
    out.resize(size);
    return out;
}

/// The contents of a frame that must hold exactly `size` bytes. Only as many are allocated, whatever the frame claims.
///
/// Errors  IoError, which begins with `what`, for a damaged frame or another size.
[[nodiscard]] inline std::string zstd_decompressed(std::string_view frame, std::size_t size, const std::string& what) {
    std::string out(size, '\0');
    const std::size_t found = ZSTD_decompress(out.data(), out.size(), frame.data(), frame.size());
    if (ZSTD_isError(found)) throw IoError(what + ": is damaged: " + ZSTD_getErrorName(found));
    if (found != size)
        throw IoError(what + ": holds " + std::to_string(found) + " bytes, expected " + std::to_string(size));
    return out;
}

} // namespace gsh
