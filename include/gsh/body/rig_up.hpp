// SPDX-License-Identifier: Apache-2.0
/// @file  Which axis of a rig's world points up: from its rest pose, its frames, and the ground that it touches.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_check.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/signed_axis.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

struct RigUp {
    SignedAxis axis;   ///< +y where nothing shows another
    std::string doubt; ///< why the axis is uncertain; empty if it is not
};

/// Finds the axis of a rig's world that points up.
///
/// The rest pose stands along an axis, and so does the body on average in the frames. Where both agree, that axis is
/// up, whichever it is. Where they do not, or where the frames have no axis (dives, cartwheels), the ground decides:
/// along the axis that is up the lowest joint stays close to 0, and the hips stay above 0. If that shows nothing
/// either, the frames count less than the rest pose, and +y more than both; the result then has a doubt.
///
/// `rest_is_in_world`: whether the rest pose has the axes of the frames' world; that of a glTF skin does not.
[[nodiscard]] inline RigUp find_up(const RigMotion& rig, const MatchedJoints& matched, bool rest_is_in_world = true);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// From the middle of the hips to that of the upper arms, unit length or NaN.
inline vec3<double> trunk_direction(const vec3<double>* joints, const MatchedJoints& matched) {
    const JointPair hips(joints, matched, "left_hip", "right_hip");
    return normalize(JointPair(joints, matched, "left_shoulder", "right_shoulder").mean - hips.mean);
}

/// Whether there is a ground at 0 along an axis: the lowest joints of most frames are a few centimetres above it, none
/// is far below, and the hips are not in it. `lying`: all lowest joints are close to it.
inline bool has_ground(const RigMotion& rig, const MatchedJoints& matched, const SignedAxis& up, bool lying) {
    const double leg = std::max(leg_length(rig, matched, "left_"), leg_length(rig, matched, "right_"));
    const int pelvis = matched_joint(matched, "pelvis");
    if (!(leg > 0) || pelvis < 0) return false;
    std::vector<double> lowest, hips;
    const std::size_t step = 1 + rig.frame_count() / 3000;
    for (std::size_t t = 0; t < rig.frame_count(); t += step) {
        const auto height = [&](int joint) { return rig.joint(t, joint)[up.index] * up.sign / leg; };
        double low = height(pelvis);
        hips.push_back(low);
        for (const int joint : matched)
            if (joint >= 0) low = std::min(low, height(joint));
        lowest.push_back(low);
    }
    const auto quantile = [](std::vector<double>& values, double share) {
        const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
        std::nth_element(values.begin(), at, values.end());
        return *at;
    };
    if (lying && !(quantile(lowest, 0.95) < 0.15)) return false;
    return quantile(lowest, 0.05) > -0.06 && quantile(lowest, 0.5) < 0.2 && quantile(lowest, 0.8) < 0.4 &&
           quantile(hips, 0.1) > 0.05;
}

} // namespace detail

inline RigUp find_up(const RigMotion& rig, const MatchedJoints& matched, bool rest_is_in_world) {
    const SignedAxis y{};
    if (!detail::has_trunk(matched) || rig.frame_count() == 0) return {y, ""};
    std::optional<SignedAxis> rest, stands;
    if (rest_is_in_world && !rest_pose_fault(rig, matched))
        rest = signed_axis_along(detail::trunk_direction(rig.rest_joints.data(), matched), 0.8);
    vec3<double> mean(0);
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        mean += detail::trunk_direction(&rig.joints[t * rig.joint_count()], matched) *
                (1.0 / static_cast<double>(rig.frame_count()));
    stands = signed_axis_along(mean, 0.6);
    if (stands && stands == rest) return {*stands, ""};

    // The first of these with a ground, if it is the only one, else the first.
    std::vector<SignedAxis> candidates;
    const auto add = [&](const std::optional<SignedAxis>& axis) {
        if (axis && std::find(candidates.begin(), candidates.end(), *axis) == candidates.end())
            candidates.push_back(*axis);
    };
    if (stands == y) add(y);
    if (rest) add(rest);
    if (!rest && stands) add(stands);
    add(y), add(stands), add(SignedAxis{2, 1});
    std::vector<SignedAxis> grounds;
    for (const auto& axis : candidates)
        if (detail::has_ground(rig, matched, axis, stands && axis != *stands)) grounds.push_back(axis);
    if (grounds.size() == 1) return {grounds[0], ""};
    const SignedAxis chosen = grounds.empty() ? candidates[0] : grounds[0];
    if (chosen == y && (!stands || (stands == y && !rest))) return {y, ""}; // nothing speaks against it
    std::string doubt = stands ? "in the frames the body lies or stands along " + stands->name()
                               : "in the frames the body stands along no axis";
    doubt += rest ? ", in the rest pose it stands along " + rest->name() : ", and the rest pose shows no axis";
    return {chosen, doubt};
}

} // namespace gsh
