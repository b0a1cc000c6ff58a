// SPDX-License-Identifier: Apache-2.0
/// @file  Heights of ankles from rest poses, toes and frames; bodies of other proportions stand on the ground.
#include <gsh/body/ankle_height.hpp>

#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>

#include <algorithm>
#include <cmath>
#include <string>

using namespace gsh;

namespace {

/// A figure that stands. Its ankles are 0.09 m above y = 0 and its toes 0.02 m, times `size`.
RigMotion standing(double size = 1, bool toes = true) {
    auto sample = test::walking_rig({.toes = toes, .size = size});
    for (std::size_t t = 0; t < sample.angles.size(); ++t) {
        for (auto& a : sample.angles[t]) a = vec3<double>(0);
        sample.root[t] = sample.rest[0];
    }
    return test::rig_motion_of(sample);
}
void lift(std::vector<vec3<double>>& points, double by) {
    for (auto& x : points) x.y += by;
}
/// Shortens the legs above the ankles: a figure of a game.
void shorten(RigMotion& rig) {
    const auto matched = JointMap{}.match(rig, "a rig");
    for (auto* points : {&rig.rest_joints, &rig.joints})
        for (std::size_t i = 0; i < points->size(); ++i) {
            const int j = static_cast<int>(i % rig.joint_count());
            bool foot = false, knee = false;
            for (const std::string side : {"left_", "right_"}) {
                const auto is = [&](const char* joint) {
                    return matched[static_cast<std::size_t>(smplx_joint(side + joint))] == j;
                };
                foot = foot || is("ankle") || is("foot"), knee = knee || is("knee");
            }
            (*points)[i].y -= foot ? 0 : knee ? 0.3 : 0.55;
        }
}
double height_of(const RigMotion& rig, bool rest_has_place = true) {
    return ankle_height(rig, rig, JointMap{}.match(rig, "a rig"), rest_has_place).value_or(-1);
}
/// The median height of the body's lower ankle.
double body_stands_at(const RigMotion& rig) {
    const Motion motion = retarget(rig, test::skeleton_body());
    std::vector<double> lower;
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        const auto pose = test::pose_of(test::skeleton_body(), motion, t);
        lower.push_back(std::min(pose.joints[static_cast<std::size_t>(smplx_joint("left_ankle"))].y,
                                 pose.joints[static_cast<std::size_t>(smplx_joint("right_ankle"))].y));
    }
    std::sort(lower.begin(), lower.end());
    return lower[lower.size() / 2];
}
double own_height() {
    const auto& joints = test::skeleton_body().v_template;
    MatchedJoints all;
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = static_cast<int>(k);
    return ankle_height(joints, joints, all);
}

} // namespace

TEST_CASE("ankles are as high as the rest pose, the toes and the frames show") {
    CHECK(height_of(standing()) == doctest::Approx(0.09));
    RigMotion sunk = standing();
    lift(sunk.joints, -0.02);
    CHECK(height_of(sunk) == doctest::Approx(0.09));
    RigMotion box = standing();
    lift(box.joints, 0.4);
    CHECK(height_of(box) == doctest::Approx(0.09)); // it stands on a box
    RigMotion below = standing();
    lift(below.rest_joints, -0.96); // as with a ROOT whose OFFSET is 0
    CHECK(height_of(below) == doctest::Approx(0.09));
    lift(below.joints, -0.02);
    CHECK(height_of(below) == doctest::Approx(0.07)); // where the frames have the ground
    CHECK(height_of(standing(), false) == doctest::Approx(0.09));
    lift(below.joints, -0.94); // neither is on a ground: the toes are 0.07 m below the ankles
    CHECK(height_of(below) == doctest::Approx(0.07 + 0.03 * 0.84).epsilon(0.02)); // and 3 % of the leg above the sole
    RigMotion bare = standing(1, false);
    CHECK(height_of(bare) == doctest::Approx(0.09));
    for (auto* points : {&bare.rest_joints, &bare.joints}) lift(*points, -0.96);
    CHECK(height_of(bare) == -1);
}

TEST_CASE("a body stands on the ground on which a figure with short legs and high ankles stands") {
    RigMotion rig = standing();
    shorten(rig);
    CHECK(std::abs(body_stands_at(rig) - own_height()) < 0.01);
    lift(rig.rest_joints, -0.4); // by the frames alone
    CHECK(std::abs(body_stands_at(rig) - own_height()) < 0.01);
    CHECK(std::abs(body_stands_at(standing()) - own_height()) < 0.01);
    CHECK(std::abs(body_stands_at(standing(0.5)) - own_height()) < 0.01);
}

TEST_CASE("the hips' way is the source's times one factor, whatever is added to their height") {
    RigMotion rig = test::rig_motion_of(test::walking_rig());
    shorten(rig);
    const Motion motion = retarget(rig, test::skeleton_body());
    const double factor = length(motion.transl[39] - motion.transl[0]) / length(rig.joint(39, 0) - rig.joint(0, 0));
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        CHECK(length((motion.transl[t] - motion.transl[0]) - (rig.joint(t, 0) - rig.joint(0, 0)) * factor) < 1e-9);
}

TEST_CASE("the same skeleton keeps its place exactly") {
    const Motion walk = retarget(test::rig_motion_of(test::walking_rig()), test::skeleton_body());
    Motion sunk = walk;
    for (auto& x : sunk.transl) x.y -= 0.05;
    const Motion back = retarget(rig_of_motion(test::skeleton_body(), sunk), test::skeleton_body());
    for (std::size_t t = 0; t < walk.frame_count(); ++t) CHECK(length(back.transl[t] - sunk.transl[t]) < 1e-9);
}
