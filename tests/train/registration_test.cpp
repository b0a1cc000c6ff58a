// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>
#include <gsh/train/registration.hpp>

#include "support/gradient.hpp"

#include <cmath>
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
    [[nodiscard]] Registration registered(cpu::Threads& on, const std::vector<Photo>& used) const {
        RegistrationParams params;
        params.levels = {{.pixels = 40, .visits = 40}, {.pixels = 80, .visits = 30, .rate = 0.6, .fingers = 1}};
        params.gaussians = 4000;
        const RegisteredPerson person{&body, &estimate};
        return register_motions(on, Span<const RegisteredPerson>(&person, 1), Span<const Photo>(used), 7, params);
    }
    /// Mean distance of the first 22 joints, relative to the root, of some frames.
    [[nodiscard]] double error(const Motion& motion) const {
        std::vector<std::size_t> joints;
        for (std::size_t j = 0; j < 22; ++j) joints.push_back(j);
        return joint_errors(body, motion, truth, RootAlignment::position).mean_of_mm(joints);
    }
};

RoughTurn& rough_turn() {
    static RoughTurn scene;
    return scene;
}

} // namespace

TEST_CASE("Registration corrects poses that are wrong in all frames alike, seen by one camera") {
    RoughTurn& scene = rough_turn();
    const Registration found = scene.registered(scene.backend, scene.photos);
    const double before = scene.error(scene.estimate), after = scene.error(found.motions[0]);
    MESSAGE("joints: " << before << " mm before, " << after << " mm after");
    CHECK(before > 30);
    CHECK(after < 0.5 * before);
    REQUIRE(found.fits.size() == 2);
    CHECK(found.fits[0].factor == 4);
    CHECK(found.fits[1].factor == 2);
    CHECK(found.fits[0].steps == 400);
    CHECK(found.fits[1].psnr > 25);
    for (const double psnr : found.frame_psnr) CHECK(psnr > 20);
}

TEST_CASE("The same seed gives the same bits on one thread and on two; frames without photographs follow the others") {
    RoughTurn& scene = rough_turn();
    std::vector<Photo> some;
    for (const Photo& photo : scene.photos)
        if (photo.frame != 4) some.push_back(photo);
    cpu::Threads one(1);
    const Registration a = scene.registered(scene.backend, some), b = scene.registered(one, some);
    CHECK(a.motions[0].pose == b.motions[0].pose);
    CHECK(a.motions[0].transl == b.motions[0].transl);
    CHECK(a.motions[0].betas == b.motions[0].betas);
    CHECK(std::isnan(a.frame_psnr[4]));
    CHECK(std::isfinite(a.frame_psnr[3]));
    const auto frame_error = [&](const Motion& motion) {
        return joint_errors(scene.body, motion, scene.truth, RootAlignment::position).per_frame_mm[4];
    };
    CHECK(frame_error(a.motions[0]) < 0.7 * frame_error(scene.estimate));
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
