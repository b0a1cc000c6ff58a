// SPDX-License-Identifier: Apache-2.0
/// @file  Motions at another frame rate, by interpolation between frames, and several motions on one clock.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh {

/// A motion at an even frame rate, from its first to its last frame. A joint turns from one frame to the next about a
/// fixed axis, by the shorter way; positions and expressions change linearly.
///
/// Units   frames per second.
/// Errors  ValueError for a motion without frames, times that descend, or a rate that is not above 0 or gives more than
///         a million frames.
[[nodiscard]] inline Motion resampled(const Motion& motion, double frames_per_second);

/// The median time from one frame to the next, in seconds; 0 for a single frame.
[[nodiscard]] inline double typical_interval(Span<const double> timestamps);

/// Makes frame t of all motions the same moment, counted from their first frames, so that they can be shown together.
/// Motions whose times agree stay as they are; others are resampled to the highest of their rates.
///
/// Returns the new rate in frames per second, or 0 if no motion has changed.
inline double share_frame_times(std::vector<Motion>& motions);

// -------------------------------------------------------------------------------------------------------------

inline double typical_interval(Span<const double> timestamps) {
    std::vector<double> intervals;
    for (std::size_t t = 1; t < timestamps.size(); ++t) intervals.push_back(timestamps[t] - timestamps[t - 1]);
    if (intervals.empty()) return 0;
    const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
    std::nth_element(intervals.begin(), middle, intervals.end());
    return *middle;
}

inline double share_frame_times(std::vector<Motion>& motions) {
    double shortest = 0; // of the intervals; single frames have none
    std::size_t common = motions.empty() ? 0 : motions[0].frame_count();
    for (const Motion& motion : motions) {
        const double interval = typical_interval(motion.timestamps);
        if (interval > 0 && (shortest == 0 || interval < shortest)) shortest = interval;
        common = std::min(common, motion.frame_count());
    }
    bool agree = true;
    for (const Motion& motion : motions)
        for (std::size_t t = 0; t < common; ++t) {
            const double own = motion.timestamps[t] - motion.timestamps[0];
            agree = agree && std::abs(own - (motions[0].timestamps[t] - motions[0].timestamps[0])) <= 0.1 * shortest;
        }
    if (agree || shortest == 0) return 0;
    for (Motion& motion : motions) motion = resampled(motion, 1 / shortest);
    return 1 / shortest;
}

inline Motion resampled(const Motion& motion, double frames_per_second) {
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
