// SPDX-License-Identifier: Apache-2.0
/// @file  The points of a person that detectors find: their places on a body, and their order in each detector.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmark_table.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A point of a person that a detector marks, such as the left elbow. On the body at rest it lies at J + offset, J
/// being the place of its joint, and it moves with the joint.
///
/// Frame   the canonical frame.
/// Units   metres.
struct Landmark {
    int joint = 0; ///< of smplx_joint_names
    vec3<double> offset{0};
    double spread = 0.02; ///< the median distance of detections from the point, across the ray
};

/// Landmarks have a number: twice the row of landmark_places, and one more on the right side.
using Landmarks = std::array<Landmark, 2 * landmark_places.size()>;

/// The learned places of all landmarks. Numbers of a right side that does not exist repeat the middle.
[[nodiscard]] constexpr Landmarks default_landmarks() {
    Landmarks result{};
    for (std::size_t row = 0; row < landmark_places.size(); ++row) {
        const LandmarkPlace& place = landmark_places[row];
        for (std::size_t right = 0; right < 2; ++right) {
            const bool mirrored = right == 1 && place.sided;
            Landmark& mark = result[2 * row + right];
            mark.joint = mirrored ? mirrored_smplx_joint(place.joint) : place.joint;
            mark.offset = {(mirrored ? -1e-3 : 1e-3) * place.offset_mm[0], 1e-3 * place.offset_mm[1],
                           1e-3 * place.offset_mm[2]};
            mark.spread = 1e-3 * place.spread_mm;
        }
    }
    return result;
}

/// The number of a landmark: "nose", "left_elbow". -1 for a name that none has.
[[nodiscard]] constexpr int landmark_number(std::string_view name) {
    const bool left = name.starts_with("left_"), right = name.starts_with("right_");
    const std::string_view place = left ? name.substr(5) : right ? name.substr(6) : name;
    for (std::size_t row = 0; row < landmark_places.size(); ++row)
        if (landmark_places[row].name == place && landmark_places[row].sided == (left || right))
            return static_cast<int>(2 * row + (right ? 1 : 0));
    return -1;
}
[[nodiscard]] inline std::string landmark_name(int number) {
    const LandmarkPlace& place = landmark_places[static_cast<std::size_t>(number / 2)];
    return (place.sided ? number % 2 ? "right_" : "left_" : "") + std::string(place.name);
}
/// The landmark of the other side, or the same in the middle.
[[nodiscard]] constexpr int mirrored_landmark(int number) {
    return landmark_places[static_cast<std::size_t>(number / 2)].sided ? number ^ 1 : number;
}

/// The places of landmarks on a body with the joints of SMPL-X by name: `joint` becomes the body's, or -1.
[[nodiscard]] inline Landmarks landmarks_of(const BodyModel& body, Landmarks marks = default_landmarks()) {
    const std::vector<int> joints = joints_by_name(body);
    for (Landmark& mark : marks) mark.joint = joints[static_cast<std::size_t>(mark.joint)];
    return marks;
}

/// The landmarks of a detector's points in their order; -1 where a point is no landmark.
///
/// OpenPose's points are those of BODY_25. Hands are listed once, for the left side: wrist, thumb, index, middle, ring
/// and little finger, each finger from its knuckle to its tip.
template <std::size_t Count>
using LandmarkList = std::array<int, Count>;

namespace detail {

template <std::size_t Count>
[[nodiscard]] constexpr LandmarkList<Count> numbered(const std::string_view (&names)[Count]) {
    LandmarkList<Count> result{};
    for (std::size_t k = 0; k < Count; ++k) {
        result[k] = names[k].empty() ? -1 : landmark_number(names[k]);
        if (result[k] < 0 && !names[k].empty()) throw "no such landmark"; // at compile time
    }
    return result;
}

} // namespace detail

inline constexpr LandmarkList<33> mediapipe_pose_landmarks = detail::numbered<33>({"nose",
                                                                                   "left_eye_inner",
                                                                                   "left_eye",
                                                                                   "left_eye_outer",
                                                                                   "right_eye_inner",
                                                                                   "right_eye",
                                                                                   "right_eye_outer",
                                                                                   "left_ear",
                                                                                   "right_ear",
                                                                                   "left_mouth_corner",
                                                                                   "right_mouth_corner",
                                                                                   "left_shoulder",
                                                                                   "right_shoulder",
                                                                                   "left_elbow",
                                                                                   "right_elbow",
                                                                                   "left_wrist",
                                                                                   "right_wrist",
                                                                                   "left_pinky_knuckle",
                                                                                   "right_pinky_knuckle",
                                                                                   "left_index_knuckle",
                                                                                   "right_index_knuckle",
                                                                                   "left_thumb_knuckle",
                                                                                   "right_thumb_knuckle",
                                                                                   "left_hip",
                                                                                   "right_hip",
                                                                                   "left_knee",
                                                                                   "right_knee",
                                                                                   "left_ankle",
                                                                                   "right_ankle",
                                                                                   "left_heel",
                                                                                   "right_heel",
                                                                                   "left_foot",
                                                                                   "right_foot"});

inline constexpr LandmarkList<25> openpose_landmarks = detail::numbered<25>(
    {"nose",       "neck",          "right_shoulder",  "right_elbow", "right_wrist", "left_shoulder", "left_elbow",
     "left_wrist", "mid_hip",       "right_hip",       "right_knee",  "right_ankle", "left_hip",      "left_knee",
     "left_ankle", "right_eye",     "left_eye",        "right_ear",   "left_ear",    "left_big_toe",  "left_small_toe",
     "left_heel",  "right_big_toe", "right_small_toe", "right_heel"});

inline constexpr LandmarkList<17> coco_landmarks =
    detail::numbered<17>({"nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder",
                          "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip",
                          "left_knee", "right_knee", "left_ankle", "right_ankle"});

inline constexpr LandmarkList<6> coco_foot_landmarks = detail::numbered<6>(
    {"left_big_toe", "left_small_toe", "left_heel", "right_big_toe", "right_small_toe", "right_heel"});

inline constexpr LandmarkList<21> left_hand_landmarks = detail::numbered<21>(
    {"left_hand_wrist", "left_thumb1", "left_thumb2",    "left_thumb3",  "left_thumb_tip", "left_index1",
     "left_index2",     "left_index3", "left_index_tip", "left_middle1", "left_middle2",   "left_middle3",
     "left_middle_tip", "left_ring1",  "left_ring2",     "left_ring3",   "left_ring_tip",  "left_pinky1",
     "left_pinky2",     "left_pinky3", "left_pinky_tip"});

/// A point of a face's mesh or contour, and its landmark: those few that lie firm on the skull.
struct FacePoint {
    std::size_t point = 0;
    int landmark = -1;
};
inline constexpr std::array<FacePoint, 11> mediapipe_face_landmarks{{
    // of 478
    {1, landmark_number("face_nose")},
    {152, landmark_number("face_chin")},
    {10, landmark_number("face_forehead")},
    {263, landmark_number("left_face_eye_outer")},
    {33, landmark_number("right_face_eye_outer")},
    {362, landmark_number("left_face_eye_inner")},
    {133, landmark_number("right_face_eye_inner")},
    {291, landmark_number("left_face_mouth")},
    {61, landmark_number("right_face_mouth")},
    {454, landmark_number("left_face_cheek")},
    {234, landmark_number("right_face_cheek")},
}};
inline constexpr std::array<FacePoint, 8> face68_landmarks{{
    // of the 68 of iBUG, which COCO-WholeBody and OpenPose have
    {30, landmark_number("face_nose")},
    {8, landmark_number("face_chin")},
    {45, landmark_number("left_face_eye_outer")},
    {36, landmark_number("right_face_eye_outer")},
    {42, landmark_number("left_face_eye_inner")},
    {39, landmark_number("right_face_eye_inner")},
    {54, landmark_number("left_face_mouth")},
    {48, landmark_number("right_face_mouth")},
}};

} // namespace gsh
