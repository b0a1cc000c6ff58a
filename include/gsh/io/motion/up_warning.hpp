// SPDX-License-Identifier: Apache-2.0
/// @file  Readers of motions that turn the world to y up, and what they warn of.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/rig_up.hpp>
#include <gsh/io/motion/motion_options.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/signed_axis.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace gsh::detail {

/// "z is up, so the world is turned to y up", and the doubt; empty if y is up beyond doubt.
[[nodiscard]] inline std::string up_warning(const RigUp& up) {
    const bool is_y = up.axis == SignedAxis{};
    const std::string text = is_y ? "y is taken as up" : up.axis.name() + " is up, so the world is turned to y up";
    if (!up.doubt.empty()) return text + "; that is uncertain: " + up.doubt;
    return is_y ? "" : text;
}

/// At most 2000 frames, evenly spread.
[[nodiscard]] inline Motion some_frames(const Motion& motion) {
    Motion few;
    few.joint_count = motion.joint_count, few.expression_count = motion.expression_count, few.betas = motion.betas;
    for (std::size_t t = 0; t < motion.frame_count(); t += 1 + motion.frame_count() / 2000) {
        const auto pose = motion.pose_at(t);
        const auto expression = motion.expression_at(t);
        few.pose.insert(few.pose.end(), pose.begin(), pose.end());
        few.expression.insert(few.expression.end(), expression.begin(), expression.end());
        few.transl.push_back(motion.transl[t]);
        few.timestamps.push_back(motion.timestamps[t]);
    }
    return few;
}

/// Turns a motion of a body to y up if options.world demands it, and warns of each turn, and of a world that is left.
///
/// The axis is that along which the body stands on average (upright_rotation). A motion without one, such as a dive,
/// is turned if the body touches a ground at 0 along another axis than y (find_up).
inline void turn_upright(const BodyModel& model, Motion& motion, const MotionFileOptions& options,
                         const std::string& name, std::vector<std::string>* warnings) {
    if (options.world != MotionFileOptions::World::upright || motion.frame_count() == 0) return;
    validate(motion, model, name);
    RigUp up;
    if (const auto A = upright_rotation(motion)) {
        up.axis = signed_axis_along(transpose(*A) * vec3<double>(0, 1, 0), 0.5).value_or(SignedAxis{});
    } else {
        const RigMotion rig = rig_of_motion(model, some_frames(motion));
        up = find_up(rig, JointMap{}.match(rig, name), false);
        if (up.axis == SignedAxis{}) up.doubt = "the body stands along no axis, so the world is left as it is";
    }
    if (up.axis != SignedAxis{})
        for (std::size_t t = 0; t < motion.frame_count(); ++t)
            move_frame(model, motion, t, {turn_to_y(up.axis), vec3<double>(0)});
    if (const std::string text = up_warning(up); warnings && !text.empty()) warnings->push_back(name + ": " + text);
}

} // namespace gsh::detail
