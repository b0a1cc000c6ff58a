// SPDX-License-Identifier: Apache-2.0
/// @file  The actor turns once in one pose, as people do for a video from which an avatar is made.
#pragma once

#include <gsh/synthetic/actor_motion.hpp>

#include <cmath>
#include <cstddef>
#include <numbers>

namespace gsh {

/// One turn to the left in `frames` even steps, arms off the body. Like a person who tries to keep still, the actor
/// sways: by 1 degree in the trunk, 2 in the arms, and 3 in the head.
///
/// Frame   the pelvis is at the origin, the actor faces +z in the first frame, soles stay on y = ActorOutfit::sole_y.
/// Errors  ValueError if frames or fps is not positive.
[[nodiscard]] inline Motion actor_turn(int frames, double fps = 10) {
    Motion motion = actor_motion(ActorMotion::talk, frames, fps);
    motion.pose.assign(motion.pose.size(), vec3<double>(0));
    motion.expression.assign(motion.expression.size(), 0);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        const double a = 2 * std::numbers::pi * static_cast<double>(t) / frames;
        const auto sway = [a](double degrees, double times, double shift) {
            return degrees * std::numbers::pi / 180 * std::sin(times * a + shift);
        };
        detail::ActorPose pose({&motion.pose[t * motion.joint_count], motion.joint_count},
                               {&motion.expression[t * motion.expression_count], motion.expression_count});
        pose.at(smplx::pelvis) = {0, a, 0};
        pose.at(smplx::spine1) = {sway(1, 2, 0.3), 0, sway(1, 3, 1.1)};
        pose.at(smplx::head) = {0.05 + sway(3, 2, 2.0), sway(3, 3, 0.2), 0};
        pose.both(smplx::left_shoulder, {0.10, -0.12, -0.80 + sway(2, 3, 0.9)}, {0.10, -0.12, -0.80 + sway(2, 2, 2.2)});
        pose.both(smplx::left_elbow, {0, -0.28 + sway(2, 2, 0.1), 0}, {0, -0.28 + sway(2, 3, 1.7), 0});
        for (int finger = 0; finger < 5; ++finger) pose.curl(finger, 0.16, 0.16);
        motion.transl[t] = vec3<double>(0);
    }
    return motion;
}

} // namespace gsh
