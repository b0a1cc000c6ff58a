// SPDX-License-Identifier: Apache-2.0
/// @file  Loads still Gaussians in any supported format, by a file's first bytes and name, and saves them by the name.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/splat_axes.hpp>
#include <gsh/io/splat/splat_formats.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <algorithm>
#include <filesystem>
#include <string>
#include <string_view>

namespace gsh {

/// The format of a file: from its first bytes. A .splat file, which has no header and may begin with any bytes, and a
/// damaged file are recognised by their names.
///
/// Errors  IoError for a file that cannot be opened or whose format is not known.
[[nodiscard]] inline SplatFormat recognise_splats(const InputFile& input) {
    if (input.is_folder()) throw IoError(input.name() + ": is a directory, expected a file of Gaussians");
    check_no_pipe(input);
    InputStream file(input);
    const std::string ending = input.ending();
    for (const SplatFormatTraits& row : splat_formats)
        if (row.read && !row.has_signature() && row.has_ending(ending)) return row.format;
    char bytes[16] = {};
    const std::string_view begin(bytes, file.read(bytes, sizeof bytes));
    const SplatFormatTraits* likely = nullptr; // unless a format that begins with the same bytes holds the file
    for (const SplatFormatTraits& row : splat_formats) {
        if (!row.read || !row.begins_with(begin)) continue;
        if (!row.holds)
            likely = &row;
        else if (row.holds(input))
            return row.format;
    }
    if (likely) return likely->format;
    for (const SplatFormatTraits& row : splat_formats) // the reader of a damaged file's format gives the reason
        if (row.read && row.has_ending(ending)) return row.format;
    const ForeignKind kind = foreign_kind(input);
    throw IoError(input.name() + ": is in no known format of Gaussians" + (kind ? ", but " + kind.name : "") +
                  "; expected " + splat_endings(SplatEndings::read, " or ") +
                  (kind.way_out.empty() ? "" : "; " + kind.way_out));
}

/// True for formats that by custom have y down unless they state otherwise (UpAxis::minus_y).
[[nodiscard]] inline bool is_y_down_by_custom(SplatFormat format) {
    return traits_of(format).is_y_down;
}

/// Loads a file of any of these formats. The nodes of an animated .glb or .gltf are taken at rest.
///
/// Errors  those of recognise_splats and of the format's reader.
[[nodiscard]] inline StillSplats load_any_splats(const InputFile& input) {
    return traits_of(recognise_splats(input)).read(input);
}

/// Saves a cloud with y up, atomically, in the format that the ending of the name chooses, in the order of the cloud;
/// SplatFormatTraits::order is the best one. Bands of SH that the format does not hold are dropped. Returns what was
/// lost.
///
/// Errors  ShapeError unless attributes have the sizes of one cloud; ValueError for an unknown ending and for options
///         that the format does not have; those of its writer.
inline SplatLosses save_splats(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                               SplatFileOptions options = {}) {
    check_gaussians("save_splats", "cloud", cloud.view(), cloud.size());
    const SplatFormatTraits* row = written_splat_format(path);
    check_value(row != nullptr, path.string(),
                "has an unknown ending; Gaussians are written as " + splat_endings(SplatEndings::written, " or "));
    if (!options.up) options.up = row->is_y_down ? UpAxis::minus_y : UpAxis::y;
    check_value(row->is_y_down || options.up == UpAxis::y, path.string(),
                "has y up; another vertical is for " + splat_endings(SplatEndings::y_down, " and "));
    if (options.version == 0) options.version = row->versions[0];
    check_value(std::ranges::count(row->versions, options.version) > 0, path.string(),
                std::string(row->name) + " is not written in version " + std::to_string(options.version));
    SplatLosses losses = row->write(path, with_bands_up_to(cloud, row->sh_degree), options);
    if (cloud.sh_degree > row->sh_degree) losses.dropped_degree = cloud.sh_degree;
    return losses;
}

} // namespace gsh
