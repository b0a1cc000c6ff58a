// SPDX-License-Identifier: Apache-2.0
/// @file  Finds rest poses that are no pose of a standing person: bones on one heap, or a frame of the motion.
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
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Why a rig's rest pose does not show where the body faces and how limbs are twisted; no value for a T, an A, arms
/// down or seated. It completes "its rest pose …".
///
/// Motion capture programs write BVH files whose zero angles are no pose: each joint has one axis along its bone, so
/// with all angles zero spine, legs and arms lie on one line. Animations without a skin often rest in their first
/// frame. Both are found by what a person at rest does not do: hips turned against shoulders, thighs along the spine,
/// arms along it, sides that do not mirror each other. Limits are closer where the pose is also that of a frame.
///
/// A rig without hips, knees, shoulders or elbows has no value, since there is nothing to measure.
[[nodiscard]] inline std::optional<std::string> rest_pose_fault(const RigMotion& rig, const MatchedJoints& matched);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The first frame whose joints have the same rotations against their parents as in the rest pose, within 2 degrees;
/// that of the hips does not count.
inline std::optional<std::size_t> frame_of_rest(const RigMotion& rig, const MatchedJoints& matched) {
    std::vector<std::pair<std::size_t, std::size_t>> bones; // joint, parent
    for (std::size_t k = 1; k < matched.size(); ++k)
        if (matched[k] >= 0 && rig.parents[static_cast<std::size_t>(matched[k])] >= 0)
            bones.emplace_back(static_cast<std::size_t>(matched[k]),
                               static_cast<std::size_t>(rig.parents[static_cast<std::size_t>(matched[k])]));
    const auto local = [&](const mat3<double>* rotations, const std::pair<std::size_t, std::size_t>& bone) {
        return transpose(rotations[bone.second]) * rotations[bone.first];
    };
    std::vector<mat3<double>> rest;
    for (const auto& bone : bones) rest.push_back(local(rig.rest_rotations.data(), bone));
    for (std::size_t t = 0; t < rig.frame_count(); ++t) {
        std::size_t same = 0;
        while (same < bones.size()) {
            const mat3<double> other = local(&rig.rotations[t * rig.joint_count()], bones[same]);
            double trace = 0;
            for (int c = 0; c < 3; ++c) trace += dot(rest[same][c], other[c]);
            if (trace < 3 - 1.2e-3) break; // 1 + 2 cos(2 degrees)
            ++same;
        }
        if (same == bones.size()) return t;
    }
    return std::nullopt;
}

/// Angles of a pose, in degrees, that are small in a rest pose.
struct PoseAngles {
    double twist = 0;             ///< between the lines of hips and shoulders
    double thighs = 0, arms = 0;  ///< thighs from straight down the trunk; the nearer arm from straight up
    double knees = 0, elbows = 0; ///< the more bent one
    double mirrored = 0;          ///< between a limb of the left and the mirrored one of the right
    bool plane = true;            ///< whether hips and shoulders span a plane

    PoseAngles(const vec3<double>* joints, const MatchedJoints& matched) {
        const auto at = [&](const std::string& joint) { return joints[matched_joint(matched, joint)]; };
        const auto angle = [](const vec3<double>& a, const vec3<double>& b) {
            return std::atan2(length(cross(a, b)), dot(a, b)) * 57.29577951308232;
        };
        const JointPair hips(joints, matched, "left_hip", "right_hip");
        const JointPair shoulders(joints, matched, "left_shoulder", "right_shoulder");
        const vec3<double> up = shoulders.mean - hips.mean, left = hips.left_from_right + shoulders.left_from_right;
        plane = length(cross(left, up)) > 1e-3 * length(up) * length(left) && length(up) > 0;
        if (!plane) return;
        twist = angle(hips.left_from_right, shoulders.left_from_right);
        const vec3<double> y = normalize(up), x = normalize(left - y * dot(left, y));
        arms = 180;
        for (const auto& [from, to, end] :
             {std::array<const char*, 3>{"hip", "knee", "ankle"}, {"shoulder", "elbow", "wrist"}}) {
            const bool leg = std::string_view(from) == "hip";
            std::array<vec3<double>, 2> upper{}, lower{};
            for (const std::size_t side : {std::size_t(0), std::size_t(1)}) {
                const std::string prefix = side == 0 ? "left_" : "right_";
                upper[side] = at(prefix + to) - at(prefix + from);
                if (leg) thighs = std::max(thighs, angle(upper[side], y * -1.0));
                if (!leg) arms = std::min(arms, angle(upper[side], y));
                if (matched_joint(matched, prefix + end) < 0) continue;
                lower[side] = at(prefix + end) - at(prefix + to);
                double& bend = leg ? knees : elbows;
                bend = std::max(bend, angle(upper[side], lower[side]));
            }
            const auto mirror = [&](const vec3<double>& v) { return v - x * (2 * dot(v, x)); };
            mirrored = std::max(mirrored, angle(upper[0], mirror(upper[1])));
            if (length(lower[0]) > 0 && length(lower[1]) > 0)
                mirrored = std::max(mirrored, angle(lower[0], mirror(lower[1])));
        }
    }
};

} // namespace detail

inline std::optional<std::string> rest_pose_fault(const RigMotion& rig, const MatchedJoints& matched) {
    if (!detail::has_trunk(matched)) return std::nullopt;
    for (const char* joint : {"left_knee", "right_knee", "left_elbow", "right_elbow"})
        if (detail::matched_joint(matched, joint) < 0) return std::nullopt;
    const detail::PoseAngles rest(rig.rest_joints.data(), matched);
    const auto degrees = [](double angle) { return std::to_string(std::lround(angle)) + " degrees"; };
    if (!rest.plane) return "has hips and shoulders that span no plane";
    if (rest.thighs > 100) return "has its thighs along the spine";
    if (rest.twist > 20) return "has shoulders that are turned by " + degrees(rest.twist) + " against its hips";
    if (rest.arms < 35) return "has its arms along the spine";
    if (rest.mirrored > 40) return "has limbs of left and right that differ by " + degrees(rest.mirrored);
    if (rest.knees > 120) return "has a knee that is bent by " + degrees(rest.knees);
    if (rest.twist < 10 && rest.mirrored < 20 && rest.thighs < 35 && rest.knees < 50) return std::nullopt;
    const auto frame = detail::frame_of_rest(rig, matched);
    if (!frame) return std::nullopt;
    return "is that of frame " + std::to_string(*frame) + ", no neutral one";
}

} // namespace gsh
