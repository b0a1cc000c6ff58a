// SPDX-License-Identifier: Apache-2.0
#include "export/still_writer.hpp"

#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/compressed_ply.hpp>
#include <gsh/io/splat/gltf_splats.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/splat_file.hpp>
#include <gsh/io/splat/spz.hpp>
#include <gsh/io/splat/usda.hpp>

#include <algorithm>
#include <string>

namespace gsh::programs {

StillWriter::StillWriter(const ExportOptions& options, const FormatTraits& traits, std::optional<PixelFilter> filter)
    : traits_(traits), filter_(filter), y_down_(options.up.value_or("-y") == "-y"),
      spz_version_(options.spz_version.value_or(3)) {}

void StillWriter::write(const std::filesystem::path& path, const GaussianCloud<float>& cloud) {
    const UpAxis up = y_down_ ? UpAxis::minus_y : UpAxis::y;
    lost_degree_ = std::max(lost_degree_, cloud.sh_degree > traits_.sh_degree ? cloud.sh_degree : 0);
    const GaussianCloud<float> kept = with_bands_up_to(cloud, traits_.sh_degree);
    coefficients_ += 3 * (kept.sh.size() - kept.size());
    switch (traits_.format) {
    case ExportFormat::ply:
        return write_gaussian_ply(path, kept, {.pad_to_degree = 0, .up = up, .filter = filter_});
    case ExportFormat::compressed_ply:
        losses_ += write_compressed_ply(path, kept, up, filter_);
        return;
    case ExportFormat::splat:
        losses_ += write_splat(path, kept, up);
        return;
    case ExportFormat::glb:
        return write_gltf_splats(path, kept, filter_);
    case ExportFormat::spz:
        losses_ += write_spz(path, kept, {.version = spz_version_, .filter = filter_.value_or(PixelFilter{})});
        return;
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
    const bool spz = traits_.format == ExportFormat::spz, splat = traits_.format == ExportFormat::splat;
    const std::string step = gsh::detail::number_text(losses_.position_step);
    std::string text;
    const auto tell = [&](const std::string& what) { text += (text.empty() ? "" : "; ") + what; };
    const auto count = [&](std::size_t lost, std::size_t all, const std::string& what) {
        if (lost > 0) tell(std::to_string(lost) + " of " + std::to_string(all) + " " + what);
    };
    const auto clamped = [&](std::size_t lost, std::size_t all, const std::string& what, const char* range) {
        count(lost, all,
              what + " beyond " + range + ", which " + (spz ? "SPZ" : "the format") + " cannot hold; they are clamped");
    };
    const std::size_t all = losses_.gaussians;
    count(losses_.positions, all, "Gaussians lie farther out than SPZ reaches; they end at its edge");
    if (spz && losses_.position_step > 0)
        tell("positions are in steps of " + step + ", because the scene reaches beyond 2048");
    count(losses_.coarse, all, "Gaussians are smaller than the steps of their positions, up to " + step);
    clamped(losses_.scales, all, "Gaussians have a scale", spz ? "e^-10 to e^5.94" : "e^20");
    clamped(losses_.colors, all, "Gaussians have a colour", splat ? "0 to 1" : "-0.44 to 1.44");
    clamped(losses_.coefficients, coefficients_, "SH coefficients are", spz ? "-1 to 1" : "-4 to 4");
    if (losses_.fillers > 0)
        tell(std::to_string(losses_.fillers) + " invisible Gaussians fill up chunks that end before an outlier");
    if (lost_degree_ > 0)
        tell(traits_.sh_degree == 0 ? "the format has no SH; colours no longer depend on the view"
                                    : "SH of degree 4 are lost; the format ends at degree 3");
    return text;
}

} // namespace gsh::programs
