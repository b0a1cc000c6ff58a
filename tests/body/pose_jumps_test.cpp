// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/pose_jumps.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

struct Dance {
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion motion = actor_motion(ActorMotion::stride, 20);

    void spoil(std::size_t frame, double radians) {
        test::Rng rng(frame + 1);
        for (std::size_t j = 0; j < 22; ++j)
            motion.pose[frame * motion.joint_count + j] += rng.vec(-radians, radians);
    }
};

} // namespace

TEST_CASE("a motion without errors, or with jitter in all frames, has no jumps") {
    Dance dance;
    CHECK(pose_jumps(dance.body, dance.motion).empty());
    for (std::size_t t = 0; t < 20; ++t) dance.spoil(t, 0.2); // about 10 cm at hands and feet
    CHECK(pose_jumps(dance.body, dance.motion).empty());
}

TEST_CASE("wrong poses of single frames are found, and replaced by the poses beside them") {
    Dance dance;
    const Motion truth = dance.motion;
    dance.spoil(7, 0.9), dance.spoil(13, 0.9);
    const std::vector<PoseJump> jumps = pose_jumps(dance.body, dance.motion);
    REQUIRE(jumps.size() == 2);
    CHECK(jumps[0].frame == 7);
    CHECK(jumps[1].frame == 13);
    for (const PoseJump& jump : jumps) CHECK(jump.distance > 0.1);
    const Motion mended = without_jumps(dance.motion, jumps);
    const JointErrors before = joint_errors(dance.body, dance.motion, truth, RootAlignment::none);
    const JointErrors after = joint_errors(dance.body, mended, truth, RootAlignment::none);
    for (std::size_t t = 0; t < 20; ++t) {
        if (t == 7 || t == 13) CHECK(after.per_frame_mm[t] < 0.2 * before.per_frame_mm[t]);
        else CHECK(after.per_frame_mm[t] == 0);
    }
    CHECK(pose_jumps(dance.body, mended).empty());
}

TEST_CASE("half-way between turns of more than half a circle is the short way") {
    Dance dance;
    const std::size_t J = dance.motion.joint_count;
    dance.motion.pose[4 * J] = {0, 3.1, 0}, dance.motion.pose[6 * J] = {0, -3.1, 0};
    const Motion mended = without_jumps(dance.motion, {{5, 1.0}});
    CHECK(length(mended.pose[5 * J]) > 3.1); // behind, and not in front
}

TEST_CASE("short motions have no jumps, and frames at the ends cannot be replaced") {
    Dance dance;
    dance.motion = actor_motion(ActorMotion::stride, 4);
    dance.spoil(2, 1.5);
    CHECK(pose_jumps(dance.body, dance.motion).empty());
    CHECK_THROWS_AS((void)without_jumps(dance.motion, {{0, 1.0}}), ValueError);
    CHECK_THROWS_AS((void)without_jumps(dance.motion, {{3, 1.0}}), ValueError);
    CHECK_THROWS_AS((void)without_jumps(dance.motion, {{9, 1.0}}), ValueError);
}
