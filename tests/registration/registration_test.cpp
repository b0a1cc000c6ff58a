// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_error.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/registration/registration.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {
namespace {

/// The actor turns once before one camera. The estimate has errors as an estimator's: in each joint one that is the same
/// in all frames, and one of each frame.
struct RoughTurn {
    cpu::Threads backend{2};
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion truth = actor_motion(ActorMotion::talk, 10), estimate;
    Capture capture;
    std::vector<Photo> photos;

    RoughTurn() {
        const std::size_t J = truth.joint_count, T = truth.frame_count();
        for (std::size_t t = 0; t < T; ++t) truth.pose[t * J] = {0, 0.63 * static_cast<double>(t), 0};
        capture = film(backend, body, truth, {.train_cameras = 1, .test_cameras = 0, .image_size = 160, .samples = 9, .light = {}});
        photos = photos_of(capture, false);
        estimate = truth;
        test::Rng rng(2);
        const std::vector<vec3<double>> bias = rng.vecs(J, -0.12, 0.12);
        for (std::size_t t = 0; t < T; ++t) {
            const std::vector<vec3<double>> own = rng.vecs(J, -0.04, 0.04), shift = rng.vecs(1, -0.02, 0.02);
            for (std::size_t j = 0; j < std::min<std::size_t>(J, 22); ++j)
                estimate.pose[t * J + j] += bias[j] + own[j];
            estimate.transl[t] += shift[0];
        }
    }
    [[nodiscard]] Registration registered(cpu::Threads& on, const std::vector<Photo>& used,
                                          std::vector<std::vector<ViewKeypoints>> keypoints = {},
                                          bool focal = false, RegistrationParams params = {}) const {
        params.focal = focal;
        params.levels = {{.pixels = 40, .gaussians = 1500, .visits = 40},
                         {.pixels = 80, .gaussians = 3000, .visits = 30, .rate = 0.6, .fingers = 1}};
        const RegisteredPerson person{&body, &estimate, std::move(keypoints)};
        return register_motions(on, Span<const RegisteredPerson>(&person, 1), Span<const Photo>(used), 7, params);
    }
    /// Of all photographs, with the default settings: computed once.
    [[nodiscard]] const Registration& of_all_photos() {
        if (!of_all_) of_all_ = registered(backend, photos);
        return *of_all_;
    }
    /// Of the photographs of all frames but 4: computed once.
    [[nodiscard]] const Registration& of_all_but_one() {
        if (!of_some_) of_some_ = registered(backend, all_but_one());
        return *of_some_;
    }
    [[nodiscard]] std::vector<Photo> all_but_one() const {
        std::vector<Photo> some;
        for (const Photo& photo : photos)
            if (photo.frame != 4) some.push_back(photo);
        return some;
    }
    /// Mean distance of the first 22 joints, relative to the root, of some frames.
    [[nodiscard]] double error(const Motion& motion) const {
        std::vector<std::size_t> joints;
        for (std::size_t j = 0; j < 22; ++j) joints.push_back(j);
        return joint_errors(body, motion, truth, RootAlignment::position).mean_of_mm(joints);
    }

private:
    std::optional<Registration> of_all_, of_some_;
};

RoughTurn& rough_turn() {
    static RoughTurn scene;
    return scene;
}

} // namespace

TEST_CASE("Registration corrects poses that are wrong in all frames alike, seen by one camera") {
    RoughTurn& scene = rough_turn();
    const Registration& found = scene.of_all_photos();
    const double before = scene.error(scene.estimate), after = scene.error(found.motions[0]);
    MESSAGE("joints: " << before << " mm before, " << after << " mm after");
    CHECK(before > 30);
    CHECK(after < 0.5 * before);
    REQUIRE(found.fits.size() == 2);
    CHECK(found.fits[0].factor == 4);
    CHECK(found.fits[1].factor == 2);
    CHECK(found.fits[0].steps == 400);
    CHECK(found.fits[1].psnr > 25);
    for (const double fit : found.frame_fit) CHECK(fit > 8);
}

TEST_CASE("Fine registration brings poses nearer that are near already, and keeps the shape") {
    RoughTurn& scene = rough_turn();
    Motion near = scene.truth;
    for (std::size_t i = 0; i < near.pose.size(); ++i) near.pose[i] += 0.3 * (scene.estimate.pose[i] - near.pose[i]);
    near.betas.assign(static_cast<std::size_t>(scene.body.shape_count), 0.1);
    RegistrationParams params = fine_registration();
    REQUIRE(params.levels.size() == 2);
    for (RegistrationLevel& level : params.levels)
        level.visits = 20, level.pixels = std::min(level.pixels, 160), level.gaussians = 2000;
    const RegisteredPerson person{&scene.body, &near, {}};
    const Registration found = register_motions(scene.backend, Span<const RegisteredPerson>(&person, 1),
                                                Span<const Photo>(scene.photos), 7, params);
    const double before = scene.error(near), after = scene.error(found.motions[0]);
    MESSAGE("joints: " << before << " mm before, " << after << " mm after");
    CHECK(before > 10);
    CHECK(after < 0.9 * before);
    CHECK(found.motions[0].betas == near.betas);
}

TEST_CASE("Keypoints with errors of a detector bring the joints nearer") {
    RoughTurn& scene = rough_turn();
    const MotionLandmarks places(scene.body, scene.truth, landmarks_of(scene.body));
    std::vector<std::vector<ViewKeypoints>> keypoints(scene.truth.frame_count());
    test::Rng rng(4);
    for (const Photo& photo : scene.photos) {
        auto& view = keypoints[photo.frame].emplace_back(ViewKeypoints{.camera = photo.camera, .points = {}});
        for (const char* part : {"knee", "ankle", "shoulder", "elbow", "wrist"})
            for (const char* side : {"left_", "right_"}) {
                const int landmark = landmark_number(std::string(side) + part);
                const vec2<double> pixel = to_pixel(photo.camera, to_camera(photo.camera, places.at(photo.frame, landmark)));
                const std::vector<double> off = rng.numbers(2, -1, 1); // pixels of 160
                view.points.push_back({landmark, pixel + vec2<double>(off[0], off[1]), 0.8});
            }
    }
    keypoints[3][0].points[0].pixel += vec2<double>(60, -60); // a knee that is somewhere else
    const double without = scene.error(scene.of_all_photos().motions[0]);
    const double with = scene.error(scene.registered(scene.backend, scene.photos, keypoints).motions[0]);
    MESSAGE("joints: " << without << " mm without keypoints, " << with << " mm with them");
    CHECK(with < 0.9 * without);
    keypoints.pop_back();
    CHECK_THROWS_AS((void)scene.registered(scene.backend, scene.photos, keypoints), ShapeError);
}

TEST_CASE("A focal length that is a tenth too long becomes shorter, a right one stays, several cameras keep theirs") {
    RoughTurn& scene = rough_turn();
    std::vector<Photo> longer = scene.photos;
    for (Photo& photo : longer) photo.camera.fx *= 1.1, photo.camera.fy *= 1.1;
    const Registration right = scene.registered(scene.backend, scene.photos, {}, true);
    const Registration wrong = scene.registered(scene.backend, longer, {}, true);
    REQUIRE(right.focal.has_value());
    REQUIRE(wrong.focal.has_value());
    MESSAGE("factors on the focal length: " << *right.focal << " of the right one, " << *wrong.focal
                                            << " of one that is a tenth too long");
    CHECK(std::abs(*right.focal - 1) < 0.05);
    CHECK(std::abs(*wrong.focal * 1.1 - 1) < 0.06);

    std::vector<Photo> of_two = scene.photos;
    of_two[1].camera_index = 1;
    CHECK(!scene.registered(scene.backend, of_two, {}, true).focal.has_value());
}

TEST_CASE("Where several cameras see each frame, smoothness does not flatten a fast motion") {
    RoughTurn scene; // of its own: another motion, before other cameras
    test::Rng rng(5);
    const std::size_t J = scene.truth.joint_count;
    for (std::size_t t = 0; t < scene.truth.frame_count(); ++t) {
        scene.truth.pose[t * J] = {0, 0, 0};
        for (const std::size_t j : {1, 2, 4, 5, 16, 17, 18, 19, 20, 21})
            scene.truth.pose[t * J + j] += rng.vecs(1, -0.25, 0.25)[0];
    }
    scene.estimate = scene.truth;
    scene.capture = film(scene.backend, scene.body, scene.truth,
                         {.train_cameras = 4, .test_cameras = 0, .image_size = 160, .samples = 4, .light = {}});
    scene.photos = photos_of(scene.capture, false);
    RegistrationParams as_of_one_camera;
    for (RefinedGroup* group : {&as_of_one_camera.refinement.pose, &as_of_one_camera.refinement.transl})
        group->terms.acceleration *= 4 * 4;
    const double error = scene.error(scene.registered(scene.backend, scene.photos).motions[0]);
    const double flattened =
        scene.error(scene.registered(scene.backend, scene.photos, {}, false, as_of_one_camera).motions[0]);
    MESSAGE("joints, from exact poses: " << error << " mm, " << flattened << " mm with the weight for one camera");
    CHECK(error < 20);
    CHECK(error < 0.8 * flattened);
}

TEST_CASE("The same seed gives the same bits on one thread and on two; frames without photographs follow the others") {
    RoughTurn& scene = rough_turn();
    cpu::Threads one(1);
    const Registration &a = scene.of_all_but_one(), b = scene.registered(one, scene.all_but_one());
    CHECK(a.motions[0].pose == b.motions[0].pose);
    CHECK(a.motions[0].transl == b.motions[0].transl);
    CHECK(a.motions[0].betas == b.motions[0].betas);
    CHECK(std::isnan(a.frame_fit[4]));
    CHECK(std::isfinite(a.frame_fit[3]));
    const auto frame_error = [&](const Motion& motion) {
        return joint_errors(scene.body, motion, scene.truth, RootAlignment::position).per_frame_mm[4];
    };
    CHECK(frame_error(a.motions[0]) < 0.7 * frame_error(scene.estimate));
}

TEST_CASE("A frame whose photograph shows something else is named, and harms no other") {
    RoughTurn& scene = rough_turn();
    std::vector<Photo> wrong = scene.photos;
    std::vector<std::uint8_t> upside_down(wrong[4].rgba.begin(), wrong[4].rgba.end());
    for (std::size_t a = 0, b = upside_down.size() - 4; a < b; a += 4, b -= 4)
        for (std::size_t c = 0; c < 4; ++c) std::swap(upside_down[a + c], upside_down[b + c]);
    REQUIRE(wrong[4].frame == 4);
    wrong[4].rgba = upside_down;
    const Registration with = scene.registered(scene.backend, wrong), &without = scene.of_all_but_one();
    const std::vector<double> weights = frame_weights(with.frame_fit);
    for (std::size_t t = 0; t < weights.size(); ++t) CHECK((weights[t] < 0.25) == (t == 4));
    const auto others = [&](const Motion& motion) {
        const JointErrors errors = joint_errors(scene.body, motion, scene.truth, RootAlignment::position);
        double sum = 0;
        for (std::size_t t = 0; t < errors.per_frame_mm.size(); ++t) sum += t == 4 ? 0 : errors.per_frame_mm[t] / 9;
        return sum;
    };
    MESSAGE("the other frames: " << others(with.motions[0]) << " mm, without the wrong one "
                                 << others(without.motions[0]) << " mm");
    CHECK(others(with.motions[0]) < 1.25 * others(without.motions[0]));
}

TEST_CASE("What cannot be registered is refused") {
    RoughTurn& scene = rough_turn();
    const auto attempt = [&](const BodyModel& body, Span<const Photo> photos, std::size_t people) {
        const RegisteredPerson person{&body, &scene.estimate};
        (void)register_motions(scene.backend, Span<const RegisteredPerson>(&person, people), photos, 0);
    };
    CHECK_THROWS_AS(attempt(scene.body, {}, 1), ValueError);
    CHECK_THROWS_AS(attempt(scene.body, Span<const Photo>(scene.photos), 0), ValueError);
    BodyModel points = scene.body;
    points.faces.clear();
    CHECK_THROWS_AS(attempt(points, Span<const Photo>(scene.photos), 1), ValueError);
}

} // namespace gsh
