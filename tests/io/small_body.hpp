// SPDX-License-Identifier: Apache-2.0
/// @file  A body of a few vertices with all arrays, for tests that damage its file, and a motion of it.
#pragma once

#include "support/gradient.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>

#include <algorithm>
#include <string>

namespace gsh::test {

/// A column of `joints` joints, 5 cm apart and each with a vertex of its own, plus two vertices to the side.
inline BodyModel small_body(std::size_t joints = 55, int shapes = 3, int expressions = 2, bool hands = false) {
    test::Rng rng(5);
    BodyModel model;
    const std::size_t V = joints + 2;
    for (std::size_t v = 0; v < V; ++v)
        model.v_template.emplace_back(v < joints ? 0.0 : 0.3, 0.05 * static_cast<double>(v % joints),
                                      0.02 * static_cast<double>(v % 3));
    model.shape_count = shapes;
    model.expression_count = expressions;
    model.shapedirs = rng.vecs(V * static_cast<std::size_t>(shapes), -0.01, 0.01);
    model.exprdirs = rng.vecs(V * static_cast<std::size_t>(expressions), -0.01, 0.01);
    for (std::size_t j = 0; j < joints; ++j) {
        model.parents.push_back(static_cast<int>(j) - 1);
        model.J_regressor.push_back({{static_cast<int>(j), 0.75}, {static_cast<int>(joints), 0.25}});
    }
    model.weights.assign(V * joints, 0.0);
    for (std::size_t v = 0; v < V; ++v) {
        model.weights[v * joints + v % joints] += 0.5;
        model.weights[v * joints + (v + 1) % joints] += 0.5;
    }
    for (int v = 0; v + 2 < static_cast<int>(V); ++v) model.faces.push_back({v, v + 1, v + 2});
    if (hands) {
        model.hands_mean_left = rng.vecs(15, -0.5, 0.5);
        model.hands_mean_right = rng.vecs(15, -0.5, 0.5);
        model.hands_components_left = rng.numbers(45 * 45);
        model.hands_components_right = rng.numbers(45 * 45);
    }
    return model;
}

/// A motion with the same pose in all joints and frames, one frame a second, four metres ahead.
inline Motion still_motion(const BodyModel& body, std::size_t frames) {
    Motion motion;
    motion.joint_count = body.joint_count(), motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas.assign(static_cast<std::size_t>(body.shape_count), 0);
    motion.pose.assign(frames * body.joint_count(), vec3<double>(0.1, 0, 0));
    motion.expression.assign(frames * motion.expression_count, 0);
    motion.transl.assign(frames, vec3<double>(0, -0.8, 4));
    for (std::size_t t = 0; t < frames; ++t) motion.timestamps.push_back(static_cast<double>(t));
    return motion;
}

} // namespace gsh::test
