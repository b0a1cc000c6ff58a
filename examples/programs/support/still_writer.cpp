// SPDX-License-Identifier: Apache-2.0
#include "support/still_writer.hpp"

#include <gsh/io/splat/compressed_ply.hpp>
#include <gsh/io/splat/gltf_splats.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/splat_file.hpp>
#include <gsh/io/splat/spz.hpp>
#include <gsh/io/splat/usda.hpp>

#include <algorithm>

namespace gsh::examples {

StillWriter::StillWriter(const ExportOptions& options, const FormatTraits& traits, std::optional<PixelFilter> filter)
    : traits_(traits), filter_(filter), y_down_(options.up.value_or("-y") == "-y"),
      spz_version_(options.spz_version.value_or(3)) {}

void StillWriter::write(const std::filesystem::path& path, const GaussianCloud<float>& cloud) {
    const UpAxis up = y_down_ ? UpAxis::minus_y : UpAxis::y;
    lost_degree_ = std::max(lost_degree_, cloud.sh_degree > traits_.sh_degree ? cloud.sh_degree : 0);
    const GaussianCloud<float> kept = with_bands_up_to(cloud, traits_.sh_degree);
    switch (traits_.format) {
    case ExportFormat::ply:
        return write_gaussian_ply(path, kept, {.pad_to_degree = 0, .up = up, .filter = filter_});
    case ExportFormat::compressed_ply:
        return write_compressed_ply(path, kept, up, filter_);
    case ExportFormat::splat:
        return write_splat(path, kept, up);
    case ExportFormat::glb:
        return write_gltf_splats(path, kept, filter_);
    case ExportFormat::spz:
        clipped_ += spz_clipped_count(kept);
        coefficients_ += 3 * (kept.sh.size() - kept.size());
        return write_spz(path, kept, {.version = spz_version_, .filter = filter_.value_or(PixelFilter{})});
    case ExportFormat::usda: {
        UsdaSplats file(path, filter_);
        file.add(kept);
        return file.commit();
    }
    case ExportFormat::html:
    case ExportFormat::gsh:
        break;
    }
    throw ValueError("StillWriter: pages and avatars are no still files");
}

std::string StillWriter::losses() const {
    if (clipped_)
        return std::to_string(clipped_) + " of " + std::to_string(coefficients_) +
               " SH coefficients are beyond -1 to 1, which SPZ cannot hold; they are clamped";
    if (!lost_degree_) return {};
    return traits_.sh_degree == 0 ? std::string("the format has no SH; colours no longer depend on the view")
                                  : "SH of degree 4 are lost; the format ends at degree 3";
}

} // namespace gsh::examples
