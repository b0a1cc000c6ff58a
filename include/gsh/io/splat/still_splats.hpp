// SPDX-License-Identifier: Apache-2.0
/// @file  Still Gaussians of a file, with what the file states about them: the vertical and the pixel filter.
#pragma once

#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>

#include <optional>

namespace gsh {

/// The direction that a file's numbers call up. gsh, glTF, SPZ and USD: y. PLY and .splat by custom: minus_y.
enum class UpAxis { y, minus_y };

/// What a file of Gaussians may state beside their numbers. Most files state nothing.
struct SplatNotes {
    std::optional<UpAxis> up = {};
    std::optional<PixelFilter> filter = {}; ///< that the Gaussians were trained with
};

/// Gaussians that were read from a file. If the file states which way is up, they are in gsh's frame, with y up, and
/// notes.up is what the file had. Otherwise they are as stored.
struct StillSplats {
    GaussianCloud<float> cloud;
    SplatNotes notes = {};
};

/// The cloud, which has y up, as a file with this vertical stores it.
[[nodiscard]] inline GaussianCloud<float> as_stored(GaussianCloud<float> cloud, std::optional<UpAxis> up) {
    if (up == UpAxis::minus_y) turn_about_z(cloud);
    return cloud;
}

/// The inverse, bit for bit: a cloud as a file with this vertical stores it, with y up.
inline void turn_from_stored(GaussianCloud<float>& cloud, std::optional<UpAxis> up) {
    if (up != UpAxis::minus_y) return;
    turn_about_z(cloud);
    for (quat<float>& q : cloud.quats) q = {-q.w, -q.x, -q.y, -q.z}; // half a turn back, not another one forth
}

} // namespace gsh
