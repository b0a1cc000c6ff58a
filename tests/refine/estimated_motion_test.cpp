// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/refine/estimated_motion.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// A rig of four joints, and a motion whose root turns through half a turn.
struct TurningTube {
    static constexpr std::size_t joints = 4, shapes = 2, expressions = 2, frames = 3;
    using Estimate = EstimatedMotion<cpu::Serial, double>;

    test::Rng rng{12};
    cpu::Serial backend;
    RigData rig;
    Motion motion;

    TurningTube() {
        const BodyModel body = test::tube(joints, 8, 6);
        const std::vector<double> betas{0.2, -0.3};
        rig = make_rig(body, betas,
                       sample_surface(body, shaped_vertices(body, betas), std::vector(body.vertex_count(), 1.0), 4));
        motion.joint_count = joints;
        motion.expression_count = expressions;
        motion.betas = {0.4, 0.1};
        for (std::size_t t = 0; t < frames; ++t) {
            motion.pose.push_back({0.2, 2 + static_cast<double>(t), 0.1}); // 2, 3 and 4 radians
            for (std::size_t j = 1; j < joints; ++j) motion.pose.push_back(rng.vec(-0.5, 0.5));
            motion.expression.insert(motion.expression.end(), {rng.uniform(), rng.uniform()});
            motion.transl.push_back(rng.vec());
            motion.timestamps.push_back(static_cast<double>(t));
        }
    }
};

/// Increments of a frame in host memory.
struct TubeIncrements {
    std::vector<double> pose = std::vector<double>(3 * TurningTube::joints, 0.0),
                        transl = std::vector<double>(3, 0.0),
                        expression = std::vector<double>(TurningTube::expressions, 0.0),
                        betas = std::vector<double>(TurningTube::shapes, 0.0);

    PoseIncrements<const double> view() const { return {pose, transl, expression, betas}; }
    PoseIncrements<double> view() { return {pose, transl, expression, betas}; }
};

TubeIncrements random_increments(test::Rng& rng) {
    return {rng.numbers(3 * TurningTube::joints), rng.numbers(3), rng.numbers(TurningTube::expressions),
            rng.numbers(TurningTube::shapes)};
}

} // namespace

TEST_CASE("an estimated motion with increments of zero is bit-identical to the estimate") {
    TurningTube made;
    const TurningTube::Estimate estimate(made.backend, made.rig, made.motion);
    const Rig<cpu::Serial, double> rig(made.backend, made.rig);
    const TubeIncrements zero;
    RigPose<cpu::Serial, double> expected, found;
    for (std::size_t t = 0; t < TurningTube::frames; ++t) {
        rig.upload_pose(made.motion, t, expected);
        estimate.forward(t, zero.view(), found);
        CHECK(std::equal(expected.coefficients.begin(), expected.coefficients.end(), found.coefficients.begin()));
        CHECK(expected.transl[0] == found.transl[0]);
        for (std::size_t j = 0; j < TurningTube::joints; ++j) {
            if (length(expected.pose[j]) < 3.14159)
                CHECK(expected.pose[j] == found.pose[j]);
            else // the same rotation, by the shorter way
                CHECK(length(nearest_axis_angle(found.pose[j], expected.pose[j]) - expected.pose[j]) < 1e-12);
            CHECK(length(found.pose[j]) < 3.14160);
        }
    }
    const Motion same = estimate.corrected([&](std::size_t) { return zero.view(); });
    CHECK(length(same.pose[2 * TurningTube::joints] - made.motion.pose[2 * TurningTube::joints]) < 1e-12);
    CHECK(same.pose[0] == made.motion.pose[0]);
    CHECK(same.transl == made.motion.transl);
    CHECK(same.expression == made.motion.expression);
    CHECK(same.betas == made.motion.betas);
}

TEST_CASE("EstimatedMotion::backward is the gradient of forward, and adds") {
    TurningTube made;
    const TurningTube::Estimate estimate(made.backend, made.rig, made.motion);
    TubeIncrements w = random_increments(made.rng), dL_dw;
    for (double& angle : w.pose) angle *= 0.2;
    const std::size_t t = 1;
    std::vector<vec3<double>> dL_dpose = made.rng.vecs(TurningTube::joints), dL_dtransl = made.rng.vecs(1);
    std::vector<double> dL_dcoefficients = made.rng.numbers(TurningTube::shapes + TurningTube::expressions);
    RigPose<cpu::Serial, double> pose;
    const auto loss = [&] {
        estimate.forward(t, std::as_const(w).view(), pose);
        double sum = dot(pose.transl[0], dL_dtransl[0]);
        for (std::size_t j = 0; j < TurningTube::joints; ++j) sum += dot(pose.pose[j], dL_dpose[j]);
        for (std::size_t k = 0; k < dL_dcoefficients.size(); ++k) sum += pose.coefficients[k] * dL_dcoefficients[k];
        return sum;
    };
    const auto backward = [&] {
        estimate.backward(t, std::as_const(w).view(), {dL_dpose, dL_dcoefficients, dL_dtransl}, dL_dw.view());
    };
    backward();
    test::check_gradient(loss, w.pose, dL_dw.pose);
    test::check_gradient(loss, w.transl, dL_dw.transl);
    test::check_gradient(loss, w.expression, dL_dw.expression);
    test::check_gradient(loss, w.betas, dL_dw.betas);

    const TubeIncrements once = dL_dw;
    backward();
    for (std::size_t i = 0; i < once.pose.size(); ++i) CHECK(dL_dw.pose[i] == doctest::Approx(2 * once.pose[i]));
    CHECK(dL_dw.betas[1] == 2 * once.betas[1]);
    estimate.backward(t, std::as_const(w).view(), {}, dL_dw.view()); // no part has a gradient
    CHECK(dL_dw.betas[1] == 2 * once.betas[1]);
}

TEST_CASE("the corrected motion on the host has the poses that forward computes") {
    TurningTube made;
    const TurningTube::Estimate estimate(made.backend, made.rig, made.motion);
    std::vector<TubeIncrements> w;
    for (std::size_t t = 0; t < TurningTube::frames; ++t) w.push_back(random_increments(made.rng));
    for (TubeIncrements& frame : w) frame.betas = w[0].betas; // which belong to all frames
    const Motion corrected = estimate.corrected([&](std::size_t t) { return std::as_const(w[t]).view(); });
    RigPose<cpu::Serial, double> pose;
    for (std::size_t t = 0; t < TurningTube::frames; ++t) {
        estimate.forward(t, std::as_const(w[t]).view(), pose);
        for (std::size_t j = 0; j < TurningTube::joints; ++j) {
            const vec3<double> found = corrected.pose_at(t)[j], estimated = made.motion.pose_at(t)[j];
            CHECK(length(nearest_axis_angle(pose.pose[j], found) - found) < 1e-12);
            CHECK(length(nearest_axis_angle(found, estimated) - found) < 1e-12); // by the estimate's way round
        }
        CHECK(pose.transl[0] == corrected.transl[t]);
        for (std::size_t k = 0; k < TurningTube::shapes; ++k) CHECK(pose.coefficients[k] == corrected.betas[k]);
        for (std::size_t k = 0; k < TurningTube::expressions; ++k)
            CHECK(pose.coefficients[TurningTube::shapes + k] == corrected.expression_at(t)[k]);
    }
}

TEST_CASE("an estimate with fewer coefficients than the rig is completed") {
    TurningTube made;
    Motion bare = made.motion;
    bare.betas.clear();
    bare.expression_count = 1;
    bare.expression = {0.1, 0.2, 0.3};
    const TurningTube::Estimate without_shape(made.backend, made.rig, bare);
    CHECK(without_shape.motion().betas == made.rig.betas);
    CHECK(without_shape.motion().expression == std::vector<double>{0.1, 0, 0.2, 0, 0.3, 0});
    CHECK(without_shape.expression_count() == TurningTube::expressions);
    bare.betas = {0.7};
    CHECK(TurningTube::Estimate(made.backend, made.rig, bare).motion().betas == std::vector<double>{0.7, 0});
}

TEST_CASE("an estimate that does not fit the rig, and increments of other sizes, are refused") {
    TurningTube made;
    const auto make = [&](auto change) {
        Motion motion = made.motion;
        change(motion);
        return TurningTube::Estimate(made.backend, made.rig, motion);
    };
    CHECK_THROWS_AS(make([](Motion& m) { m.betas = {1, 2, 3}; }), ValueError);
    CHECK_THROWS_AS(make([](Motion& m) { m.expression_count = 3, m.expression.resize(9); }), ValueError);
    CHECK_THROWS_AS(make([](Motion& m) { m.joint_count = 3; }), ShapeError);
    CHECK_THROWS_AS(make([](Motion& m) { m.transl[1].y = NAN; }), ValueError);
    CHECK_THROWS_AS(make([](Motion& m) { m.pose = {}, m.expression = {}, m.transl = {}, m.timestamps = {}; }),
                    ValueError);

    const TurningTube::Estimate estimate = make([](Motion&) {});
    RigPose<cpu::Serial, double> pose;
    const TubeIncrements good;
    TubeIncrements gradient;
    CHECK_THROWS_AS(estimate.forward(TurningTube::frames, good.view(), pose), ValueError);
    for (auto part : {&TubeIncrements::pose, &TubeIncrements::transl, &TubeIncrements::expression,
                      &TubeIncrements::betas}) {
        TubeIncrements wrong;
        (wrong.*part).push_back(0);
        CHECK_THROWS_AS(estimate.forward(0, std::as_const(wrong).view(), pose), ShapeError);
        CHECK_THROWS_AS(estimate.backward(0, good.view(), {}, wrong.view()), ShapeError);
    }
    std::vector<vec3<double>> three(3);
    std::vector<double> one(1);
    CHECK_THROWS_AS(estimate.backward(0, good.view(), {three, {}, {}}, gradient.view()), ShapeError);
    CHECK_THROWS_AS(estimate.backward(0, good.view(), {{}, one, {}}, gradient.view()), ShapeError);
    CHECK_THROWS_AS(estimate.backward(0, good.view(), {{}, {}, three}, gradient.view()), ShapeError);
}
