// SPDX-License-Identifier: Apache-2.0
/// @file  How high ankles are above the ground on which a rig or a body stands.
#pragma once

#include <gsh/body/bone_end.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Height of a rig's ankles above the soles on which it stands; no value where nothing shows it.
///
/// A rest pose shows it that stands on y = 0. Else the frames do: when the body stands, its lower ankle is at that
/// height above y = 0. They are believed if the joints of the toes, which are a little above the sole, are nearly as
/// far below the ankles: feet may be on a box throughout, or the ground elsewhere. Else the toes count alone.
///
/// `rest` has the rig's rest pose; `rest_has_place`: whether its positions are those of the world.
[[nodiscard]] inline std::optional<double> ankle_height(const RigMotion& rig, const RigMotion& rest,
                                                        const MatchedJoints& matched, bool rest_has_place);

/// The same of a body in its rest pose, whose lowest vertex is on its soles.
[[nodiscard]] inline double ankle_height(const std::vector<vec3<double>>& vertices,
                                         const std::vector<vec3<double>>& joints, const MatchedJoints& matched);

/// What is to be added to a body's heights so that it stands on its soles where the rig stands. Its ankles, at their
/// median, are then `own_ankle` above the ground in the frames in which the rig's lower ankle is at `rig_ankle`, within
/// 3 % of the leg. Where these are fewer than five, legs of the same pose are assumed instead.
///
/// Shapes  body_lower [T]: heights of the body's lower ankle, which are about `scale` times those of the rig's.
[[nodiscard]] inline double ground_raise(const RigMotion& rig, const MatchedJoints& matched, double leg,
                                         double rig_ankle, const std::vector<double>& body_lower, double own_ankle,
                                         double scale);

/// Whether two skeletons have legs and feet of the same proportions: the second scaled by `scale` has the same lengths
/// as the first, within 2 % of the leg.
[[nodiscard]] inline bool has_same_legs(const RigMotion& a, const MatchedJoints& of_a, const RigMotion& b,
                                        const MatchedJoints& of_b, double scale);

// -------------------------------------------------------------------------------------------------------------

inline std::optional<double> ankle_height(const RigMotion& rig, const RigMotion& rest, const MatchedJoints& matched,
                                          bool rest_has_place) {
    const int left = detail::matched_joint(matched, "left_ankle"),
              right = detail::matched_joint(matched, "right_ankle");
    const double leg =
        std::max(detail::leg_length(rest, matched, "left_"), detail::leg_length(rest, matched, "right_"));
    if (left < 0 || right < 0 || !(leg > 0)) return std::nullopt;
    const vec3<double> up = facing(rest, matched, "ankle_height")[1];
    const auto height = [&](int joint) { return dot(rest.rest_joints[static_cast<std::size_t>(joint)], up); };
    const double ankle = (height(left) + height(right)) / 2;
    double lowest = ankle;
    for (const int joint : matched)
        if (joint >= 0) lowest = std::min(lowest, height(joint));
    if (rest_has_place && up.y > 0.9 && lowest > -0.02 * leg && lowest < 0.15 * leg && ankle < leg) return ankle;

    std::optional<double> by_toes;
    const auto toes = [&](const char* foot, int ankle_joint) {
        const int joint = detail::matched_joint(matched, foot);
        return joint >= 0 ? joint : end_of(rest, ankle_joint);
    };
    const int a = toes("left_foot", left), b = toes("right_foot", right);
    if (a >= 0 && b >= 0)
        if (const double drop = ankle - (height(a) + height(b)) / 2; drop > -0.05 * leg && drop < leg)
            by_toes = drop + 0.03 * leg;
    std::vector<double> lower;
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        lower.push_back(std::min(rig.joint(t, left).y, rig.joint(t, right).y));
    const auto standing = lower.begin() + static_cast<std::ptrdiff_t>((lower.size() - 1) / 50);
    std::nth_element(lower.begin(), standing, lower.end());
    return std::abs(*standing - by_toes.value_or(0.1 * leg)) < 0.12 * leg ? *standing : by_toes;
}

inline double ankle_height(const std::vector<vec3<double>>& vertices, const std::vector<vec3<double>>& joints,
                           const MatchedJoints& matched) {
    double lowest = std::numeric_limits<double>::infinity(), ankles = 0, count = 0;
    for (const auto& v : vertices) lowest = std::min(lowest, v.y);
    for (const char* name : {"left_ankle", "right_ankle"})
        if (const int joint = detail::matched_joint(matched, name); joint >= 0)
            ankles += joints[static_cast<std::size_t>(joint)].y, count += 1;
    return count > 0 ? ankles / count - lowest : 0;
}

inline double ground_raise(const RigMotion& rig, const MatchedJoints& matched, double leg, double rig_ankle,
                           const std::vector<double>& body_lower, double own_ankle, double scale) {
    const int left = detail::matched_joint(matched, "left_ankle"),
              right = detail::matched_joint(matched, "right_ankle");
    std::vector<double> standing;
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        if (std::abs(std::min(rig.joint(t, left).y, rig.joint(t, right).y) - rig_ankle) < 0.03 * leg)
            standing.push_back(body_lower[t]);
    if (standing.size() < 5) return own_ankle - scale * rig_ankle; // a pose or two may be anything
    const auto median = standing.begin() + static_cast<std::ptrdiff_t>(standing.size() / 2);
    std::nth_element(standing.begin(), median, standing.end());
    return own_ankle - *median;
}

inline bool has_same_legs(const RigMotion& a, const MatchedJoints& of_a, const RigMotion& b, const MatchedJoints& of_b,
                          double scale) {
    const double leg = detail::leg_length(a, of_a, "left_");
    for (const std::string side : {"left_", "right_"})
        for (const auto& [from, to] : {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"ankle", "foot"}}) {
            const auto size = [&](const RigMotion& rig, const MatchedJoints& matched) {
                const int i = detail::matched_joint(matched, side + from),
                          k = detail::matched_joint(matched, side + to);
                return i < 0 || k < 0 ? -1
                                      : length(rig.rest_joints[static_cast<std::size_t>(k)] -
                                               rig.rest_joints[static_cast<std::size_t>(i)]);
            };
            const double own = size(a, of_a), other = size(b, of_b);
            if ((own < 0) != (other < 0) || std::abs(own - other * scale) > 0.02 * leg) return false;
        }
    return true;
}

} // namespace gsh
