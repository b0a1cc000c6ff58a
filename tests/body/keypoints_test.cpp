// SPDX-License-Identifier: Apache-2.0
/// @file  Which joints a detector's points are, by the names that the detectors' own pages give them.
#include <gsh/body/keypoints.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The points of OpenPose's BODY_25 and of COCO, in their order.
constexpr std::array<std::string_view, 25> points_of_body_25{
    "Nose", "Neck",    "RShoulder", "RElbow", "RWrist",  "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee",   "RAnkle",    "LHip",   "LKnee",   "LAnkle",    "REye",   "LEye",   "REar",
    "LEar", "LBigToe", "LSmallToe", "LHeel",  "RBigToe", "RSmallToe", "RHeel"};
constexpr std::array<std::string_view, 17> points_of_coco{
    "Nose",   "LEye",   "REye", "LEar", "REar",  "LShoulder", "RShoulder", "LElbow", "RElbow",
    "LWrist", "RWrist", "LHip", "RHip", "LKnee", "RKnee",     "LAnkle",    "RAnkle"};

/// The joint at a point of that name; none at the hips, whose points lie on the skin.
std::string joint_at_point(std::string_view point) {
    for (const auto& [end, joint] :
         {std::pair{"Shoulder", "shoulder"}, std::pair{"Elbow", "elbow"}, std::pair{"Wrist", "wrist"},
          std::pair{"Knee", "knee"}, std::pair{"Ankle", "ankle"}})
        if (point.substr(1) == end) return std::string(point[0] == 'L' ? "left_" : "right_") + joint;
    return "";
}

BodyModel body_with_joints(std::vector<std::string> names) {
    BodyModel body;
    body.parents.assign(names.size(), -1);
    body.joint_names = std::move(names);
    return body;
}

} // namespace

TEST_CASE("points of BODY_25 and COCO are shoulders, elbows, wrists, knees and ankles, and no other joints") {
    for (std::size_t k = 0; k < points_of_body_25.size(); ++k) {
        CAPTURE(k);
        CHECK(openpose_joints[k] == joint_at_point(points_of_body_25[k]));
    }
    for (std::size_t k = 0; k < points_of_coco.size(); ++k) {
        CAPTURE(k);
        CHECK(coco_joints[k] == joint_at_point(points_of_coco[k]));
    }
    for (const auto& joints :
         {Span<const std::string_view>(openpose_joints), Span<const std::string_view>(coco_joints)})
        CHECK(std::count(joints.begin(), joints.end(), "") == static_cast<std::ptrdiff_t>(joints.size()) - 10);
}

TEST_CASE("points of a hand: the wrist, then three joints and the tip of each finger from the thumb on") {
    CHECK(hand_joints[0].empty());
    const std::array<std::string, 5> fingers{"thumb", "index", "middle", "ring", "pinky"};
    for (std::size_t f = 0; f < 5; ++f)
        for (std::size_t k = 1; k <= 4; ++k) {
            const std::string expected = k == 4 ? "" : fingers[f] + std::to_string(k);
            CHECK(hand_joints[4 * f + k] == expected);
            if (k < 4) CHECK(smplx_joint("left_" + expected) >= 0);
        }
}

TEST_CASE("joints of SMPL-X are found in a body by name, wherever they are, or not at all") {
    const std::vector<int> whole = joints_by_name(body_with_joints(std::vector<std::string>(55))),
                           smplh = joints_by_name(body_with_joints(std::vector<std::string>(52))),
                           smpl = joints_by_name(body_with_joints(std::vector<std::string>(24)));
    REQUIRE((whole.size() == 55 && smplh.size() == 55 && smpl.size() == 55));
    for (int j = 0; j < 55; ++j) {
        CAPTURE(j);
        const auto at = static_cast<std::size_t>(j);
        CHECK(whole[at] == j);
        CHECK(smplh[at] == (j < 22 ? j : j < 25 ? -1 : j - 3));
        CHECK(smpl[at] == (j < 22 ? j : -1)); // the joints of SMPL's hands are none of SMPL-X
    }

    const std::vector<int> own = joints_by_name(body_with_joints({"tail", "left_knee", "pelvis"}));
    CHECK(own[0] == 2);
    CHECK(own[static_cast<std::size_t>(smplx_joint("left_knee"))] == 1);
    CHECK(std::count(own.begin(), own.end(), -1) == 53);
    CHECK(joints_by_name(BodyModel{}) == std::vector<int>(55, -1));
}
