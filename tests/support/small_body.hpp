// SPDX-License-Identifier: Apache-2.0
/// @file  A body small enough for finite differences: a bent tube of four joints with every kind of blend shape.
#pragma once

#include <gsh/body/body_model.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <numbers>

namespace gsh::test {

/// `rings` rings of six vertices along y, hung on a chain of three joints with a fourth as a side branch; random
/// shape, expression and pose directions.
inline BodyModel small_body(int rings = 6, int shape_count = 2, int expression_count = 2, std::uint64_t seed = 11) {
    constexpr int sides = 6, joints = 4;
    Rng rng(seed);
    BodyModel body;
    body.parents = {-1, 0, 1, 1};
    body.shape_count = shape_count;
    body.expression_count = expression_count;
    for (int ring = 0; ring < rings; ++ring)
        for (int side = 0; side < sides; ++side) {
            const double angle = 2 * std::numbers::pi * side / sides, along = static_cast<double>(ring) / (rings - 1);
            body.v_template.push_back({0.2 * std::cos(angle), along - 0.5, 0.2 * std::sin(angle)});
            double row[joints] = {1 - along, 0.4 * along, 0.4 * along, 0.2 * along};
            for (const double weight : row) body.weights.push_back(weight);
        }
    const int V = static_cast<int>(body.v_template.size());
    for (int ring = 0; ring + 1 < rings; ++ring)
        for (int side = 0; side < sides; ++side) {
            const int a = ring * sides + side, b = ring * sides + (side + 1) % sides;
            body.faces.push_back({a, a + sides, b});
            body.faces.push_back({b, a + sides, b + sides});
        }
    body.shapedirs = rng.vecs(static_cast<std::size_t>(V * shape_count), -0.05, 0.05);
    body.exprdirs = rng.vecs(static_cast<std::size_t>(V * expression_count), -0.05, 0.05);
    body.posedirs = rng.vecs(static_cast<std::size_t>(V * 9 * (joints - 1)), -0.02, 0.02);
    for (int joint = 0; joint < joints; ++joint) {
        std::vector<RegressorEntry> row;
        for (int side = 0; side < sides; ++side)
            row.push_back({std::min(joint, rings - 1) * sides + side, 1.0 / sides});
        body.J_regressor.push_back(row);
    }
    validate(body, "small_body");
    return body;
}

} // namespace gsh::test
