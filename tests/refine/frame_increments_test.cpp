// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/refine/frame_increments.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace gsh {
namespace {

using B = cpu::Serial;

/// Tables of 3 frames and 2 joints with random increments.
struct Tables {
    B backend;
    RefinementTables<B, double> tables;

    explicit Tables(bool bias)
        : tables(backend, {.frames = 3, .joints = 2, .expression = 2, .betas = 1, .pose_bias = bias, .transl_bias = bias}) {
        test::Rng rng(5);
        auto host = tables.host_increments();
        for (std::size_t g = 0; g < refinement_group_count; ++g) {
            const auto group = static_cast<RefinementGroup>(g);
            for (std::size_t row = 0; row < tables.rows(group); ++row) {
                const auto numbers = rng.numbers(tables.width(group), -1, 1);
                std::copy(numbers.begin(), numbers.end(), host(group, row).begin());
            }
        }
        tables.set_increments(host);
    }
};

} // namespace

TEST_CASE("A frame has its own increments plus the bias; without a bias they are its own rows, not copied") {
    Tables with(true), without(false);
    FrameIncrements<B, double> sum(with.backend), plain(without.backend);
    for (std::size_t frame = 0; frame < 3; ++frame) {
        const PoseIncrements<const double> w = sum.forward(with.tables, frame);
        for (std::size_t i = 0; i < 6; ++i)
            CHECK(w.pose[i] == with.tables.increments(RefinementGroup::pose, frame)[i] +
                                   with.tables.increments(RefinementGroup::pose_bias, 0)[i]);
        for (std::size_t i = 0; i < 3; ++i)
            CHECK(w.transl[i] == with.tables.increments(RefinementGroup::transl, frame)[i] +
                                     with.tables.increments(RefinementGroup::transl_bias, 0)[i]);
        CHECK(w.betas.data() == with.tables.increments(RefinementGroup::betas, 0).data());
        CHECK(plain.forward(without.tables, frame).pose.data() ==
              without.tables.increments(RefinementGroup::pose, frame).data());
    }
}

TEST_CASE("The gradient reaches the frame and the bias, as central differences say, and adds to both") {
    Tables scene(true);
    FrameIncrements<B, double> sum(scene.backend);
    test::Rng rng(6);
    const std::vector<double> weights = rng.numbers(6 + 3 + 2 + 1, -1, 1); // L = Σ weight x², over all parts
    const auto loss = [&](std::size_t frame) {
        const PoseIncrements<const double> w = sum.forward(scene.tables, frame);
        double total = 0;
        std::size_t k = 0;
        for (const Span<const double> part : {w.pose, w.transl, w.expression, w.betas})
            for (const double x : part) total += weights[k++] * x * x;
        return total;
    };
    const auto backward = [&](std::size_t frame) {
        sum.backward(scene.tables, frame, [&](const auto& w, const PoseIncrements<double>& dL_dw) {
            const Span<const double> values[] = {w.pose, w.transl, w.expression, w.betas};
            const Span<double> gradients[] = {dL_dw.pose, dL_dw.transl, dL_dw.expression, dL_dw.betas};
            std::size_t k = 0;
            for (std::size_t part = 0; part < 4; ++part)
                for (std::size_t i = 0; i < values[part].size(); ++i)
                    gradients[part][i] += 2 * weights[k++] * values[part][i];
        });
    };
    backward(1);
    backward(2);
    for (std::size_t g = 0; g < refinement_group_count; ++g) {
        const auto group = static_cast<RefinementGroup>(g);
        for (std::size_t row = 0; row < scene.tables.rows(group); ++row)
            for (std::size_t i = 0; i < scene.tables.width(group); ++i) {
                double& x = scene.tables.increments(group, row)[i];
                const double before = x, h = 1e-6;
                x = before + h;
                const double above = loss(1) + loss(2);
                x = before - h;
                const double below = loss(1) + loss(2);
                x = before;
                CHECK(scene.tables.gradient(group, row)[i] == doctest::Approx((above - below) / (2 * h)).epsilon(1e-7));
            }
    }
}

TEST_CASE("a frame that is left out lies between its neighbours in time, or is as the nearest one") {
    Tables scene(true);
    const auto pose = [&](std::size_t frame) {
        const Span<const double> row = std::as_const(scene.tables).increments(RefinementGroup::pose, frame);
        return std::vector<double>(row.begin(), row.end());
    };
    const std::vector<double> first = pose(0), last = pose(2), bias = [&] {
        const Span<const double> row = std::as_const(scene.tables).increments(RefinementGroup::pose_bias, 0);
        return std::vector<double>(row.begin(), row.end());
    }();
    carry_increments(scene.tables, {0, 0.1, 0.4}, {false, true, false});
    for (std::size_t i = 0; i < 6; ++i) CHECK(pose(1)[i] == doctest::Approx(0.75 * first[i] + 0.25 * last[i]));
    CHECK(pose(0) == first);
    CHECK(scene.tables.increments(RefinementGroup::pose_bias, 0)[0] == bias[0]);
    const std::vector<double> middle = pose(1);
    carry_increments(scene.tables, {0, 0.1, 0.4}, {true, false, true});
    CHECK(pose(0) == middle);
    CHECK(pose(2) == middle);
    carry_increments(scene.tables, {0, 0.1, 0.4}, {true, true, true}); // nothing to take them from
    CHECK(pose(1) == middle);
}

} // namespace gsh
