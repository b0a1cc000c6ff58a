// SPDX-License-Identifier: Apache-2.0
/// @file  Selection of a capture's images for its check: evenly spaced frames, a few images of each camera.
#pragma once

#include <gsh/io/capture/capture_data.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh::detail {

/// `count` of `total` frames, including first and last; all if count is 0.
inline std::vector<std::size_t> spread_frames(std::size_t total, std::size_t count) {
    if (count == 0 || count > total) count = total;
    std::vector<std::size_t> frames;
    for (std::size_t i = 0; i < count; ++i)
        frames.push_back(count == 1 ? total / 2 : (i * (total - 1) + (count - 1) / 2) / (count - 1));
    return frames;
}

/// About `count` of the views, at least 3 and at most 12 of each camera, evenly spaced.
inline std::vector<CaptureView> spread_views(const std::vector<CaptureView>& usable, std::size_t cameras,
                                             std::size_t count) {
    std::vector<CaptureView> chosen;
    cameras = std::max<std::size_t>(1, cameras);
    const std::size_t most = std::clamp<std::size_t>(count / cameras, 3, 12);
    for (std::size_t c = 0; c < cameras; ++c) {
        std::vector<CaptureView> own;
        for (const CaptureView& v : usable)
            if (v.camera == c) own.push_back(v);
        const std::size_t each = std::min(most, own.size());
        for (std::size_t i = 0; i < each; ++i) chosen.push_back(own[(2 * i + 1) * own.size() / (2 * each)]);
    }
    return chosen;
}

} // namespace gsh::detail
