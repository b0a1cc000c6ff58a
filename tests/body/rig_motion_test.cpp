// SPDX-License-Identifier: Apache-2.0
/// @file  Rigs: validation, moves to other worlds, and the rig of a body's motion.

#include "io/temporary.hpp"
#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/body/rig_motion.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <functional>
#include <limits>

using namespace gsh;

namespace {

Motion motion_of_body() {
    Motion motion = actor_motion(ActorMotion::reach, 4);
    motion.expression_count = 0, motion.expression.clear();
    motion.betas = {0.5};
    return motion;
}

} // namespace

TEST_CASE("the rig of a body's motion has its posed joints, as products along the tree say") {
    const BodyModel& body = test::skeleton_body();
    const Motion motion = motion_of_body();
    const RigMotion rig = rig_of_motion(body, motion);
    validate(rig, "the rig");
    CHECK(rig.names[4] == "left_knee");
    for (std::size_t t = 0; t < 4; ++t) {
        const auto pose = test::pose_of(body, motion, t);
        for (int j = 0; j < 55; ++j) {
            CHECK(length(rig.joint(t, j) - pose.joints[static_cast<std::size_t>(j)]) < 1e-12);
            CHECK(rig.rotation(t, j) == pose.rotations[static_cast<std::size_t>(j)]);
        }
    }
}

TEST_CASE("a moved rig is the same rig elsewhere") {
    RigMotion rig = rig_of_motion(test::skeleton_body(), motion_of_body());
    const RigMotion before = rig;
    const mat3<double> A = test::turn_about(0, 0.7) * test::turn_about(2, 1.2);
    move_rig(rig, A, 100);
    CHECK(length(rig.joint(2, 7) - A * before.joint(2, 7) * 100.0) < 1e-9);
    const auto turn = [](const RigMotion& r) { return r.rotation(3, 9) * transpose(r.rest_rotations[9]); };
    const mat3<double> difference = A * turn(before) * transpose(A) - turn(rig);
    for (int c = 0; c < 3; ++c) CHECK(length(difference[c]) < 1e-12);
    test::check_throws<ValueError>([&] { move_rig(rig, mat3<double>(2.0)); }, {"rotation"});
}

TEST_CASE("every inconsistency of a rig is refused") {
    const RigMotion good = rig_of_motion(test::skeleton_body(), motion_of_body());
    const auto refuse = [&](const std::function<void(RigMotion&)>& damage, std::string_view word) {
        RigMotion rig = good;
        damage(rig);
        test::check_throws<Error>([&] { validate(rig, "file.bvh"); }, {"file.bvh", word});
    };
    refuse([](RigMotion& r) { r = {}; }, "no joints");
    refuse([](RigMotion& r) { r.timestamps.clear(); }, "no frames");
    refuse([](RigMotion& r) { r.parents.pop_back(); }, "parents");
    refuse([](RigMotion& r) { r.rest_joints.pop_back(); }, "rest_joints");
    refuse([](RigMotion& r) { r.rest_rotations.pop_back(); }, "rest_rotations");
    refuse([](RigMotion& r) { r.joints.pop_back(); }, "joints");
    refuse([](RigMotion& r) { r.rotations.pop_back(); }, "rotations");
    refuse([](RigMotion& r) { r.names[3] = r.names[2]; }, "twice");
    refuse([](RigMotion& r) { r.parents[3] = 3; }, "a joint before it");
    refuse([](RigMotion& r) { r.parents[3] = -2; }, "parent -2");
    refuse([](RigMotion& r) { r.joints[60].y = std::numeric_limits<double>::infinity(); }, "finite");
    refuse([](RigMotion& r) { r.rest_joints[6].y = std::numeric_limits<double>::quiet_NaN(); }, "finite");
    refuse([](RigMotion& r) { r.rest_joints[6].y = 2e30; }, "expected at most 1e30"); // a float could not hold products
    refuse([](RigMotion& r) { r.timestamps[1] = std::numeric_limits<double>::quiet_NaN(); }, "finite");
    refuse([](RigMotion& r) { r.rotations[60] = mat3<double>(1.1); }, "frame 1");
    refuse([](RigMotion& r) { r.rest_rotations[6][0] = vec3<double>(-1, 0, 0); }, "spine2");
    check_rig_size("a", 100, 160'000);
    check_rig_size("a", 0, 1'000'000'000);
    test::check_throws<ValueError>([] { check_rig_size("a.bvh", 100, 160'001); },
                                   {"a.bvh", "160001", "at most 160000"});
}
