// SPDX-License-Identifier: Apache-2.0
/// @file  The energy's derivatives against central differences, and its step against the energy's own curvature.
#include <gsh/fit/motion_problem.hpp>

#include "fit/filmed_person.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

using namespace gsh;

namespace {

/// Four frames at uneven times, two cameras, a state beside the truth.
struct Fixture {
    const BodyModel& model = test::fitted_actor();
    Motion motion = actor_motion(ActorMotion::stride, 4);
    std::vector<Camera<double>> cameras = test::cameras_around(2);
    FittedBody body{model, 3};
    std::vector<std::vector<ViewKeypoints>> views{4};
    std::vector<double> times{0, 0.1, 0.22, 0.3};
    MotionProblem problem{body, views, times};
    MotionState state;
    std::vector<std::uint8_t> mask;
    OutlineSamples samples{model, body, 300};

    explicit Fixture(double noise) {
        for (const PersonPhoto& photo : test::seen(model, motion, cameras, noise)) {
            if (photo.frame == 2 && photo.camera == 0) continue; // a view is missing
            views[photo.frame].push_back(
                {cameras[photo.camera], photo.person.points, photo.person.metric, photo.camera, {}});
        }
        test::Rng rng(4);
        for (std::size_t t = 0; t < 4; ++t) {
            FrameNumbers frame;
            frame.root = rotation_from_axis_angle(motion.pose_at(t)[0] + rng.vec(-0.1, 0.1));
            frame.transl = motion.transl[t] + rng.vec(-0.05, 0.05);
            frame.angles = rng.numbers(body.axes.size(), -0.4, 0.4);
            state.frames.push_back(frame);
        }
        state.betas = rng.numbers(3, -1, 1);
        problem.set_height(1.7, {0.03, -0.02, 0.01});
        problem.set_reference(state);
        state.held_angles = rng.numbers(body.limb_axes, -0.2, 0.2); // no means: they are unknowns of their own
        state.axis = vec3<double>(0.1, 0.95, -0.05);
        state.log_focal = 0.07;
        // A mask that ends at a vertical line through each image.
        mask.assign(480 * 640, 0);
        for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = i % 480 < 245 ? 255 : 0;
        std::vector<std::vector<std::vector<OutlinePoint>>> points(4);
        std::size_t found = 0;
        for (std::size_t t = 0; t < 4; ++t)
            for (const ViewKeypoints& view : views[t]) {
                points[t].push_back(
                    samples.find(body, state.frames[t], state.betas, view.camera, 1, {640, 480, mask.data()}, 0.1));
                found += points[t].back().size();
            }
        REQUIRE(found > 20);
        problem.set_outlines(samples, points, state.betas);
        for (double& beta : state.betas) beta += 0.2; // not where the outlines were found
    }

    /// A step of one number, as the solver would take it (it subtracts).
    [[nodiscard]] BorderedBand::Solution unit(const BorderedBand& system, std::size_t frame, Eigen::Index number,
                                              double size) const {
        BorderedBand::Solution step;
        for (const BorderedBand::Rows& rows : system.rows)
            step.x.push_back(BorderedBand::Vector::Zero(rows.right.size()));
        step.y = BorderedBand::Vector::Zero(system.shared_right.size());
        if (frame < system.rows.size())
            step.x[frame][number] = -size;
        else
            step.y[number] = -size;
        return step;
    }
};

MotionTerms all_terms() {
    return {.statue = 3, .outline = 20, .focal_spread = 0.15, .height = 1.8};
}

} // namespace

TEST_CASE("the right side is half the gradient of the energy, for every number of every frame and all shared ones") {
    for (const bool fingers : {true, false}) {
        const Fixture scene(0.03);
        MotionTerms terms = all_terms();
        terms.fingers = fingers;
        BorderedBand system = scene.problem.make_system(terms);
        const double energy = scene.problem.evaluate(scene.state, terms, &system);
        CHECK(energy == doctest::Approx(scene.problem.evaluate(scene.state, terms)).epsilon(1e-12));
        double largest = 0;
        for (const auto& rows : system.rows) largest = std::max(largest, rows.right.lpNorm<Eigen::Infinity>());
        const auto check = [&](std::size_t frame, Eigen::Index number, double half) {
            constexpr double h = 1e-5;
            const auto at = [&](double size) {
                return scene.problem.evaluate(
                    scene.problem.stepped(scene.state, scene.unit(system, frame, number, size)), terms);
            };
            CAPTURE(frame);
            CAPTURE(number);
            CHECK(std::abs((at(h) - at(-h)) / (2 * h) - 2 * half) < 1e-5 * (2 * std::abs(half) + 1e-2 * largest));
        };
        for (std::size_t t = 0; t < 4; ++t)
            for (Eigen::Index k = 0; k < system.rows[t].right.size(); ++k) check(t, k, system.rows[t].right[k]);
        REQUIRE(system.shared_right.size() == 3 + 1 + 63 + 3);
        for (Eigen::Index k = 0; k < system.shared_right.size(); ++k) check(4, k, system.shared_right[k]);
    }
}

TEST_CASE("where residuals vanish, the system's matrix is half the energy's second derivative") {
    // Keypoints without an error, at the truth: the Gauss-Newton matrix is exact there.
    Fixture scene(0);
    for (auto& frame : scene.views)
        for (ViewKeypoints& view : frame) view.metric.clear();
    const FittedBody& body = scene.body;
    scene.state.betas.assign(3, 0);
    scene.state.log_focal = 0;
    // A pose of our axes, and what a detector sees of it.
    for (std::size_t t = 0; t < 4; ++t) {
        const FrameKinematics kinematics(body, scene.state.frames[t], scene.state.betas);
        for (ViewKeypoints& view : scene.views[t])
            for (Keypoint& point : view.points)
                point.pixel = to_pixel(view.camera, to_camera(view.camera, kinematics.landmark(point.landmark)));
    }
    scene.problem.set_reference(scene.state);
    const MotionTerms terms{
        .metric = 0, .prior = 1e-9, .finger_prior = 1e-9, .acceleration = 0, .betas = 1e-9, .focal_spread = 0.15};
    BorderedBand system = scene.problem.make_system(terms);
    scene.problem.evaluate(scene.state, terms, &system);
    test::Rng rng(12);
    for (int trial = 0; trial < 4; ++trial) {
        BorderedBand::Solution direction;
        double quadratic = 0;
        direction.y = BorderedBand::Vector::Zero(system.shared_right.size());
        for (Eigen::Index k = 0; k < 4; ++k) direction.y[k] = rng.uniform(-1, 1);
        quadratic += direction.y.dot(system.corner * direction.y);
        for (const auto& rows : system.rows) {
            BorderedBand::Vector x(rows.right.size());
            for (Eigen::Index k = 0; k < x.size(); ++k) x[k] = rng.uniform(-1, 1) * (trial % 2 == 0 || k >= 6);
            quadratic +=
                x.dot(rows.diagonal.selfadjointView<Eigen::Lower>() * x) + 2 * x.dot(rows.border * direction.y);
            direction.x.push_back(x);
        }
        const auto at = [&](double size) {
            BorderedBand::Solution step = direction;
            for (auto& x : step.x) x *= size;
            step.y *= size;
            return scene.problem.evaluate(scene.problem.stepped(scene.state, step), terms);
        };
        constexpr double h = 2e-5;
        const double second = (at(h) - 2 * at(0) + at(-h)) / (h * h);
        CHECK(second == doctest::Approx(2 * quadratic).epsilon(2e-3));
    }
}

TEST_CASE("what is held stays: shape and focal length, or the focal length alone") {
    const Fixture scene(0.03);
    MotionTerms terms = all_terms();
    terms.hold_shared = true;
    BorderedBand system = scene.problem.make_system(terms);
    scene.problem.evaluate(scene.state, terms, &system);
    const BorderedBand::Solution held = system.solve(1e-2, 1e-6);
    CHECK(held.y.head(4).norm() == 0);
    CHECK(held.y.tail(66).norm() > 0);
    terms.hold_shared = false, terms.focal_spread = 0;
    scene.problem.evaluate(scene.state, terms, &system);
    const BorderedBand::Solution free = system.solve(1e-2, 1e-6);
    CHECK(free.y[3] == 0);
    CHECK(free.y.head(3).norm() > 0);
}

TEST_CASE("a point that is far off pulls no harder than one that is a few spreads away") {
    Fixture scene(0);
    MotionTerms terms{.metric = 0, .acceleration = 0};
    const auto force = [&](double pixels) {
        Fixture moved(0);
        for (Keypoint& point : moved.views[1][0].points)
            if (point.landmark == landmark_number("left_wrist")) point.pixel.x += pixels;
        BorderedBand system = moved.problem.make_system(terms);
        moved.problem.evaluate(moved.state, terms, &system);
        BorderedBand other = scene.problem.make_system(terms);
        scene.problem.evaluate(scene.state, terms, &other);
        return (system.rows[1].right - other.rows[1].right).norm();
    };
    CHECK(force(400) < 1.6 * force(100));
}
