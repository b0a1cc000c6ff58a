// SPDX-License-Identifier: Apache-2.0
#include "export/still_writer.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/any_splats.hpp>
#include <gsh/math/sh.hpp>

#include <algorithm>
#include <string>
#include <string_view>

namespace gsh::programs {

namespace {

const SplatFormatTraits& row_of(const FormatTraits& traits) {
    check_value(traits.splats != nullptr, "StillWriter", "pages and avatars are no still files");
    return *traits.splats;
}

} // namespace

StillWriter::StillWriter(const ExportOptions& options, const FormatTraits& traits, std::optional<PixelFilter> filter)
    : row_(row_of(traits)), up_(up_axis_called(options.up.value_or(""))), filter_(filter),
      version_(options.spz_version.value_or(0)) {}

void StillWriter::write(const std::filesystem::path& path, const GaussianCloud<float>& cloud) {
    losses_ += save_splats(path, cloud, {.up = up_, .filter = filter_, .version = version_});
    const int degree = std::min(cloud.sh_degree, row_.sh_degree);
    coefficients_ += 3 * cloud.size() * static_cast<std::size_t>(sh_basis_count(degree) - 1);
}

std::string StillWriter::losses() const {
    const SplatLimits& limits = row_.limits;
    const std::string step = gsh::detail::number_text(losses_.position_step), holder(limits.holder);
    std::string text;
    const auto tell = [&](const std::string& what) { text += (text.empty() ? "" : "; ") + what; };
    const auto count = [&](std::size_t lost, std::size_t all, const std::string& what) {
        if (lost > 0) tell(std::to_string(lost) + " of " + std::to_string(all) + " " + what);
    };
    const auto clamped = [&](std::size_t lost, std::size_t all, const std::string& what, std::string_view range) {
        count(lost, all,
              what + " beyond " + std::string(range) + ", which " + holder + " cannot hold; they are clamped");
    };
    const std::size_t all = losses_.gaussians;
    count(losses_.positions, all, "Gaussians lie farther out than " + holder + " reaches; they end at its edge");
    if (!limits.reach.empty() && losses_.position_step > 0)
        tell("positions are in steps of " + step + ", because the scene reaches beyond " + std::string(limits.reach));
    count(losses_.coarse, all, "Gaussians are smaller than the steps of their positions, up to " + step);
    clamped(losses_.scales, all, "Gaussians have a scale", limits.scales);
    clamped(losses_.colors, all, "Gaussians have a colour", limits.colors);
    clamped(losses_.coefficients, coefficients_, "SH coefficients are", limits.coefficients);
    if (losses_.fillers > 0)
        tell(std::to_string(losses_.fillers) + " invisible Gaussians fill up chunks that end before an outlier");
    if (losses_.dropped_degree > 0)
        tell(row_.sh_degree == 0 ? "the format has no SH; colours no longer depend on the view"
                                 : "SH of degree " + std::to_string(losses_.dropped_degree) +
                                       " are lost; the format ends at degree " + std::to_string(row_.sh_degree));
    return text;
}

} // namespace gsh::programs
