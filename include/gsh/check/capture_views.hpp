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

/// At most `most` views of each camera, evenly spaced, camera by camera.
inline std::vector<CaptureView> views_of_cameras(const std::vector<CaptureView>& usable, std::size_t cameras,
                                                 std::size_t most) {
    std::vector<CaptureView> chosen;
    for (std::size_t c = 0; c < std::max<std::size_t>(1, cameras); ++c) {
        std::vector<CaptureView> own;
        for (const CaptureView& v : usable)
            if (v.camera == c) own.push_back(v);
        const std::size_t each = std::min(most, own.size());
        for (std::size_t i = 0; i < each; ++i) chosen.push_back(own[(2 * i + 1) * own.size() / (2 * each)]);
    }
    return chosen;
}

/// About `count` of the views, at least 3 and at most 12 of each camera, evenly spaced.
inline std::vector<CaptureView> spread_views(const std::vector<CaptureView>& usable, std::size_t cameras,
                                             std::size_t count) {
    const std::size_t most = std::clamp<std::size_t>(count / std::max<std::size_t>(1, cameras), 3, 12);
    return views_of_cameras(usable, cameras, most);
}

/// All views; if they are more than `count`, about so many, at least 3 of each camera, evenly spaced.
inline std::vector<CaptureView> few_views(const std::vector<CaptureView>& usable, std::size_t cameras,
                                          std::size_t count) {
    if (usable.size() <= count) return usable;
    return views_of_cameras(usable, cameras, std::max<std::size_t>(3, count / std::max<std::size_t>(1, cameras)));
}

} // namespace gsh::detail
