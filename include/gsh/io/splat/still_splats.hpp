// SPDX-License-Identifier: Apache-2.0
/// @file  Still Gaussians of a file, with what the file states about them: the vertical and the pixel filter.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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
    std::vector<std::string> warnings = {}; ///< one line each, beginning with the file
};

/// Throws ShapeError or ValueError, beginning with `where`, unless attributes have the sizes of one cloud and numbers
/// are those of Gaussians: finite, scales also as e^log_scale, and quaternions not 0. Writers call it first.
inline void check_writable(std::string_view where, const GaussianCloud<float>& cloud) {
    check_gaussians(where, "cloud", cloud.view(), cloud.size());
    const auto finite = [](const vec3<float>& v) {
        return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
    };
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto check = [&](bool good, std::size_t i, const char* what) { // the text is made only where it is needed
        if (!good)
            throw ValueError(std::string(where) + ": the " + what + " of Gaussian " + std::to_string(i) +
                             " is not finite" + (what == std::string_view("quaternion") ? ", or 0" : ""));
    };
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const vec3<float>& s = cloud.log_scales[i];
        const float squared = dot(cloud.quats[i], cloud.quats[i]);
        check(finite(cloud.means[i]), i, "mean");
        check(finite(s) && finite({std::exp(s.x), std::exp(s.y), std::exp(s.z)}), i, "scale");
        check(std::isfinite(cloud.opacity_logits[i]), i, "opacity");
        check(std::isfinite(squared) && squared > 0, i, "quaternion");
    }
    for (std::size_t k = 0; k < cloud.sh.size(); ++k) check(finite(cloud.sh[k]), k / basis, "colour");
}

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
