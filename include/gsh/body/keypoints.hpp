// SPDX-License-Identifier: Apache-2.0
/// @file  Keypoints that a detector found in a photograph, and which joints they are.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh {

/// A joint as a detector sees it.
struct Keypoint {
    int joint = -1;         ///< of smplx_joint_names; of another body, the joint of that name
    vec2<double> pixel{0};  ///< the first pixel's centre is (0.5, 0.5)
    double confidence = 0;  ///< in [0, 1]
};

/// What a detector found in one photograph: the keypoints of each person, in no order.
struct PhotoKeypoints {
    std::size_t camera = 0, frame = 0;
    std::vector<std::vector<Keypoint>> people;
};

/// The joints of a detector's points, by name; empty where a point is no joint of the body. OpenPose's points are those
/// of BODY_25. Eyes and ears, heels and toes are no joints. Hips are left out: detectors put them on the skin, several
/// centimetres from the joint. Points of a hand begin at the wrist, which the body's points have, too, and end at
/// finger tips, which are no joints.
inline constexpr std::array<std::string_view, 25> openpose_joints{
    "", "", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "", "", "right_knee",     "right_ankle", "",            "left_knee",     "left_ankle"}; // the rest are empty
inline constexpr std::array<std::string_view, 17> coco_joints{
    "",           "",            "",           "",           "",         "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "",        "",              "left_knee",
    "right_knee", "left_ankle",  "right_ankle"};
inline constexpr std::array<std::string_view, 21> hand_joints{
    "",        "thumb1", "thumb2", "thumb3", "", "index1", "index2", "index3", "", "middle1", "middle2",
    "middle3", "",       "ring1",  "ring2",  "ring3", "",  "pinky1", "pinky2", "pinky3", ""};

/// The joint of each of smplx_joint_names in a body, or -1.
[[nodiscard]] inline std::vector<int> joints_by_name(const BodyModel& body) {
    const std::vector<std::string> names = joint_names_of(body);
    std::vector<int> joints;
    for (const std::string_view name : smplx_joint_names) {
        int found = -1;
        for (std::size_t j = 0; j < names.size(); ++j)
            if (names[j] == name) found = static_cast<int>(j);
        joints.push_back(found);
    }
    return joints;
}

} // namespace gsh
