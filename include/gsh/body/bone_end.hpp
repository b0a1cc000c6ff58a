// SPDX-License-Identifier: Apache-2.0
/// @file  Leaves of a rig that mark the ends of hands and feet: End Sites of BVH files, and joints named like them.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>

namespace gsh {

/// The leaf that marks the end of a joint's bone: the End Site of a BVH file, or a joint named like one (HandEnd,
/// ToeTip, HeadNub), if its bone is at least a quarter as long as the one before. -1 if there is none, or more than
/// one.
[[nodiscard]] inline int end_of(const RigMotion& rig, int joint);

/// The end of a hand without fingers, or -1. Some programs write End Sites of a fixed direction, so the end counts only
/// if the hand is then as straight in the frames as if it continued the forearm of the rest pose, on average and within
/// 15 degrees.
///
/// `rest` has the rig's rest pose.
[[nodiscard]] inline int hand_end(const RigMotion& rig, const RigMotion& rest, const MatchedJoints& matched,
                                  const std::string& side);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::array<std::string_view, 5> end_words = {"end", "endsite", "tip", "nub", "effector"};

/// The mean angle in radians between two directions over at most 3000 frames; of(frame) gives both.
template <class Directions>
double mean_angle(const RigMotion& rig, const Directions& of) {
    const std::size_t step = 1 + rig.frame_count() / 3000;
    double sum = 0, count = 0;
    for (std::size_t t = 0; t < rig.frame_count(); t += step) {
        const auto [a, b] = of(t);
        sum += std::atan2(length(cross(a, b)), dot(a, b)), count += 1;
    }
    return count > 0 ? sum / count : 0;
}

} // namespace detail

inline int end_of(const RigMotion& rig, int joint) {
    if (joint < 0) return -1;
    const auto j = static_cast<std::size_t>(joint);
    int end = -1;
    for (std::size_t c = 0; c < rig.joint_count(); ++c) {
        if (rig.parents[c] != joint) continue;
        const JointWords words = joint_words(rig.names[c]);
        const bool named = std::any_of(detail::end_words.begin(), detail::end_words.end(),
                                       [&](std::string_view word) { return words.part.ends_with(word); });
        if (!named || std::find(rig.parents.begin(), rig.parents.end(), static_cast<int>(c)) != rig.parents.end())
            continue;
        if (end >= 0) return -1; // any of them could be meant
        end = static_cast<int>(c);
    }
    if (end < 0 || rig.parents[j] < 0) return -1;
    const double own = length(rig.rest_joints[static_cast<std::size_t>(end)] - rig.rest_joints[j]);
    const double before = length(rig.rest_joints[j] - rig.rest_joints[static_cast<std::size_t>(rig.parents[j])]);
    return own > 0 && own >= 0.25 * before ? end : -1;
}

inline int hand_end(const RigMotion& rig, const RigMotion& rest, const MatchedJoints& matched,
                    const std::string& side) {
    const int wrist = detail::matched_joint(matched, side + "wrist"),
              elbow = detail::matched_joint(matched, side + "elbow");
    const int end = end_of(rig, wrist);
    if (end < 0 || elbow < 0) return -1;
    const auto w = static_cast<std::size_t>(wrist);
    const vec3<double> forearm = rest.rest_joints[w] - rest.rest_joints[static_cast<std::size_t>(elbow)];
    const auto angle = [&](const auto& hand) {
        return detail::mean_angle(
            rig, [&](std::size_t t) { return std::pair(hand(t), rig.joint(t, wrist) - rig.joint(t, elbow)); });
    };
    const double straight =
        angle([&](std::size_t t) { return rig.rotation(t, wrist) * (transpose(rest.rest_rotations[w]) * forearm); });
    const double to_end = angle([&](std::size_t t) { return rig.joint(t, end) - rig.joint(t, wrist); });
    return to_end <= straight + 0.26 ? end : -1;
}

} // namespace gsh
