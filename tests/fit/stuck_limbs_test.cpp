// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/stuck_limbs.hpp>

#include <gsh/fit/fit_motion.hpp>

#include "fit/filmed_person.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

/// A person who stands with a bent left arm, fitted to three cameras.
struct BentArm {
    static constexpr std::size_t frame_count = 6;
    FittedBody body{test::fitted_actor(), 4};
    std::vector<std::vector<ViewKeypoints>> views{frame_count};
    std::vector<double> times;
    MotionState fitted;

    BentArm() {
        Motion truth = actor_motion(ActorMotion::talk, static_cast<int>(frame_count));
        for (std::size_t t = 0; t < frame_count; ++t) {
            truth.pose[t * 55 + joint("left_shoulder")] = {0, -0.3, 0};
            truth.pose[t * 55 + joint("left_elbow")] = {0, -1.2, 0};
        }
        times = truth.timestamps;
        const auto cameras = test::cameras_around(3);
        const auto photos = test::seen(test::fitted_actor(), truth, cameras);
        for (const PersonPhoto& photo : photos)
            views[photo.frame].push_back(
                {cameras[photo.camera], photo.person.points, photo.person.metric, photo.camera, {}});
        fitted = fit_motion(test::fitted_actor(), cameras, photos, times, {.betas = 4}).state;
    }
    /// Those of the first descent.
    static MotionTerms terms() { return {.fingers = false, .hold_shared = true, .metric = 2, .prior = 1}; }
    [[nodiscard]] std::size_t joint(const char* landmark) const {
        return static_cast<std::size_t>(body.marks[static_cast<std::size_t>(landmark_number(landmark))].joint);
    }
    /// How far the left arm lies from its keypoints, metres.
    [[nodiscard]] double misfit(const FrameNumbers& frame, std::size_t t) const {
        return detail::limb_misfit(FrameKinematics(body, frame, fitted.betas), detail::limb_landmarks[0], views[t], 1);
    }
    /// The state with a left arm that is raised behind the head and twisted in one of its frames.
    void twist(MotionState& state, std::size_t frame) const {
        const vec3<double> shoulder(1.5, 0.8, 1.3), elbow(1.5, -0.5, 0);
        for (std::size_t a = 0; a < body.limb_axes; ++a) {
            const auto j = static_cast<std::size_t>(body.axes[a].joint);
            if (j == joint("left_shoulder")) state.frames[frame].angles[a] = dot(shoulder, body.axes[a].axis);
            if (j == joint("left_elbow")) state.frames[frame].angles[a] = dot(elbow, body.axes[a].axis);
        }
    }
};

} // namespace

TEST_CASE("an arm that no descent frees takes the pose of the frame beside it, in the middle and at the ends") {
    const BentArm arm;
    for (const std::vector<std::size_t>& stuck : {std::vector<std::size_t>{2, 3}, {0}, {5}}) {
        CAPTURE(stuck[0]);
        MotionState state = arm.fitted;
        for (const std::size_t t : stuck) {
            arm.twist(state, t);
            if (t != 2) continue; // it stays where it is if nothing shows it the way
            const std::vector<std::vector<ViewKeypoints>> shown{arm.views[t]};
            MotionProblem problem(arm.body, shown, {0.0});
            MotionState alone = state;
            alone.frames = {state.frames[t]};
            (void)descend(problem, alone, BentArm::terms(), 20, 1e-3);
            CHECK(arm.misfit(alone.frames[0], t) > 0.1);
        }
        CHECK(free_stuck_limbs(arm.body, state, arm.views, arm.times, BentArm::terms()) == stuck.size());
        for (std::size_t t = 0; t < BentArm::frame_count; ++t) {
            const bool was_stuck = std::find(stuck.begin(), stuck.end(), t) != stuck.end();
            CHECK((state.frames[t].angles != arm.fitted.frames[t].angles) == was_stuck);
            CHECK(arm.misfit(state.frames[t], t) < 0.03);
        }
    }
}

TEST_CASE("limbs that follow their keypoints stay, and those without keypoints or frames beside them are not freed") {
    const BentArm arm;
    MotionState state = arm.fitted;
    CHECK(free_stuck_limbs(arm.body, state, arm.views, arm.times, BentArm::terms()) == 0);
    arm.twist(state, 2);
    const MotionState before = state;
    const std::vector<std::vector<ViewKeypoints>> nothing(BentArm::frame_count);
    CHECK(free_stuck_limbs(arm.body, state, nothing, arm.times, BentArm::terms()) == 0);
    CHECK(state.frames[2].angles == before.frames[2].angles);
    MotionState one = before;
    one.frames = {before.frames[2]};
    (void)free_stuck_limbs(arm.body, one, {arm.views[2]}, {0.0}, BentArm::terms());
    CHECK(arm.misfit(one.frames[0], 2) > 0.1); // nothing shows it the way
}
