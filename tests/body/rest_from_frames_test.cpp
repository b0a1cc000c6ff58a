// SPDX-License-Identifier: Apache-2.0
/// @file  A rest pose that is found in the frames gives nearly the motion that the real one gives.
#include <gsh/body/rest_from_frames.hpp>

#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

using namespace gsh;

namespace {

struct Warned {
    Motion motion;
    std::string warnings;
};
Warned retargeted(const RigMotion& rig) {
    std::vector<std::string> warnings;
    Warned result{retarget(rig, test::skeleton_body(), {}, {{}, "a.bvh", &warnings}), ""};
    for (const auto& warning : warnings) result.warnings += warning + "\n";
    return result;
}

double degrees_of(const mat3<double>& R) {
    return length(axis_angle_from_rotation(R)) * 57.295779513082323;
}

/// The largest angle in degrees between the world rotations of a joint in two motions.
double turned(const Motion& a, const Motion& b, const std::string& joint) {
    const auto j = static_cast<std::size_t>(smplx_joint(joint));
    double most = 0;
    for (std::size_t t = 0; t < a.frame_count(); ++t) {
        const auto x = test::pose_of(test::skeleton_body(), a, t), y = test::pose_of(test::skeleton_body(), b, t);
        most = std::max(most, degrees_of(transpose(x.rotations[j]) * y.rotations[j]));
    }
    return most;
}

/// Compares the motion of a rig with that of the same figure with a T as rest pose.
void check_like_a_rest_in_T(const test::SampleRig& sample, const RigMotion& rig, double trunk = 6, double limbs = 12) {
    const Motion wanted = retarget(test::rig_motion_of(sample), test::skeleton_body());
    const auto [found, warnings] = retargeted(rig);
    CHECK(warnings == test::contains("the rest pose"));
    CHECK(warnings != test::contains("backwards"));
    for (const std::string joint : {"pelvis", "spine3", "neck", "head"}) {
        CAPTURE(joint);
        CHECK(turned(found, wanted, joint) < trunk);
    }
    for (const std::string side : {"left_", "right_"})
        for (const char* joint : {"collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot"}) {
            CAPTURE(side + joint);
            CHECK(turned(found, wanted, side + joint) < limbs);
        }
    for (std::size_t t = 0; t < found.frame_count(); ++t) // directions of limbs are exact
        for (const std::string side : {"left_", "right_"})
            for (const auto& [from, to] :
                 {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}}) {
                const auto a = test::pose_of(test::skeleton_body(), found, t);
                const auto b = test::pose_of(sample, t, "XYZ");
                const auto own = [&](const char* joint) {
                    return a.joints[static_cast<std::size_t>(smplx_joint(side + joint))];
                };
                const auto source = [&](const char* joint) {
                    return b.joints[static_cast<std::size_t>(sample.joint(side + joint))];
                };
                CHECK(test::degrees_between(own(to) - own(from), source(to) - source(from)) < 1e-3);
            }
}

} // namespace

TEST_CASE("joints with x along their bones, as in LAFAN1, Bandai-Namco's data and files of Rokoko Studio") {
    for (const double yaw : {0.0, 2.0}) {
        const auto sample = test::walking_rig({}, 0, yaw);
        const RigMotion rig = test::rig_motion_of(sample);
        check_like_a_rest_in_T(sample, test::with_axes(rig, test::axes_along_bones(sample, {.arm_roll = 2.9})));
        check_like_a_rest_in_T(
            sample,
            test::with_axes(rig, test::axes_along_bones(
                                     sample, {.mirrored = true, .spine_roll = 1.5707963267948966, .arm_roll = 1})));
        check_like_a_rest_in_T(sample,
                               test::with_axes(rig, test::axes_along_bones(sample, {.spine_roll = 3.1415926535897932,
                                                                                    .hips_as_world = true})));
    }
}

TEST_CASE("a back that is bent in all frames stays bent, where joints have an axis along it") {
    const auto sample = test::walking_rig({}, 0.5);
    check_like_a_rest_in_T(sample, test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample)));
}

TEST_CASE("joints with any axes are placed by the frames") {
    const auto sample = test::walking_rig();
    test::Rng rng(11);
    std::vector<mat3<double>> axes;
    for (std::size_t j = 0; j < sample.names.size(); ++j) axes.push_back(rotation_from_axis_angle(rng.vec(-2, 2)));
    check_like_a_rest_in_T(sample, test::with_axes(test::rig_motion_of(sample), axes), 12, 20);
}

TEST_CASE("a rig that rests in a stride of its motion, with hips turned against shoulders") {
    const auto sample = test::walking_rig();
    RigMotion rig = test::rig_motion_of(sample);
    const auto J = static_cast<std::ptrdiff_t>(rig.joint_count());
    rig.rest_joints.assign(rig.joints.begin() + 7 * J, rig.joints.begin() + 8 * J);
    rig.rest_rotations.assign(rig.rotations.begin() + 7 * J, rig.rotations.begin() + 8 * J);
    check_like_a_rest_in_T(sample, rig);
}

TEST_CASE("fingers give the palm, a hand without fingers is as the forearm has it") {
    const auto sample = test::walking_rig({.fingers = true});
    const RigMotion heap =
        test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample, {.arm_roll = 2}));
    check_like_a_rest_in_T(sample, heap);
    const Motion wanted = retarget(test::rig_motion_of(sample), test::skeleton_body());
    const Motion found = retarget(heap, test::skeleton_body());
    CHECK(turned(found, wanted, "left_index1") < 15);
}

TEST_CASE("arms and legs that are never bent have no twist against the trunk") {
    auto sample = test::walking_rig();
    for (auto& angles : sample.angles)
        for (const std::string side : {"left_", "right_"})
            for (const char* joint : {"elbow", "knee", "ankle"})
                angles[static_cast<std::size_t>(sample.joint(side + joint))] = vec3<double>(0);
    const RigMotion heap =
        test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample, {.arm_roll = 2}));
    check_like_a_rest_in_T(sample, heap, 6, 15);
}

TEST_CASE("one frame is enough") {
    auto sample = test::walking_rig();
    sample.angles.resize(1), sample.root.resize(1);
    check_like_a_rest_in_T(sample, test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample)), 8, 20);
}

TEST_CASE("soles are level where a foot stands") {
    // Straight legs on the ground, feet that point up by 30 degrees while they are in the air.
    auto sample = test::walking_rig();
    for (std::size_t t = 0; t < sample.angles.size(); ++t) {
        for (auto& a : sample.angles[t]) a = vec3<double>(0);
        const bool flies = t % 8 >= 5;
        sample.root[t] = sample.rest[0] + vec3<double>(0, flies ? 0.3 : 0, 0);
        for (const std::string side : {"left_", "right_"}) {
            const auto at = [&](const char* joint) -> vec3<double>& {
                return sample.angles[t][static_cast<std::size_t>(sample.joint(side + joint))];
            };
            at("ankle") = {flies ? -0.5 : 0, 0, 0};
            at("shoulder") = {0, 0, side == "left_" ? -1.3 : 1.3};
        }
    }
    const RigMotion heap = test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample));
    const auto rest = rest_from_frames(heap, JointMap{}.match(heap, "a"), "a");
    for (const std::string side : {"left_", "right_"}) {
        const auto j = static_cast<std::size_t>(sample.joint(side + "ankle"));
        const mat3<double> turn = rest.rest_rotations[j] * transpose(heap.rotations[j]); // of frame 0, which stands
        CHECK(test::degrees_between(turn * vec3<double>(0, 1, 0), {0, 1, 0}) < 0.1);
    }
}

TEST_CASE("warned of: axes that are left-handed, and a body that is never upright") {
    const auto sample = test::walking_rig();
    RigMotion mirrored = test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample));
    std::swap(mirrored.names[static_cast<std::size_t>(sample.joint("left_hip"))],
              mirrored.names[static_cast<std::size_t>(sample.joint("right_hip"))]);
    for (const auto& [l, r] : {std::pair<std::string, std::string>{"left_knee", "right_knee"},
                               {"left_ankle", "right_ankle"},
                               {"left_foot", "right_foot"},
                               {"left_collar", "right_collar"},
                               {"left_shoulder", "right_shoulder"},
                               {"left_elbow", "right_elbow"},
                               {"left_wrist", "right_wrist"}})
        std::swap(mirrored.names[static_cast<std::size_t>(sample.joint(l))],
                  mirrored.names[static_cast<std::size_t>(sample.joint(r))]);
    CHECK(retargeted(mirrored).warnings == test::contains("backwards"));

    auto sits = sample;
    for (auto& angles : sits.angles)
        for (const char* joint : {"left_hip", "right_hip"})
            angles[static_cast<std::size_t>(sits.joint(joint))] = {-1.6, 0, 0};
    test::Rng rng(5);
    std::vector<mat3<double>> axes;
    for (std::size_t j = 0; j < sits.names.size(); ++j) axes.push_back(rotation_from_axis_angle(rng.vec(-2, 2)));
    CHECK(retargeted(test::with_axes(test::rig_motion_of(sits), axes)).warnings ==
          test::contains("no frame shows the body upright"));
    CHECK(retargeted(test::with_axes(test::rig_motion_of(sits), test::axes_along_bones(sits))).warnings !=
          test::contains("no frame"));
}

TEST_CASE("hips and shoulders that span no plane in any frame are refused") {
    RigMotion rig = test::rig_motion_of(test::walking_rig());
    for (auto* points : {&rig.rest_joints, &rig.joints})
        for (auto& x : *points) x = {0, x.y, 0};
    test::check_throws<ValueError>([&] { (void)rest_from_frames(rig, JointMap{}.match(rig, "a.bvh"), "a.bvh"); },
                                   {"a.bvh", "do not span a plane"});
}
