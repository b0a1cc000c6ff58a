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
    StillWriter(const ExportOptions& options, const FormatTraits& traits, std::optional<PixelFilter> filter);

    /// Writes a cloud with y up. Its order is that of the file.
    void write(const std::filesystem::path& path, const GaussianCloud<float>& cloud);
    /// One line about what the files do not hold; empty if they hold everything.
    [[nodiscard]] std::string losses() const;

private:
    FormatTraits traits_;
    std::optional<PixelFilter> filter_;
    bool y_down_;
    int spz_version_;
    SplatLosses losses_;
    std::size_t coefficients_ = 0; ///< above the constant ones
    int lost_degree_ = 0;          ///< of clouds whose bands a format without SH drops
};

} // namespace gsh::programs
