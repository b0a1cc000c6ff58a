// SPDX-License-Identifier: Apache-2.0
/// @file  The numbers by which a body bends: the axes of its joints, how far they turn, and how far they usually turn.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh {

/// One number of a pose: how far a joint turns about an axis. The axis-angle vector of a joint is the sum of its axes,
/// each times its number.
///
/// Frame   the joint's, which is the canonical frame at rest.
/// Units   radians.
struct PoseAxis {
    int joint = 0; ///< of the body
    vec3<double> axis{0};
    double mean = 0, spread = 1; ///< of people in daily motion
    double low = -3, high = 3;   ///< beyond which the joint does not turn
    double limit_weight = 200;
    double pace = 0.12; ///< the usual second difference of the number between frames of 1/10 s
    bool finger = false;
};

/// The axes of a body with the joints of SMPL-X by name: three for each joint of trunk and limbs, and for each finger
/// the flexion of its joints and its spread. Joints that the body lacks have none; jaw and eyes are not fitted.
///
/// Frame   the body at rest stands in a T, palms down, as SMPL-X.
/// Errors  ValueError if the body lacks a joint of trunk or limbs.
[[nodiscard]] inline std::vector<PoseAxis> pose_axes(const BodyModel& body, Span<const vec3<double>> rest_joints);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

struct AxisRange {
    double low, high, mean, spread;
};

/// Anatomy in round numbers: x bends hips, knees and the back; y twists; z raises arms. Of the left side; the right
/// side's y and z are mirrored.
struct JointRange {
    std::string_view joint;
    AxisRange x, y, z;
};
inline constexpr std::array<JointRange, 13> joint_ranges{{
    {"left_hip", {-2.2, 0.6, 0, 0.8}, {-0.9, 0.9, 0, 0.3}, {-0.5, 1.0, 0.05, 0.3}},
    {"left_knee", {-0.05, 2.6, 0.1, 0.9}, {-0.3, 0.3, 0, 0.1}, {-0.15, 0.15, 0, 0.08}},
    {"left_ankle", {-0.9, 0.7, 0, 0.3}, {-0.4, 0.4, 0, 0.25}, {-0.4, 0.4, 0, 0.2}},
    {"left_foot", {-0.4, 0.4, 0, 0.1}, {-0.1, 0.1, 0, 0.05}, {-0.1, 0.1, 0, 0.05}},
    {"spine1", {-0.35, 0.6, 0, 0.2}, {-0.45, 0.45, 0, 0.2}, {-0.35, 0.35, 0, 0.15}},
    {"spine2", {-0.35, 0.6, 0, 0.15}, {-0.45, 0.45, 0, 0.2}, {-0.35, 0.35, 0, 0.12}},
    {"spine3", {-0.35, 0.6, 0, 0.15}, {-0.45, 0.45, 0, 0.2}, {-0.35, 0.35, 0, 0.12}},
    {"neck", {-0.5, 0.6, 0, 0.25}, {-0.7, 0.7, 0, 0.3}, {-0.45, 0.45, 0, 0.2}},
    {"head", {-0.5, 0.6, 0, 0.25}, {-0.7, 0.7, 0, 0.3}, {-0.45, 0.45, 0, 0.2}},
    {"left_collar", {-0.2, 0.2, 0, 0.08}, {-0.35, 0.35, 0, 0.15}, {-0.35, 0.5, 0, 0.15}},
    {"left_shoulder", {-1.6, 1.6, 0, 0.6}, {-1.9, 1.0, 0, 0.8}, {-1.7, 1.4, -0.9, 0.9}},
    {"left_elbow", {-1.5, 1.5, 0, 0.5}, {-2.6, 0.1, -0.3, 1.0}, {-0.3, 0.3, 0, 0.12}},
    {"left_wrist", {-1.3, 1.3, 0, 0.4}, {-0.6, 0.6, 0, 0.25}, {-1.2, 1.2, 0, 0.35}},
}};

/// The palm at rest: x along the middle finger, y out of the back of the hand, z towards the thumb.
struct PalmFrame {
    vec3<double> x, y, z;
    PalmFrame(const vec3<double>& wrist, const vec3<double>& index, const vec3<double>& middle,
              const vec3<double>& pinky, bool left) {
        x = normalize(middle - wrist);
        const vec3<double> across = index - pinky;
        z = normalize(across - x * dot(across, x));
        y = left ? cross(z, x) : cross(x, z);
    }
};

} // namespace detail

inline std::vector<PoseAxis> pose_axes(const BodyModel& body, Span<const vec3<double>> rest_joints) {
    constexpr const char* where = "pose_axes";
    check_size(where, "rest_joints", rest_joints.size(), body.joint_count());
    const std::vector<int> joints = joints_by_name(body);
    const auto at = [&](int joint) { return rest_joints[static_cast<std::size_t>(joint)]; };
    std::vector<PoseAxis> axes;
    for (std::size_t smplx = 1; smplx < 22; ++smplx) {
        const std::string_view name = smplx_joint_names[smplx];
        check_value(joints[smplx] >= 0, where,
                    "the body has no joint '" + std::string(name) + "', expected the joints of SMPL-X by name");
        const bool right = name.starts_with("right_");
        const std::string_view left_name = smplx_joint_names[static_cast<std::size_t>(
            right ? mirrored_smplx_joint(static_cast<int>(smplx)) : static_cast<int>(smplx))];
        const auto range = std::find_if(detail::joint_ranges.begin(), detail::joint_ranges.end(),
                                        [&](const detail::JointRange& r) { return r.joint == left_name; });
        const detail::AxisRange* const ranges[3] = {&range->x, &range->y, &range->z};
        for (int k = 0; k < 3; ++k) {
            const detail::AxisRange& r = *ranges[k];
            PoseAxis axis{.joint = joints[smplx], .mean = r.mean, .spread = r.spread, .low = r.low, .high = r.high};
            axis.axis[k] = 1;
            if (right && k > 0) axis.mean = -r.mean, axis.low = -r.high, axis.high = -r.low;
            axes.push_back(axis);
        }
    }
    for (const bool left : {true, false}) {
        const int first = left ? 25 : 40; // index, middle, pinky, ring, thumb, three joints each
        const auto joint = [&](int k) { return joints[static_cast<std::size_t>(first + k)]; };
        bool whole = true;
        for (int k = 0; k < 15; ++k) whole = whole && joint(k) >= 0;
        if (!whole) continue;
        const detail::PalmFrame palm(at(joints[left ? 20 : 21]), at(joint(0)), at(joint(3)), at(joint(6)), left);
        const auto finger = [&](int k, const vec3<double>& axis, double mean, double spread, double low, double high) {
            axes.push_back({.joint = joint(k),
                            .axis = normalize(axis),
                            .mean = mean,
                            .spread = spread,
                            .low = low,
                            .high = high,
                            .limit_weight = 30,
                            .pace = 0.3,
                            .finger = true});
        };
        const double side = left ? 1 : -1;
        for (int k = 0; k < 12; ++k) finger(k, palm.z * -side, 0.25, 0.5, -0.1, 1.7); // towards the palm
        const vec3<double> thumb = (palm.x * 0.68 + palm.y * 0.73 - palm.z * 0.07) * side;
        for (int k = 12; k < 15; ++k) finger(k, thumb, 0.2, 0.4, -0.1, 1.7);
        for (const int k : {0, 3, 6, 9}) finger(k, palm.y, 0, 0.12, -0.5, 0.5);
        finger(12, palm.z, 0, 0.25, -1, 1);
    }
    return axes;
}

} // namespace gsh
