// SPDX-License-Identifier: Apache-2.0
/// @file  Motions of the actor are found again from what detectors would see of them.
#include <gsh/fit/fit_motion.hpp>

#include <gsh/backend/serial.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/image/image.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include "fit/filmed_person.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The mean distance of the joints of trunk and limbs, millimetres, root-aligned or not.
double error_mm(const Motion& found, const Motion& truth, RootAlignment alignment = RootAlignment::position) {
    const JointErrors errors = joint_errors(test::fitted_actor(), found, truth, alignment);
    std::vector<std::size_t> body(22);
    for (std::size_t j = 0; j < 22; ++j) body[j] = j;
    return errors.mean_of_mm(body);
}

/// One turn in a pose with the arms away from the body.
Motion turn(int frames) {
    Motion motion = actor_motion(ActorMotion::talk, frames);
    const std::vector<vec3<double>> pose(motion.pose.begin(), motion.pose.begin() + 55);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        std::copy(pose.begin(), pose.end(), motion.pose.begin() + static_cast<std::ptrdiff_t>(55 * t));
        motion.pose[55 * t] = vec3<double>(0, 2 * std::numbers::pi * static_cast<double>(t) / frames, 0);
        motion.transl[t] = motion.transl[0];
    }
    return motion;
}

} // namespace

TEST_CASE("several cameras: the motion is found within millimetres, and is the same every time") {
    const Motion truth = actor_motion(ActorMotion::stride, 12);
    const auto cameras = test::cameras_around(3);
    const auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.004);
    const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 4});
    CHECK(error_mm(fit.motion, truth) < 8);
    CHECK(error_mm(fit.motion, truth, RootAlignment::none) < 10);
    CHECK(fit.swapped.empty());
    CHECK(!fit.held);
    CHECK(fit.focal == 1);
    CHECK(fit.shifts == std::vector<vec2<double>>(3, vec2<double>(0)));
    for (const KeypointFit& camera : fit.camera_fit) CHECK((camera.metres < 0.01 && camera.count > 100));
    // The order of the photographs does not matter, nor what ran before.
    auto reversed = photos;
    std::reverse(reversed.begin(), reversed.end());
    const MotionFit again = fit_motion(test::fitted_actor(), cameras, reversed, truth.timestamps, {.betas = 4});
    CHECK(again.motion.pose == fit.motion.pose);
    CHECK(again.motion.betas == fit.motion.betas);
}

TEST_CASE("one camera and one turn: the turn is seen, the pose held, the height gives the size") {
    const Motion truth = turn(24);
    const auto cameras = test::cameras_around(1);
    const auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.008);
    const BodyHeight height(test::fitted_actor(), 4);
    MotionFitParams params{.height = height.mean, .betas = 4};
    const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, params);
    CHECK(fit.turn.degrees > 320);
    CHECK(fit.held);
    CHECK(error_mm(fit.motion, truth) < 20);
    CHECK(std::abs(height.of(fit.state.betas) - height.mean) < 0.004);
    params.turn = false;
    const MotionFit free = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, params);
    CHECK(!free.held);
    CHECK(error_mm(free.motion, truth) > error_mm(fit.motion, truth));
    // A person who walks through the picture does not turn in one pose.
    const Motion walk = actor_motion(ActorMotion::stride, 12);
    CHECK(!fit_motion(test::fitted_actor(), cameras, test::seen(test::fitted_actor(), walk, cameras), walk.timestamps,
                      {.betas = 4})
               .held);
}

TEST_CASE("a guessed focal length is found, from the turn of a person of known height") {
    const Motion truth = turn(24);
    auto cameras = test::cameras_around(1, 2.2);
    const auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.002);
    const BodyHeight height(test::fitted_actor(), 0);
    cameras[0].fx *= 1.12, cameras[0].fy *= 1.12; // the guess
    const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps,
                                     {.height = height.mean, .learn_focal = true, .betas = 4});
    CHECK(fit.focal == doctest::Approx(1 / 1.12).epsilon(0.04));
}

TEST_CASE("swapped sides are found: in one of three cameras, and in some frames of a single camera") {
    const Motion truth = actor_motion(ActorMotion::stride, 12);
    for (const std::size_t count : {3, 1}) {
        const auto cameras = test::cameras_around(count);
        auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.005);
        const std::size_t of = count - 1;
        std::vector<std::pair<std::size_t, std::size_t>> swapped;
        for (PersonPhoto& photo : photos) {
            if (photo.camera != of || photo.frame < 5 || photo.frame > 7) continue;
            ViewKeypoints view{cameras[0], photo.person.points, photo.person.metric, 0, {}};
            swap_sides(view);
            photo.person = {view.points, view.metric};
            swapped.emplace_back(photo.camera, photo.frame);
        }
        const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 4});
        CAPTURE(count);
        CHECK(fit.swapped == swapped);
        CHECK(error_mm(fit.motion, truth) < (count == 3 ? 10 : 60));
    }
}

TEST_CASE("the offset of a camera's clock is found") {
    const Motion truth = actor_motion(ActorMotion::stride, 20);
    const auto cameras = test::cameras_around(3);
    auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.004);
    for (PersonPhoto& photo : photos)
        if (photo.camera == 1) photo.frame = photo.frame == 0 ? 999 : photo.frame - 1; // it shows the next moment
    std::erase_if(photos, [](const PersonPhoto& photo) { return photo.frame == 999; });
    const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 4});
    CHECK(fit.time_offsets[1] - fit.time_offsets[0] == doctest::Approx(0.1).epsilon(0.2));
    CHECK(std::abs(fit.time_offsets[2] - fit.time_offsets[0]) < 0.02);
    CHECK(error_mm(fit.motion, truth) < 20);
}

TEST_CASE("a camera that points beside its calibration is found, and is no late clock") {
    Motion truth = actor_motion(ActorMotion::stride, 20);
    for (std::size_t t = 0; t < 20; ++t) truth.transl[t] += vec3<double>(0.03 * static_cast<double>(t) - 0.3, 0, 0);
    const auto cameras = test::cameras_around(4);
    auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.004);
    for (PersonPhoto& photo : photos)
        if (photo.camera == 2)
            for (Keypoint& point : photo.person.points) point.pixel += vec2<double>(6, -5);
    const MotionFit fit = fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 4});
    CHECK(fit.time_offsets == std::vector<double>(4, 0.0));
    CHECK(fit.shifts[2].x - fit.shifts[0].x == doctest::Approx(6).epsilon(0.25));
    CHECK(fit.shifts[2].y - fit.shifts[0].y == doctest::Approx(-5).epsilon(0.25));
    CHECK(error_mm(fit.motion, truth) < 10);
}

TEST_CASE("masks show that cameras point beside their calibration by a pixel or two, which keypoints do not tell") {
    // Masks of four cameras, of which two have moved in opposite directions; keypoints have the noise of a detector.
    const BodyModel& body = test::fitted_actor();
    const Motion truth = actor_motion(ActorMotion::stride, 16);
    const auto cameras = test::cameras_around(4);
    auto moved = cameras;
    moved[0].cy += 1.5, moved[2].cy -= 1.5, moved[2].cx += 1;
    auto photos = test::seen(body, truth, moved, 0.01);
    const auto masks = test::masks_of(body, truth, moved, photos);
    for (std::size_t i = 0; i < photos.size(); ++i)
        photos[i].mask = {masks[i].height, masks[i].width, masks[i].data.data()};
    const MotionFit fit = fit_motion(body, cameras, photos, truth.timestamps, {.betas = 4});
    // The mean of all cameras is the motion's.
    const auto between = [&](std::size_t a, std::size_t b) { return fit.shifts[a] - fit.shifts[b]; };
    CHECK(std::abs(between(0, 2).y - 3) < 0.4);
    CHECK(std::abs(between(2, 0).x - 1) < 0.5);
    CHECK(std::abs(between(1, 3).y) < 0.4);
    CHECK(error_mm(fit.motion, truth) < 8);
}

TEST_CASE("masks show the shape that keypoints do not see") {
    // Two cameras, keypoints of trunk and limbs, and masks of the posed body itself.
    const BodyModel& body = test::fitted_actor();
    Motion truth = turn(8);
    truth.betas = {0, 0, 0, 0};
    truth.betas.resize(static_cast<std::size_t>(body.shape_count), 0.0);
    truth.betas[1] = 1.5;
    const auto cameras = test::cameras_around(2);
    auto photos = test::seen(body, truth, cameras, 0.004);
    const auto masks = test::masks_of(body, truth, cameras, photos);
    for (std::size_t i = 0; i < photos.size(); ++i)
        photos[i].mask = {masks[i].height, masks[i].width, masks[i].data.data(), 1};
    const MotionFit with = fit_motion(body, cameras, photos, truth.timestamps, {.betas = 4});
    CHECK(with.outlines == photos.size());
    for (PersonPhoto& photo : photos) photo.mask = {};
    const MotionFit without = fit_motion(body, cameras, photos, truth.timestamps, {.betas = 4});
    CHECK(without.outlines == 0);
    const auto off = [&](const Motion& motion) {
        const auto a = shaped_vertices(body, motion.betas), b = shaped_vertices(body, truth.betas);
        double sum = 0;
        for (std::size_t v = 0; v < a.size(); ++v) sum += length(a[v] - b[v]);
        return sum / static_cast<double>(a.size());
    };
    CHECK(off(with.motion) < 0.5 * off(without.motion));
}

TEST_CASE("frames without keypoints lie between those beside them; a long motion is fitted in windows") {
    Motion truth = actor_motion(ActorMotion::talk, 140);
    const auto cameras = test::cameras_around(2);
    auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.003);
    std::erase_if(photos, [](const PersonPhoto& photo) { return photo.frame >= 50 && photo.frame < 53; });
    const MotionFit fit =
        fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 2, .window = 80});
    CHECK(fit.motion.frame_count() == 140);
    CHECK(std::isnan(fit.frame_fit[51]));
    CHECK(fit.frame_fit[54] < 0.01);
    const JointErrors errors = joint_errors(test::fitted_actor(), fit.motion, truth, RootAlignment::none);
    CHECK(errors.mean_mm < 15);
    CHECK(*std::max_element(errors.per_frame_mm.begin(), errors.per_frame_mm.end()) < 40);
    // No jump where windows meet.
    const auto joints = motion_joints(test::fitted_actor(), fit.motion);
    for (std::size_t t = 1; t < 140; ++t) CHECK(length(joints[55 * t + 20] - joints[55 * (t - 1) + 20]) < 0.15);
}

TEST_CASE("what cannot be fitted is refused") {
    const Motion truth = actor_motion(ActorMotion::talk, 3);
    const auto cameras = test::cameras_around(1);
    const auto photos = test::seen(test::fitted_actor(), truth, cameras);
    const auto refused = [&](auto change) {
        auto changed = photos;
        auto times = truth.timestamps;
        MotionFitParams params;
        change(changed, times, params);
        try {
            (void)fit_motion(test::fitted_actor(), cameras, changed, times, params);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("none");
    };
    const auto has = [](const std::string& message, const char* text) {
        CAPTURE(message);
        CHECK(message == test::contains(text));
    };
    has(refused([](auto& p, auto&, auto&) { p[1].frame = 3; }), "camera 0 and frame 3");
    has(refused([](auto& p, auto&, auto&) { p[1].frame = 0; }), "is given twice");
    has(refused(
            [](auto& p, auto&, auto&) { p[0].person.points[3].pixel.x = std::numeric_limits<double>::quiet_NaN(); }),
        "not finite");
    has(refused([](auto&, auto& t, auto&) { t[2] = t[1]; }), "times must ascend");
    has(refused([](auto&, auto& t, auto&) { t.clear(); }), "no frames");
    has(refused([](auto&, auto&, auto& p) { p.height = 12; }), "height");
    has(refused([](auto& p, auto&, auto&) { p.clear(); }), "no photograph shows");
}
