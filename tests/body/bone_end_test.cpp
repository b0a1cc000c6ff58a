// SPDX-License-Identifier: Apache-2.0
/// @file  Ends of hands: found by name, believed if the hand is straight in the frames.
#include <gsh/body/bone_end.hpp>

#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>

#include <string>

using namespace gsh;

namespace {

/// A walk in which the left hand has a leaf at `end` from the wrist in the rest pose, a T; hands are turned by `turn`.
RigMotion with_end(const vec3<double>& end, const vec3<double>& turn = vec3<double>(0),
                   const std::string& name = "LeftHand_end") {
    auto sample = test::walking_rig();
    const int wrist = sample.joint("left_wrist");
    sample.names.push_back(name), sample.parts.emplace_back(), sample.parents.push_back(wrist);
    sample.rest.push_back(sample.rest[static_cast<std::size_t>(wrist)] + end);
    for (auto& angles : sample.angles) angles[static_cast<std::size_t>(wrist)] = turn, angles.emplace_back(0.0);
    return test::rig_motion_of(sample);
}
int end_in(const RigMotion& rig) {
    return hand_end(rig, rig, JointMap{}.match(rig, "a rig"), "left_");
}
/// The largest angle between the body's hand and the direction to the rig's end.
double hand_error(const RigMotion& rig) {
    const Motion motion = retarget(rig, test::skeleton_body());
    const auto matched = JointMap{}.match(rig, "a rig");
    const int wrist = matched[static_cast<std::size_t>(smplx_joint("left_wrist"))],
              end = static_cast<int>(rig.joint_count()) - 1;
    double most = 0;
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        const auto pose = test::pose_of(test::skeleton_body(), motion, t);
        most =
            std::max(most, test::degrees_between(pose.joints[static_cast<std::size_t>(smplx_joint("left_middle1"))] -
                                                     pose.joints[static_cast<std::size_t>(smplx_joint("left_wrist"))],
                                                 rig.joint(t, end) - rig.joint(t, wrist)));
    }
    return most;
}

} // namespace

TEST_CASE("a hand that hangs at rest and is straight in the frames follows its end") {
    const RigMotion rig = with_end({0, -0.17, 0}, {0, 0, 1.5707963267948966});
    CHECK(end_in(rig) == static_cast<int>(rig.joint_count()) - 1);
    CHECK(hand_error(rig) < 1e-4);
    CHECK(hand_error(with_end({0.16, -0.03, 0.03})) < 1e-4); // nearly in line
}

TEST_CASE("an end of a fixed direction, a short one and a joint of another name do not turn the hand") {
    CHECK(end_in(with_end({0, 0.17, 0})) ==
          -1); // as some programs write for each leaf; the hand is straight without it
    CHECK(end_in(with_end({0.05, 0, 0})) == -1);
    CHECK(end_in(with_end({0.17, 0, 0}, {}, "Sword")) == -1);
    RigMotion two = with_end({0.17, 0, 0});
    two.names.emplace_back("LeftThumbTip"), two.parents.push_back(two.parents.back());
    two.rest_joints.push_back(two.rest_joints.back());
    CHECK(end_of(two, two.parents.back()) == -1);
    CHECK(end_of(two, -1) == -1);
}

TEST_CASE("ends are known by their names") {
    for (const char* name : {"LeftHand_end", "LeftHandEnd", "ENDSITE", "hand_tip_l", "Bip01 L HandNub", "EndEffector"})
        CHECK(end_in(with_end({0.17, 0, 0}, {}, name)) >= 0);
}
