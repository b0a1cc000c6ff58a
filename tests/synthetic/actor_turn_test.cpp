// SPDX-License-Identifier: Apache-2.0
/// @file  The actor's turn: once around, in one pose, on one spot.
#include <doctest/doctest.h>

#include <gsh/body/posed_body.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_turn.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

using namespace gsh;

TEST_CASE("actor_turn goes once around in one pose, and stays on its spot") {
    const BodyModel body = make_actor({.edge_scale = 1.5});
    const Motion motion = actor_turn(16, 8);
    REQUIRE(motion.frame_count() == 16);
    CHECK(motion.timestamps.back() == doctest::Approx(15.0 / 8));
    double widest = 0;
    for (std::size_t t = 0; t < 16; ++t) {
        const Span<const vec3<double>> pose = motion.pose_at(t);
        CHECK(pose[0].y == doctest::Approx(2 * std::numbers::pi * static_cast<double>(t) / 16));
        for (std::size_t j = 1; j < motion.joint_count; ++j)
            widest = std::max(widest, length(pose[j] - motion.pose_at(0)[j]));
        const PosedBody posed = pose_body(body, pose, motion.transl[t], motion.betas);
        double low = 1e9, farthest = 0;
        for (const vec3<double>& p : posed.vertices) low = std::min(low, p.y);
        for (const int hand : {int(smplx::left_wrist), int(smplx::left_wrist) + 1}) {
            const vec3<double> wrist = posed.joints[static_cast<std::size_t>(hand)];
            farthest = std::max(farthest, std::hypot(wrist.x, wrist.z));
            CHECK(std::hypot(wrist.x, wrist.z) > 0.3); // off the body
        }
        CHECK(farthest < 0.7);
        CHECK(low == doctest::Approx(ActorOutfit::sole_y).epsilon(0.005));
    }
    CHECK(widest > 0.03); // it sways
    CHECK(widest < 0.15); // by a few degrees
    CHECK_THROWS_AS((void)actor_turn(0), ValueError);
}
