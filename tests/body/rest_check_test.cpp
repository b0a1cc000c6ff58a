// SPDX-License-Identifier: Apache-2.0
/// @file  Rest poses of standing people have no fault; heaps of bones and frames of the motion have one each.
#include <gsh/body/rest_check.hpp>

#include "support/contains.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <string>

using namespace gsh;

namespace {

std::string fault_of(const RigMotion& rig) {
    return rest_pose_fault(rig, JointMap{}.match(rig, "a rig")).value_or("none");
}

/// A rig whose rest pose is a frame.
RigMotion rests_in(RigMotion rig, std::size_t frame) {
    const auto first = static_cast<std::ptrdiff_t>(frame * rig.joint_count()),
               last = first + static_cast<std::ptrdiff_t>(rig.joint_count());
    rig.rest_joints.assign(rig.joints.begin() + first, rig.joints.begin() + last);
    rig.rest_rotations.assign(rig.rotations.begin() + first, rig.rotations.begin() + last);
    return rig;
}

} // namespace

TEST_CASE("T, A, arms down and every facing are poses of a standing person") {
    for (const auto rest : {test::Rest::T, test::Rest::A, test::Rest::down})
        for (const double turn : {0.0, 0.8, 3.1}) {
            CHECK(fault_of(test::rig_motion_of(test::walking_rig({.rest = rest, .turn = turn}))) == "none");
            CHECK(fault_of(test::rig_motion_of(test::walking_rig({.rest = rest, .z_up = true, .turn = turn}))) ==
                  "none");
        }
}

TEST_CASE("zero angles of joints that lie along their bones are a heap") {
    const auto sample = test::walking_rig();
    const RigMotion rig = test::rig_motion_of(sample);
    CHECK(fault_of(test::with_axes(rig, test::axes_along_bones(sample))) == test::contains("thighs along the spine"));
    CHECK(fault_of(test::with_axes(rig, test::axes_along_bones(sample, {.mirrored = true, .spine_roll = 1.57}))) !=
          "none");
    CHECK(fault_of(test::with_axes(rig, test::axes_along_bones(sample, {.hips_as_world = true}))) != "none");
    // Legs and trunk with the axes of the world, arms along their bones: both arms point to the left.
    auto arms = test::axes_along_bones(sample);
    for (std::size_t j = 0; j < arms.size(); ++j)
        if (sample.parts[j].find("shoulder") == std::string::npos && sample.parts[j].find("elbow") == std::string::npos)
            arms[j] = mat3<double>(1.0);
    CHECK(fault_of(test::with_axes(rig, arms)) == test::contains("left and right"));
}

TEST_CASE("a stride at rest is named with its frame, a stance like a rest pose is not") {
    const RigMotion rig = test::rig_motion_of(test::walking_rig());
    CHECK(fault_of(rests_in(rig, 2)) == "is that of frame 2, no neutral one");     // where the legs begin to part
    CHECK(fault_of(rests_in(rig, 7)) == test::contains("left and right"));         // where they are far apart
    CHECK(fault_of(rests_in(rig, 0)) == "none");                                   // where they are together
    // A pose that is not in the motion has wider limits.
    RigMotion other = rests_in(rig, 2);
    for (std::size_t j = 0; j < rig.joint_count(); ++j)
        other.rest_rotations[j] = other.rest_rotations[j] * test::turn_about(0, 0.1 * static_cast<double>(j));
    CHECK(fault_of(other) == "none");
}

TEST_CASE("hips and shoulders that span no plane are a fault, rigs without them are not looked at") {
    RigMotion rig = test::rig_motion_of(test::walking_rig());
    for (auto& x : rig.rest_joints) x = {0, x.y, 0};
    CHECK(fault_of(rig) == test::contains("span no plane"));
    for (const char* joint : {"left_elbow", "right_knee", "left_hip"}) {
        const auto sample = test::walking_rig();
        const RigMotion heap = test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample));
        MatchedJoints matched = JointMap{}.match(heap, "a rig");
        matched[static_cast<std::size_t>(smplx_joint(joint))] = -1;
        CHECK(!rest_pose_fault(heap, matched));
    }
    RigMotion few;
    few.names = {"Hips"}, few.parents = {-1}, few.rest_joints = {vec3<double>(0)};
    CHECK(fault_of(few) == "none");
}
