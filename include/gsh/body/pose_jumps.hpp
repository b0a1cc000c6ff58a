// SPDX-License-Identifier: Apache-2.0
/// @file  Single frames whose pose lies far from those before and after: an estimator's gross errors.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh {

struct PoseJumpParams {
    double least = 0.06;    ///< metres; people who move fast are not further from half-way at ten frames a second
    double ratio = 4;       ///< to the median over frames: jitter alone is the same in all frames
    std::size_t frames = 5; ///< shorter motions have no jumps, because their median shows little
};

/// A frame, and the mean distance in metres of its joints from half-way between those of the frames beside it.
struct PoseJump {
    std::size_t frame = 0;
    double distance = 0;
};

/// The jumps of a motion, in order: frames farther from half-way than `least`, than `ratio` times the median, and than
/// the frames beside them, which one wrong pose moves half as far. The first and the last frame have none, and several
/// wrong poses in a row are found only if each differs from the next.
///
/// Errors  those of validate(Motion).
[[nodiscard]] inline std::vector<PoseJump> pose_jumps(const BodyModel& model, const Motion& motion,
                                                      const PoseJumpParams& params = {}) {
    const std::vector<vec3<double>> joints = motion_joints(model, motion);
    const std::size_t J = motion.joint_count, T = motion.frame_count();
    if (T < params.frames || T < 3) return {};
    std::vector<double> off(T, 0);
    for (std::size_t t = 1; t + 1 < T; ++t)
        for (std::size_t j = 0; j < J; ++j)
            off[t] += length(joints[t * J + j] - 0.5 * (joints[(t - 1) * J + j] + joints[(t + 1) * J + j])) /
                      static_cast<double>(J);
    const double limit = std::max(params.least, params.ratio * median({off.begin() + 1, off.end() - 1}));
    std::vector<PoseJump> jumps;
    for (std::size_t t = 1; t + 1 < T; ++t)
        if (off[t] > limit && off[t] > off[t - 1] && off[t] >= off[t + 1]) jumps.push_back({t, off[t]});
    return jumps;
}

/// The motion with the poses of these frames half-way between those of the frames beside them. Expressions stay.
///
/// Errors  ValueError for the first or the last frame, or one that does not exist.
[[nodiscard]] inline Motion without_jumps(Motion motion, const std::vector<PoseJump>& jumps) {
    const std::size_t J = motion.joint_count;
    for (const auto& [t, distance] : jumps) {
        check_value(t > 0 && t + 1 < motion.frame_count(), "without_jumps", "a frame has no frame beside it");
        motion.transl[t] = 0.5 * (motion.transl[t - 1] + motion.transl[t + 1]);
        for (std::size_t j = 0; j < J; ++j) {
            const mat3<double> before = rotation_from_axis_angle(motion.pose[(t - 1) * J + j]);
            const mat3<double> after = rotation_from_axis_angle(motion.pose[(t + 1) * J + j]);
            const vec3<double> half = 0.5 * axis_angle_from_rotation(transpose(before) * after);
            motion.pose[t * J + j] = axis_angle_from_rotation(before * rotation_from_axis_angle(half));
        }
    }
    return motion;
}

} // namespace gsh
