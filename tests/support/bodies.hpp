// SPDX-License-Identifier: Apache-2.0
/// @file  Small bodies made by code, for tests that need a mesh, joints and directions but no file.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <numbers>

namespace gsh::test {

/// A closed tube along y with `joints` joints in a chain, smooth weights, random shape, expression and pose
/// directions. It has everything that a body file may contain.
inline BodyModel tube(std::size_t joints = 4, std::size_t rings = 20, std::size_t sides = 12, std::uint64_t seed = 1) {
    Rng rng(seed);
    BodyModel model;
    const double height = 1.6, radius = 0.2;
    for (std::size_t r = 0; r <= rings; ++r)
        for (std::size_t s = 0; s < sides; ++s) {
            const double angle = 2 * std::numbers::pi * static_cast<double>(s) / static_cast<double>(sides);
            const double y = height * static_cast<double>(r) / static_cast<double>(rings);
            model.v_template.push_back({radius * std::sin(angle), y, radius * std::cos(angle)});
        }
    const auto vertex = [&](std::size_t r, std::size_t s) { return static_cast<int>(r * sides + s % sides); };
    for (std::size_t r = 0; r < rings; ++r)
        for (std::size_t s = 0; s < sides; ++s) {
            model.faces.push_back({vertex(r, s), vertex(r, s + 1), vertex(r + 1, s + 1)});
            model.faces.push_back({vertex(r, s), vertex(r + 1, s + 1), vertex(r + 1, s)});
        }
    const auto bottom = static_cast<int>(model.v_template.size()), top = bottom + 1;
    model.v_template.push_back({0, 0, 0});
    model.v_template.push_back({0, height, 0});
    for (std::size_t s = 0; s < sides; ++s) {
        model.faces.push_back({bottom, vertex(0, s + 1), vertex(0, s)});
        model.faces.push_back({top, vertex(rings, s), vertex(rings, s + 1)});
    }

    const std::size_t V = model.v_template.size();
    const double spacing = height / static_cast<double>(joints);
    for (std::size_t j = 0; j < joints; ++j) {
        model.parents.push_back(static_cast<int>(j) - 1);
        std::vector<RegressorEntry> row; // the mean of the ring nearest to the joint
        const std::size_t ring = rings * j / joints;
        for (std::size_t s = 0; s < sides; ++s) row.push_back({vertex(ring, s), 1 / static_cast<double>(sides)});
        model.J_regressor.push_back(row);
    }
    for (std::size_t v = 0; v < V; ++v) {
        std::vector<double> row(joints, 0);
        double sum = 0;
        for (std::size_t j = 0; j < joints; ++j) {
            const double distance = model.v_template[v].y / spacing - static_cast<double>(j) - 0.5;
            if (std::abs(distance) < 1.2) sum += row[j] = 1.3 - std::abs(distance);
        }
        for (const double w : row) model.weights.push_back(w / sum);
    }
    model.shape_count = 3, model.expression_count = 2;
    model.shapedirs = rng.vecs(V * 3, -0.01, 0.01);
    model.exprdirs = rng.vecs(V * 2, -0.01, 0.01);
    model.posedirs = rng.vecs(V * 9 * (joints - 1), -0.01, 0.01);
    return model;
}

/// The posed body of a frame, in the world.
inline std::vector<vec3<double>> posed_vertices(const BodyModel& body, const Motion& motion, std::size_t frame) {
    return pose_body(body, motion.pose_at(frame), motion.transl[frame], motion.betas, motion.expression_at(frame))
        .vertices;
}

} // namespace gsh::test
