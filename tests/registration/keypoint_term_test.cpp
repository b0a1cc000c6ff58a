// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/cpu.hpp>
#include <gsh/registration/keypoint_term.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"
#include "support/guarded.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

using namespace gsh;

namespace {

/// A body in a pose, two cameras, and keypoints that are some pixels off.
struct Observed {
    cpu::Serial backend;
    BodyModel body = test::tube(4, 8, 6);
    std::vector<double> betas{0.2, -0.3};
    SurfaceSamples samples = sample_surface(body, shaped_vertices(body, betas), 1.0, 4);
    RigData rig = make_rig(body, betas, samples);
    std::vector<Camera<double>> cameras{look_at<double>({-0.7, 1, 3.5}, {0, 0.8, 0}, {0, 1, 0}, 0.5, 200, 160),
                                        look_at<double>({2.5, 1, 2.5}, {0, 0.8, 0}, {0, 1, 0}, 0.5, 200, 160)};
    Motion motion;
    RigPose<cpu::Serial, double> pose;
    Landmarks marks{};                // landmark k lies beside joint k, for k below 4; the body has no others
    std::vector<vec3<double>> places; // of them, posed by other code

    Observed() {
        test::Rng rng(8);
        motion.joint_count = 4;
        motion.expression_count = static_cast<std::size_t>(body.expression_count);
        motion.betas = {0.5, 0.1}; // not the rig's
        motion.pose = rng.vecs(4, -0.5, 0.5);
        motion.expression = rng.numbers(motion.expression_count, -0.5, 0.5);
        motion.transl = rng.vecs(1, -0.1, 0.1);
        motion.timestamps = {0};
        Rig<cpu::Serial, double>(backend, rig).upload_pose(motion, 0, pose);
        for (Landmark& mark : marks) mark.joint = -1;
        for (int k = 0; k < 4; ++k) marks[static_cast<std::size_t>(k)] = {k, rng.vecs(1, -0.1, 0.1)[0], 0.02};
        const MotionLandmarks posed(body, motion, marks);
        for (int k = 0; k < 4; ++k) places.push_back(posed.at(0, k));
    }
    /// Keypoints of all landmarks in both cameras, moved by `off` pixels each.
    [[nodiscard]] std::vector<std::vector<ViewKeypoints>> views(double off) const {
        test::Rng rng(3);
        std::vector<std::vector<ViewKeypoints>> frames(1);
        for (const Camera<double>& camera : cameras) {
            auto& view = frames[0].emplace_back(ViewKeypoints{.camera = camera, .points = {}});
            for (int j = 0; j < 4; ++j) {
                const vec2<double> at = to_pixel(camera, to_camera(camera, places[static_cast<std::size_t>(j)]));
                const double angle = rng.numbers(1, 0, 6.28)[0];
                view.points.push_back({j, at + vec2<double>(std::cos(angle), std::sin(angle)) * off,
                                       rng.numbers(1, 0.3, 1)[0]});
            }
        }
        return frames;
    }
};

} // namespace

TEST_CASE("keypoints at the projected landmarks cost nothing; off by d they cost weight times c (√(1 + d²/δ²) - 1)") {
    Observed scene;
    KeypointTerm<cpu::Serial, double> exact(scene.backend, scene.rig, scene.views(0), scene.marks, {.weight = 3});
    CHECK(std::abs(exact.value(0, scene.pose)) < 1e-12);
    const auto views = scene.views(4); // δ is 1.6 pixels
    KeypointTerm<cpu::Serial, double> off(scene.backend, scene.rig, views, scene.marks, {.weight = 3});
    double sum = 0;
    for (const ViewKeypoints& view : views[0])
        for (const Keypoint& point : view.points) sum += point.confidence * (std::sqrt(1 + 2.5 * 2.5) - 1);
    CHECK(off.value(0, scene.pose) == doctest::Approx(3 * sum / 8));
    CHECK(off.value(1, scene.pose) == 0); // a frame without keypoints
    CHECK(off.counts(0));
    CHECK(!off.counts(1));
}

TEST_CASE("the adjoint is the gradient with respect to pose, transl and coefficients, and adds") {
    Observed scene;
    KeypointTerm<cpu::Serial, double> term(scene.backend, scene.rig, scene.views(6), scene.marks, {.weight = 2});
    std::vector<vec3<double>> dL_dpose(4, vec3<double>(0)), dL_dtransl(1, vec3<double>(0));
    std::vector<double> dL_dcoefficients(scene.pose.coefficients.size(), 0);
    const RigPoseGradient<double> gradient{dL_dpose, dL_dcoefficients, dL_dtransl};
    term.backward(0, scene.pose, gradient);
    const auto value = [&] { return term.value(0, scene.pose); };
    const auto check = [&](Span<double> x, Span<const double> dL_dx) {
        test::check_gradient(value, x, dL_dx, {.step = 1e-6, .tolerance = 2e-6});
    };
    for (std::size_t j = 0; j < 4; ++j) check(test::scalars(scene.pose.pose[j]), test::scalars(dL_dpose[j]));
    check(test::scalars(scene.pose.transl[0]), test::scalars(dL_dtransl[0]));
    check(Span<double>(scene.pose.coefficients.data(), scene.pose.coefficients.size()), dL_dcoefficients);
    const vec3<double> once = dL_dpose[1];
    term.backward(0, scene.pose, gradient);
    CHECK(length(dL_dpose[1] - 2.0 * once) < 1e-12);
    term.backward(0, scene.pose, {}); // nothing is wanted
}

TEST_CASE("the adjoint's values are those of the body's own joints under every backend") {
    Observed scene;
    cpu::Threads threads(2);
    test::Guarded guarded;
    const auto numbers = [&](auto& backend) {
        using B = std::remove_reference_t<decltype(backend)>;
        RigPose<B, double> pose;
        Rig<B, double>(backend, scene.rig).upload_pose(scene.motion, 0, pose);
        KeypointTerm<B, double> term(backend, scene.rig, scene.views(6), scene.marks);
        typename B::template Buffer<vec3<double>> dL_dpose(4);
        backend.fill(Span<vec3<double>>(dL_dpose), vec3<double>(0));
        term.backward(0, pose, {.pose = dL_dpose, .coefficients = {}, .transl = {}});
        std::vector<vec3<double>> host(4);
        backend.download(Span<const vec3<double>>(dL_dpose), Span<vec3<double>>(host));
        host.push_back(vec3<double>(term.value(0, pose)));
        return host;
    };
    CHECK(numbers(threads) == numbers(scene.backend));
    CHECK(numbers(guarded) == numbers(scene.backend));
}

TEST_CASE("each person gets the nearest detection, once; other points and doubtful ones are left out") {
    const Camera<double> camera = look_at<double>({0, 0, 4}, {0, 0, 0}, {0, 1, 0}, 0.5, 200, 200);
    const BodyModel body = test::tube(2, 4, 4);
    const int shoulder = landmark_number("left_shoulder"), elbow = landmark_number("left_elbow"),
              nose = landmark_number("nose");
    Landmarks marks{}; // this body has two landmarks
    for (Landmark& mark : marks) mark.joint = -1;
    marks[static_cast<std::size_t>(shoulder)] = {0, vec3<double>(0), 0.02};
    marks[static_cast<std::size_t>(elbow)] = {1, vec3<double>(0), 0.02};
    std::vector<MotionLandmarks> posed;
    for (const double x : {-0.5, 0.5}) {
        Motion motion;
        motion.joint_count = 2, motion.pose.assign(2, vec3<double>(0)), motion.timestamps = {0};
        motion.transl = {vec3<double>(x, 0, 0)};
        posed.emplace_back(body, motion, marks);
    }
    const auto seen = [&](std::size_t person, double off, int landmark, double confidence) {
        const vec3<double> place = landmark == nose ? vec3<double>(0.5, 0.2, 0) : posed[person].at(0, landmark);
        return Keypoint{landmark, to_pixel(camera, to_camera(camera, place + vec3<double>(off, 0, 0))), confidence};
    };
    PhotoKeypoints photo{0, 0, {}};
    photo.people.push_back({{seen(1, -0.05, shoulder, 0.9), seen(1, 0, elbow, 0.1), seen(1, 0, nose, 1)}, {}});
    photo.people.push_back({{seen(0, 0.1, shoulder, 0.9), seen(0, 0, elbow, 0.8)}, {}});
    photo.people.push_back({{seen(1, 2.5, shoulder, 0.9)}, {}}); // somebody else
    const auto found = keypoints_of_people({photo}, {camera}, posed, 1);
    REQUIRE(found.size() == 2);
    REQUIRE(found[0][0].size() == 1);
    REQUIRE(found[1][0].size() == 1);
    CHECK(found[0][0][0].points.size() == 2);
    REQUIRE(found[1][0][0].points.size() == 1);
    CHECK(found[1][0][0].points[0].landmark == shoulder);
    CHECK(found[1][0][0].points[0].pixel == photo.people[0].points[0].pixel);
}

TEST_CASE("keypoints and settings that cannot be are refused") {
    Observed scene;
    const auto attempt = [&](Keypoint point, KeypointTermParams params = {}) {
        KeypointTerm<cpu::Serial, double>(scene.backend, scene.rig, {{{.camera = scene.cameras[0], .points = {point}}}}, scene.marks, params);
    };
    CHECK_NOTHROW(attempt({0, {1, 2}, 0.5}));
    CHECK_THROWS_AS(attempt({4, {1, 2}, 0.5}), ValueError);
    CHECK_THROWS_AS(attempt({-1, {1, 2}, 0.5}), ValueError);
    CHECK_THROWS_AS(attempt({0, {1, 2}, 1.5}), ValueError);
    CHECK_THROWS_AS(attempt({0, {std::nan(""), 2}, 1}), ValueError);
    CHECK_THROWS_AS(attempt({0, {1, 2}, 0.5}, {.weight = -1}), ValueError);
    CHECK_THROWS_AS(attempt({0, {1, 2}, 0.5}, {.reach = 0}), ValueError);
}
