// SPDX-License-Identifier: Apache-2.0
/// @file  Exports of an avatar: still frames, sequences, moving pieces, a mesh, a compact avatar.
#pragma once

#include "export/export_options.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh {
template <class T>
struct GaussianCloud;
}

namespace gsh::programs {

/// What was written.
struct ExportResult {
    std::filesystem::path path;
    std::size_t gaussians = 0;
    std::size_t files = 0;   ///< 0 after an interrupt, which leaves nothing
    std::string losses = {}; ///< one line, or empty
};

/// Exports an avatar as the options say.
/// Errors  those of the files and of the writers; ValueError for a frame that the motion does not have.
ExportResult export_avatar_file(const ExportOptions& options, const FormatTraits& traits);

/// The order in which a format stores Gaussians best; empty for their own.
std::vector<std::uint32_t> order_for(const FormatTraits& traits, const GaussianCloud<float>& cloud);

/// The size of a file, or of all files of a folder; none for a pipe or a device.
std::optional<std::uintmax_t> bytes_of(const std::filesystem::path& path);

} // namespace gsh::programs
