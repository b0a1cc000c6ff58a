// SPDX-License-Identifier: Apache-2.0
/// @file  Which landmarks a detector's points are, by the names that the detectors' own pages give them.
#include <gsh/body/landmarks.hpp>

#include <doctest/doctest.h>

#include <array>
#include <cctype>
#include <cstddef>
#include <set>
#include <string>
#include <string_view>
#include <utility>

using namespace gsh;

namespace {

/// The points of OpenPose's BODY_25 and of COCO, and MediaPipe's of the pose, in their order.
constexpr std::array<std::string_view, 25> points_of_body_25{
    "Nose", "Neck",    "RShoulder", "RElbow", "RWrist",  "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee",   "RAnkle",    "LHip",   "LKnee",   "LAnkle",    "REye",   "LEye",   "REar",
    "LEar", "LBigToe", "LSmallToe", "LHeel",  "RBigToe", "RSmallToe", "RHeel"};
constexpr std::array<std::string_view, 17> points_of_coco{
    "Nose",   "LEye",   "REye", "LEar", "REar",  "LShoulder", "RShoulder", "LElbow", "RElbow",
    "LWrist", "RWrist", "LHip", "RHip", "LKnee", "RKnee",     "LAnkle",    "RAnkle"};
constexpr std::array<std::string_view, 33> points_of_mediapipe{
    "Nose",   "LEyeInner", "LEye",      "LEyeOuter", "REyeInner",  "REye",      "REyeOuter", "LEar",   "REar",
    "LMouth", "RMouth",    "LShoulder", "RShoulder", "LElbow",     "RElbow",    "LWrist",    "RWrist", "LPinky",
    "RPinky", "LIndex",    "RIndex",    "LThumb",    "RThumb",     "LHip",      "RHip",      "LKnee",  "RKnee",
    "LAnkle", "RAnkle",    "LHeel",     "RHeel",     "LFootIndex", "RFootIndex"};

/// "left_big_toe" of "LBigToe".
std::string landmark_at_point(std::string_view point) {
    static const std::array<std::pair<std::string_view, std::string_view>, 5> own_names{{{"Mouth", "mouth_corner"},
                                                                                         {"Pinky", "pinky_knuckle"},
                                                                                         {"Index", "index_knuckle"},
                                                                                         {"Thumb", "thumb_knuckle"},
                                                                                         {"FootIndex", "foot"}}};
    std::string side;
    if ((point[0] == 'L' || point[0] == 'R') && std::isupper(static_cast<unsigned char>(point[1])))
        side = point[0] == 'L' ? "left_" : "right_", point.remove_prefix(1);
    for (const auto& [theirs, ours] : own_names)
        if (point == theirs) return side + std::string(ours);
    std::string name;
    for (const char c : point) {
        if (std::isupper(static_cast<unsigned char>(c)) && !name.empty()) name += '_';
        name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    }
    return side + name;
}

} // namespace

TEST_CASE("points of BODY_25, COCO and MediaPipe are the landmarks of their names") {
    const auto check = [](const auto& landmarks, const auto& points) {
        REQUIRE(landmarks.size() == points.size());
        for (std::size_t k = 0; k < points.size(); ++k) {
            CAPTURE(points[k]);
            CHECK(landmark_name(landmarks[k]) == landmark_at_point(points[k]));
        }
    };
    check(openpose_landmarks, points_of_body_25);
    check(coco_landmarks, points_of_coco);
    check(mediapipe_pose_landmarks, points_of_mediapipe);
}

TEST_CASE("points of a hand: the wrist, then three joints and the tip of each finger from the thumb on") {
    static constexpr Landmarks marks = default_landmarks();
    CHECK(landmark_name(left_hand_landmarks[0]) == "left_hand_wrist");
    const std::array<std::string, 5> fingers{"thumb", "index", "middle", "ring", "pinky"};
    for (std::size_t f = 0; f < 5; ++f)
        for (std::size_t k = 1; k <= 4; ++k) {
            const std::string joint = "left_" + fingers[f];
            const int landmark = left_hand_landmarks[4 * f + k];
            CHECK(landmark_name(landmark) == joint + (k == 4 ? "_tip" : std::to_string(k)));
            CHECK(marks[static_cast<std::size_t>(landmark)].joint ==
                  smplx_joint(joint + std::to_string(k == 4 ? 3 : k)));
        }
}

TEST_CASE("landmarks have numbers, names and partners of the other side at the mirrored place") {
    static constexpr Landmarks marks = default_landmarks();
    std::set<std::string> names;
    for (std::size_t row = 0; row < landmark_places.size(); ++row) {
        const int left = static_cast<int>(2 * row), right = left + 1;
        CAPTURE(landmark_name(left));
        CHECK(names.insert(landmark_name(left)).second);
        CHECK(landmark_number(landmark_name(left)) == left);
        const Landmark &a = marks[2 * row], &b = marks[2 * row + 1];
        CHECK((a.spread >= 0.006 && a.spread < 0.05));
        CHECK(length(a.offset) < 0.2);
        if (!landmark_places[row].sided) {
            CHECK(mirrored_landmark(left) == left);
            CHECK(std::abs(a.offset.x) < 0.002); // in the middle
            continue;
        }
        CHECK(mirrored_landmark(left) == right);
        CHECK(mirrored_landmark(right) == left);
        CHECK(landmark_number(landmark_name(right)) == right);
        CHECK(b.joint == mirrored_smplx_joint(a.joint));
        CHECK(b.offset == vec3<double>(-a.offset.x, a.offset.y, a.offset.z));
    }
    CHECK(landmark_number("tail") == -1);
    CHECK(landmark_number("left_nose") == -1); // in the middle
    CHECK(landmark_number("elbow") == -1);     // of which side?
}

TEST_CASE("joints of SMPL-X mirror onto joints of the other side's name") {
    for (std::size_t j = 0; j < smplx_joint_names.size(); ++j) {
        std::string name(smplx_joint_names[j]);
        if (name.starts_with("left_"))
            name.replace(0, 4, "right");
        else if (name.starts_with("right_"))
            name.replace(0, 5, "left");
        CHECK(mirrored_smplx_joint(static_cast<int>(j)) == smplx_joint(name));
    }
}

TEST_CASE("a body's landmarks are on its own joints, or missing") {
    BodyModel body;
    body.parents = {-1, 0};
    body.joint_names = {"pelvis", "left_knee"};
    const Landmarks marks = landmarks_of(body);
    CHECK(marks[static_cast<std::size_t>(landmark_number("left_knee"))].joint == 1);
    CHECK(marks[static_cast<std::size_t>(landmark_number("right_knee"))].joint == -1);
    CHECK(marks[static_cast<std::size_t>(landmark_number("mid_hip"))].joint == 0);
}
