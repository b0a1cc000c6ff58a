// SPDX-License-Identifier: Apache-2.0
/// @file  Writes clouds of Gaussians in the still formats, and remembers what they lose.
#pragma once

#include "export/export_options.hpp"

#include <gsh/gaussian/splats.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace gsh::programs {

/// The settings of a format, and the losses of all clouds that were written.
class StillWriter {
public:
    /// Errors  ValueError for a page and for an avatar.
    StillWriter(const ExportOptions& options, const FormatTraits& traits, std::optional<PixelFilter> filter);

    /// Writes a cloud with y up. Its order is that of the file, whose name has the ending of the format.
    void write(const std::filesystem::path& path, const GaussianCloud<float>& cloud);
    /// One line about what the files do not hold; empty if they hold everything.
    [[nodiscard]] std::string losses() const;

private:
    const SplatFormatTraits& row_;
    std::optional<UpAxis> up_;
    std::optional<PixelFilter> filter_;
    int version_;
    SplatLosses losses_;
    std::size_t coefficients_ = 0; ///< above the constant ones
};

} // namespace gsh::programs
