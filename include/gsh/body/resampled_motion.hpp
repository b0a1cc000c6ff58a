// SPDX-License-Identifier: Apache-2.0
/// @file  Motions at another frame rate, by interpolation between frames.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

namespace gsh {

/// A motion at an even frame rate, from its first to its last frame. A joint turns from one frame to the next about a
/// fixed axis, by the shorter way; positions and expressions change linearly.
///
/// Units   frames per second.
/// Errors  ValueError for a motion without frames, times that descend, or a rate that is not above 0 or gives more than
///         a million frames.
[[nodiscard]] inline Motion resampled(const Motion& motion, double frames_per_second) {
    const std::size_t T = motion.frame_count(), J = motion.joint_count, E = motion.expression_count;
    check_value(T > 0, "resampled", "the motion has no frames");
    check_size("resampled", "timestamps", motion.timestamps.size(), T, "store one per frame");
    check_value(std::is_sorted(motion.timestamps.begin(), motion.timestamps.end()), "resampled",
                "the timestamps descend");
    const double from = motion.timestamps.front(), span = motion.timestamps.back() - from;
    const double steps = std::floor(span * frames_per_second * (1 + 1e-9));
    check_value(frames_per_second > 0 && steps < 1e6, "resampled",
                detail::number_text(frames_per_second) + " frames per second over " + detail::number_text(span) +
                    " s, expected a rate above 0 and at most a million frames");
    Motion result;
    result.joint_count = J, result.expression_count = E, result.betas = motion.betas;
    for (std::size_t n = 0; n <= static_cast<std::size_t>(steps); ++n) {
        const double time = std::min(from + static_cast<double>(n) / frames_per_second, motion.timestamps.back());
        const auto after = std::upper_bound(motion.timestamps.begin(), motion.timestamps.end(), time);
        const std::size_t b = std::min(static_cast<std::size_t>(after - motion.timestamps.begin()), T - 1);
        const std::size_t a = b > 0 ? b - 1 : 0;
        const double length_ab = motion.timestamps[b] - motion.timestamps[a];
        const double u = length_ab > 0 ? std::clamp((time - motion.timestamps[a]) / length_ab, 0.0, 1.0) : 0;
        for (std::size_t j = 0; j < J; ++j) {
            const mat3<double> R = rotation_from_axis_angle(motion.pose[a * J + j]);
            const vec3<double> turn =
                axis_angle_from_rotation(transpose(R) * rotation_from_axis_angle(motion.pose[b * J + j]));
            result.pose.push_back(u == 0 ? motion.pose[a * J + j]
                                         : axis_angle_from_rotation(R * rotation_from_axis_angle(turn * u)));
        }
        for (std::size_t k = 0; k < E; ++k)
            result.expression.push_back(motion.expression[a * E + k] * (1 - u) + motion.expression[b * E + k] * u);
        result.transl.push_back(motion.transl[a] * (1 - u) + motion.transl[b] * u);
        result.timestamps.push_back(time);
    }
    return result;
}

} // namespace gsh
