// SPDX-License-Identifier: Apache-2.0
/// @file  Still Gaussians of a file, with what the file states about them, and what a format cannot hold.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/splat_axes.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

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

/// Takes another direction for up than the file states, or one where it states none: its numbers count as stored with
/// this vertical.
inline void restate_up(StillSplats& splats, UpAxis up) {
    if (splats.notes.up == up) return;
    splats.cloud = as_stored(std::move(splats.cloud), splats.notes.up);
    turn_from_stored(splats.cloud, up);
    splats.notes.up = up;
}

/// Numbers that stand for infinities in files: the log-scale of a flat Gaussian, whose file has a length of 0 or its
/// logarithm, and the logit of an opacity of 1, whose sigmoid is 1 in float. The logit of 0 is its negative.
inline constexpr float flat_log_scale = -20, certain_logit = 20;

/// The largest log-scale of a Gaussian. The square of its length, which is a variance, is a float.
inline constexpr float largest_log_scale = 44;

/// Throws ShapeError or ValueError, beginning with `where`, unless attributes have the sizes of one cloud and numbers
/// are those of Gaussians: finite, scales at most e^44, and quaternions not 0. Readers and writers call it.
inline void check_writable(std::string_view where, const GaussianCloud<float>& cloud) {
    check_gaussians(where, "cloud", cloud.view(), cloud.size());
    const auto finite = [](const vec3<float>& v) {
        return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
    };
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto fail = [&](std::size_t i, const std::string& what) {
        throw ValueError(std::string(where) + ": the " + what + " of Gaussian " + std::to_string(i) + " is not finite");
    };
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const vec3<float>& s = cloud.log_scales[i];
        const float squared = dot(cloud.quats[i], cloud.quats[i]), largest = std::max({s.x, s.y, s.z});
        if (!finite(cloud.means[i])) fail(i, "mean");
        if (!finite(s)) fail(i, "scale");
        if (largest > largest_log_scale)
            throw ValueError(std::string(where) + ": the scale of Gaussian " + std::to_string(i) + " is e^" +
                             detail::number_text(largest) + ", whose square is not finite; expected at most e^44");
        if (!std::isfinite(cloud.opacity_logits[i])) fail(i, "opacity");
        if (!(std::isfinite(squared) && squared > 0))
            throw ValueError(std::string(where) + ": the quaternion of Gaussian " + std::to_string(i) +
                             " is 0 or not finite");
    }
    for (std::size_t k = 0; k < cloud.sh.size(); ++k)
        if (!finite(cloud.sh[k])) fail(k / basis, "colour");
}

namespace detail {

/// A quaternion of a file as a Gaussian has it. It may have any length; one whose square is beyond float becomes a unit
/// one. Nothing if its length is 0.
[[nodiscard]] inline std::optional<quat<float>> rotation_of_file(const quat<double>& q) {
    const double squared = dot(q, q);
    if (!(squared > 0)) return std::nullopt;
    const double s = squared > 1e-20 && squared < 1e20 ? 1 : 1 / std::sqrt(squared);
    return quat<float>{float(q.w * s), float(q.x * s), float(q.y * s), float(q.z * s)};
}

} // namespace detail

/// How large a Gaussian is, as a logarithm: its middle axis, so that neither flat ones nor needles count as larger or
/// smaller than they are seen.
[[nodiscard]] inline double log_size_of(const vec3<float>& log_scale) {
    const float x = log_scale.x, y = log_scale.y, z = log_scale.z;
    return std::max(std::min(x, y), std::min(std::max(x, y), z));
}
[[nodiscard]] inline double size_of(const vec3<float>& log_scale) {
    return std::exp(log_size_of(log_scale));
}

/// What a file does not hold of the Gaussians that were written to it.
struct SplatLosses {
    std::size_t gaussians = 0;    ///< that were written
    std::size_t positions = 0;    ///< Gaussians that were moved to the nearest place that the format holds
    std::size_t scales = 0;       ///< Gaussians with a scale that was
    std::size_t colors = 0;       ///< Gaussians whose constant colour was
    std::size_t coefficients = 0; ///< SH coefficients above the constant one that were
    std::size_t coarse = 0;       ///< Gaussians whose positions are in steps larger than themselves
    std::size_t fillers = 0;      ///< invisible Gaussians that were added
    double position_step = 0;     ///< the largest step of positions where it is larger than usual, else 0
    int dropped_degree = 0;       ///< of a cloud whose highest bands of SH save_splats dropped, else 0

    SplatLosses& operator+=(const SplatLosses& other) {
        gaussians += other.gaussians, positions += other.positions, scales += other.scales, colors += other.colors;
        coefficients += other.coefficients, coarse += other.coarse, fillers += other.fillers;
        position_step = std::max(position_step, other.position_step);
        dropped_degree = std::max(dropped_degree, other.dropped_degree);
        return *this;
    }
};

} // namespace gsh
