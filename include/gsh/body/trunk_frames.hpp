// SPDX-License-Identifier: Apache-2.0
/// @file  The axes of pelvis and chest in frames of a rig's motion, from the places of hips, knees and upper arms.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/mean_direction.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// Where the trunk faces in a frame, regardless of how the rig's joints are oriented.
struct TrunkFrame {
    mat3<double> pelvis{1.0}, chest{1.0}; ///< columns left, up, forward
    double straight = 0;                  ///< 1: thighs in line with the trunk; 0: bent by 60 degrees or more
    bool known = false;                   ///< whether hips and shoulders span a plane

    /// How much the frame counts where the body's neutral pose is looked for.
    [[nodiscard]] double weight() const { return known ? straight * straight + 1e-3 : 0; }
};

/// The trunk in the given frames. The pelvis has the line of the hips; upright, its up direction lies between trunk and
/// thighs, and seated it is that of the trunk. The chest has the line from the hips to the shoulders as up.
///
/// Errors  ValueError if hips and shoulders span a plane in none of the frames.
[[nodiscard]] inline std::vector<TrunkFrame> trunk_frames(const RigMotion& rig, const MatchedJoints& matched,
                                                          const std::vector<std::size_t>& frames,
                                                          std::string_view where) {
    std::vector<TrunkFrame> trunk(frames.size());
    bool any = false;
    for (std::size_t f = 0; f < frames.size(); ++f) {
        const vec3<double>* joints = &rig.joints[frames[f] * rig.joint_count()];
        const detail::JointPair hips(joints, matched, "left_hip", "right_hip");
        const detail::JointPair shoulders(joints, matched, "left_shoulder", "right_shoulder");
        const vec3<double> up = shoulders.mean - hips.mean;
        const auto spans = [&](const vec3<double>& line) { // false for NaN, where joints coincide
            return length(cross(normalize(line), normalize(up))) > 0.1;
        };
        if (!spans(hips.left_from_right) || !spans(shoulders.left_from_right)) continue;
        const vec3<double> y = normalize(up);
        vec3<double> thighs(0);
        for (const std::string side : {"left_", "right_"}) {
            const vec3<double> thigh = joints[detail::matched_joint(matched, side + "knee")] -
                                       joints[detail::matched_joint(matched, side + "hip")];
            if (length(thigh) > 0) thighs += normalize(thigh) * 0.5;
        }
        TrunkFrame& frame = trunk[f];
        frame.straight = std::clamp((-dot(thighs, y) - 0.5) * 2, 0.0, 1.0);
        frame.pelvis = axes_of(hips.left_from_right, y - thighs * frame.straight);
        const mat3<double> chest = axes_of(y, shoulders.left_from_right); // up, left, -forward
        frame.chest = {chest[1], chest[0], chest[2] * -1.0};
        frame.known = any = true;
    }
    check_value(
        any, where,
        "hips and shoulders do not span a plane, neither in the rest pose nor in the frames, so it is not known "
        "where the body faces");
    return trunk;
}

} // namespace gsh
