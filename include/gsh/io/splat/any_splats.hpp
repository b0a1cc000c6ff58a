// SPDX-License-Identifier: Apache-2.0
/// @file  Loads still Gaussians in any supported format, detected from a file's first bytes and its name.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/splat/compressed_ply.hpp>
#include <gsh/io/splat/gltf_splats.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/splat_file.hpp>
#include <gsh/io/splat/spz.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>

namespace gsh {

/// Formats of still Gaussians that are read.
enum class SplatFormat { ply, compressed_ply, spz, splat, glb }; ///< glb: also .gltf

/// The format of a file: from its first bytes. A .splat file, which has no header and may begin with any bytes, and a
/// damaged file are recognised by their names.
///
/// Errors  IoError for a file that cannot be opened or whose format is not known.
[[nodiscard]] inline SplatFormat recognise_splats(const std::filesystem::path& path) {
    std::error_code ignored;
    if (std::filesystem::is_directory(path, ignored))
        throw IoError(path.string() + ": is a directory, expected a file of Gaussians");
    const auto close = [](std::FILE* file) { std::fclose(file); };
    const std::unique_ptr<std::FILE, decltype(close)> file(std::fopen(path.c_str(), "rbe"), close);
    if (!file) throw IoError(path.string() + ": cannot be opened: " + std::generic_category().message(errno));
    const std::filesystem::path ending = path.extension();
    if (ending == ".splat") return SplatFormat::splat;
    char bytes[4] = {};
    const std::string_view begin(bytes, std::fread(bytes, 1, sizeof bytes, file.get()));
    if (begin.starts_with("ply"))
        return PlyFile(path).vertices().find("packed_position") ? SplatFormat::compressed_ply : SplatFormat::ply;
    if (begin == "NGSP" || begin.starts_with("\x1f\x8b")) return SplatFormat::spz;
    if (begin == "glTF" || ending == ".gltf") return SplatFormat::glb;
    // The reader of a damaged file's format gives the reason.
    if (ending == ".ply") return SplatFormat::ply;
    if (ending == ".spz") return SplatFormat::spz;
    if (ending == ".glb") return SplatFormat::glb;
    const ForeignKind kind = foreign_kind(path);
    throw IoError(path.string() + ": is in no known format of Gaussians" + (kind ? ", but " + kind.name : "") +
                  "; expected .ply, .compressed.ply, .spz, .splat, .glb or .gltf" +
                  (kind.way_out.empty() ? "" : "; " + kind.way_out));
}

/// True for formats that by custom have y down unless they state otherwise (UpAxis::minus_y).
[[nodiscard]] inline bool is_y_down_by_custom(SplatFormat format) {
    return format == SplatFormat::ply || format == SplatFormat::compressed_ply || format == SplatFormat::splat;
}

/// Loads a file of any of these formats. The nodes of an animated .glb or .gltf are taken at rest.
///
/// Errors  those of recognise_splats and of the format's reader.
[[nodiscard]] inline StillSplats load_any_splats(const std::filesystem::path& path) {
    switch (recognise_splats(path)) {
    case SplatFormat::ply:
        return read_ply_splats(path);
    case SplatFormat::compressed_ply:
        return read_compressed_ply(path);
    case SplatFormat::spz:
        return read_spz(path);
    case SplatFormat::splat:
        return read_splat(path);
    case SplatFormat::glb:
        break;
    }
    return read_gltf_splats(path);
}

} // namespace gsh
