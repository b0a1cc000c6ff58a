// SPDX-License-Identifier: Apache-2.0
/// @file  The learned places of landmarks on a body.
#pragma once

#include <array>
#include <string_view>

namespace gsh {

/// Where a landmark of the left side, or of the middle, lies. Its partner of the right side has x mirrored.
///
/// Source  bench/fit/learn_landmarks.cpp on 1,440 photographs of 30 filmed people of different shape,
///         clothes, shoes, hair and pose, in which MediaPipe 0.10.21 found the points. Spreads are at least 8 mm on the
///         body and 6 mm on hands and face, because detections err alike in neighbouring frames. OpenPose and COCO mark
///         the same places by their definition; neck and mid_hip are the means of shoulders and hips, and small_toe
///         lies at the tip of the toe.
struct LandmarkPlace {
    std::string_view name;
    int joint = 0;        ///< of smplx_joint_names
    bool sided = false;   ///< whether the right side has one, too
    double offset_mm[3]{}; ///< from the joint, at rest
    double spread_mm = 20; ///< the median distance of detections from the point, across the ray
};

inline constexpr std::array<LandmarkPlace, 49> landmark_places{{
    {"nose", 15, false, {0, 16, 102}, 14},
    {"eye_inner", 15, true, {14, 48, 82}, 14},
    {"eye", 15, true, {24, 48, 77}, 14},
    {"eye_outer", 15, true, {35, 48, 70}, 15},
    {"ear", 15, true, {50, 34, 25}, 14},
    {"mouth_corner", 15, true, {17, -17, 87}, 15},
    {"shoulder", 16, true, {-5, 4, -1}, 16},
    {"elbow", 18, true, {13, -2, 5}, 18},
    {"wrist", 20, true, {12, -4, 4}, 12},
    {"pinky_knuckle", 20, true, {85, -15, -4}, 13},
    {"index_knuckle", 20, true, {84, -23, 12}, 11},
    {"thumb_knuckle", 20, true, {61, -24, 17}, 12},
    {"hip", 1, true, {-9, -10, 22}, 25},
    {"knee", 4, true, {-4, -3, -2}, 19},
    {"ankle", 7, true, {0, 16, 0}, 13},
    {"heel", 7, true, {-2, -50, -34}, 17},
    {"big_toe", 10, true, {-18, -13, 41}, 20},
    {"small_toe", 10, true, {35, -12, 18}, 20},
    {"foot", 10, true, {-18, -13, 41}, 20},
    {"neck", 12, false, {0, -64, 11}, 20},
    {"mid_hip", 0, false, {0, -24, 13}, 25},
    {"hand_wrist", 20, true, {9, 0, 1}, 9},
    {"thumb1", 37, true, {-8, -11, 2}, 9},
    {"thumb2", 38, true, {4, -2, 4}, 9},
    {"thumb3", 39, true, {1, 1, -5}, 8},
    {"thumb_tip", 39, true, {15, -11, 6}, 6},
    {"index1", 25, true, {-8, -5, -5}, 7},
    {"index2", 26, true, {2, -6, 0}, 6},
    {"index3", 27, true, {1, -5, 0}, 6},
    {"index_tip", 27, true, {15, -13, 3}, 6},
    {"middle1", 28, true, {-5, -7, 0}, 6},
    {"middle2", 29, true, {1, -5, 2}, 6},
    {"middle3", 30, true, {-2, -4, 1}, 6},
    {"middle_tip", 30, true, {14, -10, 1}, 6},
    {"ring1", 34, true, {-5, -7, 1}, 6},
    {"ring2", 35, true, {2, -6, 1}, 6},
    {"ring3", 36, true, {0, -4, 0}, 6},
    {"ring_tip", 36, true, {15, -11, -3}, 6},
    {"pinky1", 31, true, {-6, -4, 3}, 7},
    {"pinky2", 32, true, {-1, -4, 0}, 6},
    {"pinky3", 33, true, {0, -3, -1}, 6},
    {"pinky_tip", 33, true, {11, -9, -5}, 6},
    {"face_nose", 15, false, {0, 3, 123}, 7},
    {"face_chin", 15, false, {1, -68, 88}, 8},
    {"face_forehead", 15, false, {0, 93, 97}, 7},
    {"face_eye_outer", 15, true, {41, 42, 80}, 6},
    {"face_eye_inner", 15, true, {16, 39, 89}, 6},
    {"face_mouth", 15, true, {21, -26, 95}, 6},
    {"face_cheek", 15, true, {69, 28, 21}, 10},
}};

} // namespace gsh
