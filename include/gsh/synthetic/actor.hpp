// SPDX-License-Identifier: Apache-2.0
/// @file  A procedural person: mesh, joints, weights, shape and expression directions in the layout of SMPL-X.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/synthetic/actor_directions.hpp>
#include <gsh/synthetic/actor_mesh.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

struct ActorParams {
    double edge_scale = 1; ///< edge lengths relative to the default mesh of about 17,000 vertices; 0.7 .. 1.5
};

/// The actor as a body model: a closed, connected surface in T-pose with separate fingers, an open gap between the
/// lips and eyeballs behind lids; 55 joints in SMPL-X's order, 10 shape and 10 expression directions
/// (actor_shape_names, actor_expression_names), region lists, no pose correctives, no mean hand.
///
/// Frame   y up, facing +z, its left at +x; the pelvis is at the origin, soles at y = ActorOutfit::sole_y.
/// Errors  ValueError if edge_scale is out of range.
[[nodiscard]] inline BodyModel make_actor(const ActorParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Positive weights of vertices near `target` whose weighted mean is exactly `target`. They are Gaussian weights times
/// exp(tilt·(x - target)); Newton's method on a convex function finds the tilt. The radius grows until that succeeds.
inline std::vector<RegressorEntry> regressor_row(Span<const vec3<double>> vertices, const vec3<double>& target) {
    double nearest = 1;
    for (const auto& v : vertices) nearest = std::min(nearest, length(v - target));
    for (double radius = 1.3 * nearest + 0.004;; radius *= 1.25) {
        std::vector<RegressorEntry> row;
        for (std::size_t v = 0; v < vertices.size(); ++v) {
            const double t = length(vertices[v] - target) / radius;
            if (t < 1) row.push_back({static_cast<int>(v), (1 - t * t) * (1 - t * t)});
        }
        vec3<double> tilt(0), mean(0);
        double sum = 0;
        const auto offset = [&](const RegressorEntry& e) {
            return (vertices[static_cast<std::size_t>(e.vertex)] - target) / radius;
        };
        for (int step = 0; step < 60; ++step) {
            mat3<double> second(0.0);
            mean = vec3<double>(0), sum = 0;
            for (const auto& e : row) {
                const vec3<double> d = offset(e);
                const double w = e.weight * std::exp(dot(tilt, d));
                sum += w, mean += w * d, second += outer(d, d) * w;
            }
            mean /= sum;
            if (length(mean) < 1e-13) break;
            const vec3<double> change = inverse(second / sum - outer(mean, mean) + mat3<double>(1e-9)) * mean;
            tilt -= change * std::min(1.0, 2.0 / length(change));
        }
        if (!(length(mean) < 1e-9 && length(tilt) < 12)) continue; // the target is not well inside this neighbourhood
        for (auto& e : row) e.weight *= std::exp(dot(tilt, offset(e))) / sum;
        return row;
    }
}

/// Whether a point is on the front of the head, between chin and hair line.
inline bool on_face(const Point& p) {
    return p.z > 0.045 && p.y > 0.550 + 0.5 * std::max(0.0, 0.09 - p.z) && std::abs(p.x) < 0.074 &&
           hair_amount({std::abs(p.x), p.y, p.z}) < 0.5;
}

} // namespace detail

inline BodyModel make_actor(const ActorParams& params) {
    check_value(params.edge_scale >= 0.7 && params.edge_scale <= 1.5, "make_actor",
                "edge_scale must lie in 0.7 .. 1.5");
    TriangleMesh mesh = actor_mesh(params.edge_scale);
    BodyModel body;
    body.v_template = std::move(mesh.vertices);
    body.faces = std::move(mesh.faces);
    body.shape_count = static_cast<int>(actor_shape_names.size());
    body.expression_count = static_cast<int>(actor_expression_names.size());
    for (const auto& joint : actor_joints) {
        body.parents.push_back(joint.parent);
        body.joint_names.emplace_back(joint.name);
    }
    for (std::size_t v = 0; v < body.vertex_count(); ++v) {
        const vec3<double>& p = body.v_template[v];
        const ActorWeights weights = actor_weights(p);
        const auto shape = actor_shape_directions(p, weights);
        const auto expression = actor_expression_directions(p);
        body.weights.insert(body.weights.end(), weights.begin(), weights.end());
        body.shapedirs.insert(body.shapedirs.end(), shape.begin(), shape.end());
        body.exprdirs.insert(body.exprdirs.end(), expression.begin(), expression.end());

        const auto moves = [](const vec3<double>& d) { return dot(d, d) > 0; };
        const int id = static_cast<int>(v);
        if (detail::on_face(p) || std::any_of(expression.begin(), expression.end(), moves))
            body.face_vertices.push_back(id);
        const auto hand = [&](int wrist, int first_finger) {
            double sum = weights[static_cast<std::size_t>(wrist)];
            for (int j = first_finger; j < first_finger + actor_finger_joints; ++j)
                sum += weights[static_cast<std::size_t>(j)];
            return sum > 0.5;
        };
        if (hand(smplx::left_wrist, smplx::left_index1)) body.left_hand_vertices.push_back(id);
        if (hand(smplx::left_wrist + 1, smplx::right_index1)) body.right_hand_vertices.push_back(id);
    }
    for (int joint = 0; joint < actor_joint_count; ++joint)
        body.J_regressor.push_back(detail::regressor_row(body.v_template, actor_joint(joint)));
    return body;
}

} // namespace gsh
