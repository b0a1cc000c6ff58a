// SPDX-License-Identifier: Apache-2.0
/// @file  Which frames of a registration are doubted, and how much each of them counts.
#pragma once

#include <gsh/math/spread.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// When a frame is doubted.
struct FrameDoubt {
    double gap = 3;         ///< dB below the median of the frames that are always believed
    double deviations = 3;  ///< the same in standard deviations of the frames, estimated without outliers
    double good_fit = 13;   ///< dB; a frame that is explained as well as this is believed, however good the others are
    std::size_t frames = 5; ///< fewer frames do not show what is usual, so all of them are believed
};

/// How much each frame is believed, from how well the bodies explain it (Registration::frame_fit). A frame at the limit
/// has 1, one 3 dB below it a quarter, one 7 dB below it a twenty-fifth: it still learns its own pose, and hardly
/// disturbs what all frames share. The limit is the lowest of `gap` and `deviations` below the median, and `good_fit`.
/// Frames without a photograph (NaN) have 1.
[[nodiscard]] inline std::vector<double> frame_weights(const std::vector<double>& frame_fit,
                                                       const FrameDoubt& doubt = {}) {
    std::vector<double> known;
    for (const double fit : frame_fit)
        if (std::isfinite(fit)) known.push_back(fit);
    std::vector<double> weights(frame_fit.size(), 1);
    if (known.size() < doubt.frames) return weights;
    const Spread usual = robust_spread(std::move(known));
    const double limit =
        std::min(doubt.good_fit, usual.median - std::max(doubt.gap, doubt.deviations * usual.deviation));
    for (std::size_t t = 0; t < weights.size(); ++t)
        if (frame_fit[t] < limit) weights[t] = std::pow(10, (frame_fit[t] - limit) / 5);
    return weights;
}

} // namespace gsh
