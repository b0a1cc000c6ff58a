// SPDX-License-Identifier: Apache-2.0
/// @file  The fit on what MediaPipe found in pictures of the built-in actor, whose true motion is known.
#include <gsh/fit/fit_motion.hpp>

#include <gsh/body/joint_error.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/fit/body_height.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/synthetic/actor_turn.hpp>

#include "fit/filmed_person.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <vector>

using namespace gsh;

namespace {

/// tests/data/turn, which tests/data/make-turn makes.
struct DetectedTurn {
    Detections found = load_detections(std::filesystem::path(GSH_SOURCE_DIR) / "tests/data/turn");
    std::vector<Camera<double>> cameras;
    std::vector<PersonPhoto> photos;
    Camera<double> filmed = look_at<double>({0, 0.35, 3.3}, {0, -0.07, 0}, {0, 1, 0}, 0.66, 540, 720); // as by story 10
    Motion truth = actor_turn(24);

    DetectedTurn() {
        for (std::size_t t = 0; t < 24; ++t)
            move_frame(test::fitted_actor(), truth, t, Affine<double>(filmed.R, filmed.t));
        for (const NamedCamera& camera : found.cameras) cameras.push_back(camera.camera);
        for (const PhotoKeypoints& photo : found.keypoints)
            for (const Detection& person : photo.people) photos.push_back({photo.camera, photo.frame, person, {}});
    }
    [[nodiscard]] MotionFit fit(MotionFitParams params) const {
        return fit_motion(test::fitted_actor(), cameras, photos, found.times, params);
    }
    /// Millimetres, the mean over the joints of trunk and limbs.
    [[nodiscard]] double error(const MotionFit& fit, RootAlignment alignment) const {
        const JointErrors errors = joint_errors(test::fitted_actor(), fit.motion, truth, alignment);
        std::vector<std::size_t> body(22);
        for (std::size_t j = 0; j < 22; ++j) body[j] = j;
        return errors.mean_of_mm(body);
    }
};

} // namespace

TEST_CASE("MediaPipe's landmarks of the actor's turn give the motion back") {
    DetectedTurn turn;
    REQUIRE(turn.photos.size() == 24);
    const double height = BodyHeight(test::fitted_actor(), 0).of({});
    SUBCASE("the focal length is learned") {
        CHECK(!turn.found.known_focal[0]);
        const MotionFit fit = turn.fit({.height = height, .learn_focal = true});
        CHECK(fit.held);
        CHECK(fit.swapped.empty());
        CHECK(fit.turn.degrees == doctest::Approx(345).epsilon(0.03)); // the last picture is 15 degrees short of a turn
        CHECK(fit.focal * turn.cameras[0].fx == doctest::Approx(turn.filmed.fx).epsilon(0.08));
        CHECK(turn.error(fit, RootAlignment::position) < 32); // millimetres; 26.6 when this was written
        CHECK(turn.error(fit, RootAlignment::rotation) < 30); // 25.0
    }
    SUBCASE("the focal length is known") {
        turn.cameras[0] = turn.filmed, turn.cameras[0].R = mat3<double>(1), turn.cameras[0].t = vec3<double>(0);
        const MotionFit fit = turn.fit({.height = height});
        CHECK(turn.error(fit, RootAlignment::position) < 32); // 26.5
        CHECK(turn.error(fit, RootAlignment::none) < 120);    // 105: depth, by perspective and size alone
    }
}
