// SPDX-License-Identifier: Apache-2.0
/// @file  The axis that is up: where rest pose and frames agree, where only one shows it, where the ground decides.
#include <gsh/body/rig_up.hpp>

#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <string>

using namespace gsh;

namespace {

constexpr double quarter = 0.5 * std::numbers::pi;

RigMotion walk() {
    return test::rig_motion_of(test::walking_rig());
}

/// Turns the frames only, each by its own rotation about a point.
void turn_frames(RigMotion& rig, const std::function<mat3<double>(double)>& of,
                 const vec3<double>& about = vec3<double>(0)) {
    for (std::size_t i = 0; i < rig.joints.size(); ++i) {
        const mat3<double> R = of(static_cast<double>(i / rig.joint_count()));
        rig.joints[i] = R * (rig.joints[i] - about) + about;
        rig.rotations[i] = R * rig.rotations[i];
    }
}
void move_frames(RigMotion& rig, const vec3<double>& by) {
    for (auto& x : rig.joints) x += by;
}

RigUp up_of(const RigMotion& rig, bool rest_is_in_world = true) {
    return find_up(rig, JointMap{}.match(rig, "a rig"), rest_is_in_world);
}
void check_up(const RigMotion& rig, const std::string& axis, bool certain) {
    const RigUp up = up_of(rig);
    CHECK(up.axis.name() == axis);
    CHECK(up.doubt.empty() == certain);
}

} // namespace

TEST_CASE("where rest pose and frames stand along one axis, that axis is up") {
    for (int index = 0; index < 3; ++index)
        for (const int sign : {1, -1}) {
            RigMotion rig = walk();
            move_rig(rig, transpose(turn_to_y({index, sign})), 100);
            check_up(rig, SignedAxis{index, sign}.name(), true);
        }
}

TEST_CASE("the rest pose stands along y and the frames along z: the ground decides") {
    const mat3<double> z_up = test::turn_about(0, quarter);
    RigMotion rig = walk();
    turn_frames(rig, [&](double) { return z_up; });
    check_up(rig, "z", true);      // feet at z = 0; the way is along -y, under a ground at y = 0
    move_frames(rig, {0, 0, 0.7}); // no ground along either axis
    check_up(rig, "y", false);
    // A sleeper on the ground of a world with y up, whose head is towards z: the feet are at z = -0.9.
    RigMotion lying = walk();
    for (auto& x : lying.joints) x = {x.x, x.y - 0.96, 0};
    turn_frames(lying, [&](double) { return z_up; });
    move_frames(lying, {0, 0.1, 0});
    check_up(lying, "y", true);
}

TEST_CASE("the rest pose stands along z and the frames along y") {
    const mat3<double> z_up = test::turn_about(0, quarter);
    RigMotion rig = walk();
    move_rig(rig, z_up);
    turn_frames(rig, [&](double) { return transpose(z_up); });
    check_up(rig, "y", true); // it walks on the ground at y = 0
    move_frames(rig, {0, 0.7, 0});
    check_up(rig, "y", false);
    // A sleeper in a world with z up, whose head is towards y.
    RigMotion lying = walk();
    for (auto& x : lying.joints) x = {x.x, x.y - 0.96, 0.1};
    const auto frames = lying.joints;
    move_rig(lying, z_up);
    lying.joints = frames;
    check_up(lying, "z", true);
}

TEST_CASE("somersaults have no axis: the rest pose decides, with a doubt unless it is y") {
    const auto turning = [](double t) { return test::turn_about(0, 0.21 * t); };
    RigMotion dive = walk();
    turn_frames(dive, turning, {0, 0.9, 0.5});
    move_frames(dive, {0, 1.5, 0});
    check_up(dive, "y", true);
    for (const auto& [index, sign] : {std::pair{2, 1}, {2, -1}, {0, 1}}) {
        RigMotion other = dive;
        move_rig(other, transpose(turn_to_y({index, sign})));
        check_up(other, SignedAxis{index, sign}.name(), false);
    }
    // Cartwheels on a ground at z = 0, in a rig that rests along y.
    RigMotion wheel = walk();
    for (auto& x : wheel.joints) x.z = std::fmod(x.z, 0.01);
    turn_frames(wheel, [](double t) { return test::turn_about(2, 0.314 * t); }, {0, 0.9, 0});
    for (std::size_t t = 0; t < wheel.frame_count(); ++t) {
        double lowest = 1e9;
        for (std::size_t j = 0; j < wheel.joint_count(); ++j)
            lowest = std::min(lowest, wheel.joint(t, static_cast<int>(j)).y);
        for (std::size_t j = 0; j < wheel.joint_count(); ++j)
            wheel.joints[t * wheel.joint_count() + j].y -= lowest - 0.02;
    }
    check_up(wheel, "y", true);
    for (auto& x : wheel.joints) x = test::turn_about(0, quarter) * x;
    for (auto& x : wheel.joints) x.y -= 0.4;
    check_up(wheel, "z", true);
}

TEST_CASE("a rest pose that is none, or that is not of the world, does not count") {
    const auto sample = test::walking_rig();
    RigMotion heap = test::with_axes(test::rig_motion_of(sample), test::axes_along_bones(sample));
    check_up(heap, "y", true);
    move_rig(heap, test::turn_about(0, quarter));
    check_up(heap, "z", true);
    RigMotion skin = walk();
    for (auto& x : skin.rest_joints) x = test::turn_about(0, quarter) * x;
    CHECK(up_of(skin, false).axis.name() == "y");
    CHECK(up_of(skin, false).doubt.empty());
}

TEST_CASE("without frames, hips or shoulders y is up") {
    RigMotion rig = walk();
    move_rig(rig, test::turn_about(0, quarter));
    MatchedJoints matched = JointMap{}.match(rig, "a rig");
    matched[static_cast<std::size_t>(smplx_joint("left_hip"))] = -1;
    CHECK(find_up(rig, matched).axis == SignedAxis{});
    rig.joints.clear(), rig.rotations.clear(), rig.timestamps.clear();
    CHECK(find_up(rig, JointMap{}.match(rig, "a rig")).axis == SignedAxis{});
}
