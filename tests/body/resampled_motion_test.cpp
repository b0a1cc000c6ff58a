// SPDX-License-Identifier: Apache-2.0
/// @file  Motions at another frame rate meet the frames and are even between them.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/body/resampled_motion.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("frames are met; between them joints turn evenly and positions are lines") {
    const Motion motion = actor_motion(ActorMotion::stride, 10, 10);
    const Motion twice = resampled(motion, 20);
    REQUIRE(twice.frame_count() == 19);
    for (std::size_t t = 0; t < 10; ++t) {
        CHECK(twice.timestamps[2 * t] == doctest::Approx(motion.timestamps[t]));
        CHECK(length(twice.transl[2 * t] - motion.transl[t]) < 1e-9);
        for (std::size_t j = 0; j < motion.joint_count; ++j)
            CHECK(length(twice.pose_at(2 * t)[j] - motion.pose_at(t)[j]) < 1e-9);
    }
    const auto a = rotation_from_axis_angle(motion.pose_at(3)[1]), b = rotation_from_axis_angle(motion.pose_at(4)[1]),
               between = rotation_from_axis_angle(twice.pose_at(7)[1]);
    const auto first = axis_angle_from_rotation(transpose(a) * between);
    CHECK(length(first - axis_angle_from_rotation(transpose(between) * b)) < 1e-9);
    CHECK(length(first) > 1e-3);
    CHECK(length(twice.transl[7] - (motion.transl[3] + motion.transl[4]) * 0.5) < 1e-9);
    CHECK(twice.betas == motion.betas);
    CHECK(resampled(motion, 5).frame_count() == 5);
    CHECK(resampled(actor_motion(ActorMotion::talk, 1), 30).frame_count() == 1);
}

TEST_CASE("motions that are shown together go by time: the highest of their rates, from their first frames") {
    const auto at_rate = [](double rate, int frames, double start) {
        Motion motion = actor_motion(ActorMotion::stride, frames, rate);
        for (double& time : motion.timestamps) time += start;
        return motion;
    };
    std::vector<Motion> motions{at_rate(10, 11, 0), at_rate(30, 31, 5)}; // a second each
    const std::vector<Motion> before = motions;
    CHECK(share_frame_times(motions) == doctest::Approx(30));
    REQUIRE(motions[0].frame_count() == 31);
    REQUIRE(motions[1].frame_count() == 31);
    for (std::size_t t = 0; t < 11; ++t) {
        CHECK(length(motions[0].transl[3 * t] - before[0].transl[t]) < 1e-9);
        CHECK(motions[0].timestamps[t] - motions[0].timestamps[0] ==
              doctest::Approx(motions[1].timestamps[t] - motions[1].timestamps[0]));
    }
    // The same rate, other lengths and beginnings: nothing changes.
    motions = {at_rate(30, 20, 0), at_rate(30, 31, 5), at_rate(30, 1, 2)};
    const std::vector<vec3<double>> pose = motions[0].pose;
    CHECK(share_frame_times(motions) == 0);
    CHECK(motions[0].pose == pose);
    // Frames that are left out
    Motion gap = at_rate(30, 20, 0);
    gap.timestamps.back() += 1;
    motions = {gap, at_rate(30, 20, 0)};
    CHECK(share_frame_times(motions) == doctest::Approx(30));
    CHECK(motions[0].frame_count() == 50);
    std::vector<Motion> none;
    CHECK(share_frame_times(none) == 0);
    CHECK(typical_interval(std::vector<double>{0, 1, 3, 4}) == 1);
    CHECK(typical_interval(std::vector<double>{7}) == 0);
}

TEST_CASE("bad rates and motions are refused") {
    const Motion motion = actor_motion(ActorMotion::stride, 3);
    for (const double rate : {0.0, -1.0, 1e12})
        test::check_throws<ValueError>([&] { (void)resampled(motion, rate); }, {"frames per second"});
    test::check_throws<ValueError>([] { (void)resampled(Motion{}, 30); }, {"no frames"});
    Motion back = motion;
    back.timestamps[2] = -1;
    test::check_throws<ValueError>([&] { (void)resampled(back, 30); }, {"descend"});
}
