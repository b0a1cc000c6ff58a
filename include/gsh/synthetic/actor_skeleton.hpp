// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's skeleton: the 55 joints of SMPL-X in the same order, with our own proportions.
#pragma once

#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <string_view>

namespace gsh {

/// Joint numbers in SMPL-X's order. A right body joint follows its left one; a right hand joint follows its left one by
/// actor_finger_joints.
namespace smplx {
// clang-format off
enum Joint : int {
    pelvis = 0, left_hip = 1, spine1 = 3, left_knee = 4, spine2 = 6, left_ankle = 7, spine3 = 9, left_foot = 10,
    neck = 12, left_collar = 13, head = 15, left_shoulder = 16, left_elbow = 18, left_wrist = 20,
    jaw = 22, left_eye = 23, right_eye = 24,
    left_index1 = 25, left_middle1 = 28, left_pinky1 = 31, left_ring1 = 34, left_thumb1 = 37, right_index1 = 40
};
// clang-format on
} // namespace smplx
inline constexpr int actor_joint_count = 55;
inline constexpr int actor_finger_joints = 15; ///< joints per hand beyond the wrist

struct ActorJointInfo {
    std::string_view name;
    int parent;
    std::array<double, 3> position; ///< metres, T-pose; the pelvis is the origin
};

/// Name, parent and rest position of every joint; the right side mirrors the left exactly.
inline constexpr std::array<ActorJointInfo, actor_joint_count> actor_joints = {{
    {"pelvis", -1, {0, 0, 0}},
    {"left_hip", 0, {0.095, -0.030, 0}},
    {"right_hip", 0, {-0.095, -0.030, 0}},
    {"spine1", 0, {0, 0.095, -0.015}},
    {"left_knee", 1, {0.115, -0.445, 0.002}},
    {"right_knee", 2, {-0.115, -0.445, 0.002}},
    {"spine2", 3, {0, 0.190, -0.015}},
    {"left_ankle", 4, {0.135, -0.845, -0.022}},
    {"right_ankle", 5, {-0.135, -0.845, -0.022}},
    {"spine3", 6, {0, 0.285, -0.020}},
    {"left_foot", 7, {0.150, -0.895, 0.095}},
    {"right_foot", 8, {-0.150, -0.895, 0.095}},
    {"neck", 9, {0, 0.495, -0.015}},
    {"left_collar", 9, {0.040, 0.435, 0}},
    {"right_collar", 9, {-0.040, 0.435, 0}},
    {"head", 12, {0, 0.580, 0.012}},
    {"left_shoulder", 13, {0.172, 0.455, -0.008}},
    {"right_shoulder", 14, {-0.172, 0.455, -0.008}},
    {"left_elbow", 16, {0.430, 0.455, -0.008}},
    {"right_elbow", 17, {-0.430, 0.455, -0.008}},
    {"left_wrist", 18, {0.670, 0.455, 0}},
    {"right_wrist", 19, {-0.670, 0.455, 0}},
    {"jaw", 15, {0, 0.632, 0.045}},
    {"left_eye", 15, {0.031, 0.671, 0.1075}},
    {"right_eye", 15, {-0.031, 0.671, 0.1075}},
    {"left_index1", 20, {0.7600, 0.4560, 0.0340}},
    {"left_index2", 25, {0.7950, 0.4535, 0.0380}},
    {"left_index3", 26, {0.8180, 0.4505, 0.0405}},
    {"left_middle1", 20, {0.7650, 0.4570, 0.0115}},
    {"left_middle2", 28, {0.8045, 0.4545, 0.0118}},
    {"left_middle3", 29, {0.8305, 0.4510, 0.0120}},
    {"left_pinky1", 20, {0.7480, 0.4540, -0.0310}},
    {"left_pinky2", 31, {0.7750, 0.4515, -0.0385}},
    {"left_pinky3", 32, {0.7930, 0.4490, -0.0435}},
    {"left_ring1", 20, {0.7595, 0.4560, -0.0105}},
    {"left_ring2", 34, {0.7955, 0.4535, -0.0140}},
    {"left_ring3", 35, {0.8195, 0.4505, -0.0162}},
    {"left_thumb1", 20, {0.6950, 0.4490, 0.0220}},
    {"left_thumb2", 37, {0.7190, 0.4410, 0.0520}},
    {"left_thumb3", 38, {0.7400, 0.4365, 0.0730}},
    {"right_index1", 21, {-0.7600, 0.4560, 0.0340}},
    {"right_index2", 40, {-0.7950, 0.4535, 0.0380}},
    {"right_index3", 41, {-0.8180, 0.4505, 0.0405}},
    {"right_middle1", 21, {-0.7650, 0.4570, 0.0115}},
    {"right_middle2", 43, {-0.8045, 0.4545, 0.0118}},
    {"right_middle3", 44, {-0.8305, 0.4510, 0.0120}},
    {"right_pinky1", 21, {-0.7480, 0.4540, -0.0310}},
    {"right_pinky2", 46, {-0.7750, 0.4515, -0.0385}},
    {"right_pinky3", 47, {-0.7930, 0.4490, -0.0435}},
    {"right_ring1", 21, {-0.7595, 0.4560, -0.0105}},
    {"right_ring2", 49, {-0.7955, 0.4535, -0.0140}},
    {"right_ring3", 50, {-0.8195, 0.4505, -0.0162}},
    {"right_thumb1", 21, {-0.6950, 0.4490, 0.0220}},
    {"right_thumb2", 52, {-0.7190, 0.4410, 0.0520}},
    {"right_thumb3", 53, {-0.7400, 0.4365, 0.0730}},
}};

[[nodiscard]] inline vec3<double> actor_joint(int joint) {
    const auto& p = actor_joints[static_cast<std::size_t>(joint)].position;
    return {p[0], p[1], p[2]};
}

/// End of the last bone of each left finger, in the joint order: index, middle, pinky, ring, thumb.
inline constexpr std::array<std::array<double, 3>, 5> actor_fingertips = {{
    {0.8370, 0.4470, 0.0425},
    {0.8510, 0.4470, 0.0122},
    {0.8075, 0.4465, -0.0475},
    {0.8390, 0.4470, -0.0180},
    {0.7600, 0.4330, 0.0900},
}};

/// The mouth: y where the lips meet, and ±x of its corners.
inline constexpr double actor_mouth_y = 0.6065, actor_mouth_corner_x = 0.0235;

} // namespace gsh
