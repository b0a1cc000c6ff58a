// SPDX-License-Identifier: Apache-2.0
/// @file  A skinned, blend-shaped body mesh: SMPL, SMPL-H, SMPL-X, or any rig described by the same arrays.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// One non-zero of a joint regressor row: joint += weight * vertex.
struct RegressorEntry {
    int vertex = 0;
    double weight = 0;
};

/// The body model, stored on the host in double precision regardless of the file's number type.
///
/// Shapes  given at each member; V vertices, J joints, S shape and E expression directions, F triangles. Direction k of
///         vertex v is at [v * count + k], as in the files.
/// Frame   y up, subject facing +z, its left at +x; the template's zero pose is the canonical pose.
/// Units   metres; directions in metres per unit coefficient.
struct BodyModel {
    std::vector<vec3<double>> v_template;                 // [V]
    std::vector<vec3<double>> shapedirs;                  // [V, S]
    std::vector<vec3<double>> exprdirs;                   // [V, E]
    std::vector<vec3<double>> posedirs;                   // [V, 9 (J - 1)], or empty: no pose blend shapes
    std::vector<std::vector<RegressorEntry>> J_regressor; // [J] sparse rows, applied to the shaped mesh
    std::vector<double> weights;                          // [V, J], rows sum to 1
    std::vector<int> parents;                             // [J], the root's is -1; a parent precedes its children
    std::vector<std::array<int, 3>> faces;                // [F], counter-clockwise from outside
    int shape_count = 0;                                  ///< S
    int expression_count = 0;                             ///< E

    // Optional contents of a model file; empty if the file does not have them.
    std::vector<vec2<double>> vt;                // texture coordinates, v up
    std::vector<std::array<int, 3>> ft;          // [F] triples into vt
    std::vector<std::string> joint_names;        // [J]
    std::vector<vec3<double>> hands_mean_left;   // [15] axis-angle, added unless the pose is marked flat_hand
    std::vector<vec3<double>> hands_mean_right;  // [15]
    std::vector<double> hands_components_left;   // [C, 45] principal components of the hand pose, a row each
    std::vector<double> hands_components_right;  // [C, 45]
    std::vector<int> face_vertices;              // vertex indices of the regions
    std::vector<int> left_hand_vertices;
    std::vector<int> right_hand_vertices;

    [[nodiscard]] std::size_t vertex_count() const { return v_template.size(); }
    [[nodiscard]] std::size_t joint_count() const { return parents.size(); }
    /// Length of the pose feature vec(R - I) of the non-root joints.
    [[nodiscard]] std::size_t pose_feature_count() const { return parents.empty() ? 0 : 9 * (parents.size() - 1); }
};

/// Throws ShapeError or ValueError at the first inconsistency: array sizes that disagree, NaN, weights that do not sum
/// to 1 (within 1e-3), a tree with a cycle, two roots, a child before its parent, or an index out of range. `where` (a
/// file or a function) appears in the message.
inline void validate(const BodyModel& model, std::string_view where);

/// v_template + shapedirs betas + exprdirs expression; missing trailing coefficients count as 0.
///
/// Errors  ShapeError if there are more coefficients than directions.
[[nodiscard]] inline std::vector<vec3<double>> shaped_vertices(const BodyModel& model, Span<const double> betas,
                                                               Span<const double> expression = {});

/// Joint positions J_regressor * vertices, [J].
[[nodiscard]] inline std::vector<vec3<double>> regress_joints(const BodyModel& model,
                                                              Span<const vec3<double>> vertices);

/// The change of the joints per unit of each coefficient, J_regressor * directions: [J, count] for [V, count]
/// directions. Since regression is linear, joints(β, ψ) = joints(0, 0) + joint_directions · (β, ψ).
[[nodiscard]] inline std::vector<vec3<double>> joint_directions(const BodyModel& model,
                                                                Span<const vec3<double>> directions);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Numbers of bodies and motions are at most 1e30, so that products of them are finite.
inline void check_magnitude(std::string_view where, std::string_view argument, Span<const double> values) {
    check_finite<double>(where, argument, values);
    constexpr double most = 1e30;
    for (std::size_t i = 0; i < values.size(); ++i)
        if (!(std::abs(values[i]) <= most))
            throw ValueError(std::string(where) + ": " + std::string(argument) + "[" + std::to_string(i) + "] is " +
                             number_text(values[i]) + ", expected at most 1e30");
}

inline void check_coordinates(std::string_view where, std::string_view argument, Span<const vec3<double>> values) {
    check_magnitude(where, argument, {values.empty() ? nullptr : &values[0].x, 3 * values.size()});
}

inline void check_index_range(std::string_view where, std::string_view argument, Span<const int> indices,
                              std::size_t count) {
    for (std::size_t i = 0; i < indices.size(); ++i)
        if (indices[i] < 0 || static_cast<std::size_t>(indices[i]) >= count)
            throw ValueError(std::string(where) + ": " + std::string(argument) + "[" + std::to_string(i) + "] is " +
                             std::to_string(indices[i]) + ", expected an index below " + std::to_string(count));
}

inline void check_triangles(std::string_view where, std::string_view argument,
                            const std::vector<std::array<int, 3>>& triangles, std::size_t count) {
    check_index_range(where, argument, {triangles.empty() ? nullptr : triangles[0].data(), 3 * triangles.size()},
                      count);
}

inline void check_tree(std::string_view where, Span<const int> parents) {
    const auto at = [&](std::size_t joint) { return std::string(where) + ": joint " + std::to_string(joint); };
    const int count = static_cast<int>(parents.size());
    for (std::size_t j = 0; j < parents.size(); ++j)
        if (parents[j] < -1 || parents[j] >= count)
            throw ValueError(at(j) + " has parent " + std::to_string(parents[j]) +
                             ", expected -1 for the root or a joint below " + std::to_string(count));
    std::vector<int> visitor(parents.size(), -1); // the joint from which a joint was first reached
    for (std::size_t j = 0; j < parents.size(); ++j)
        for (int joint = static_cast<int>(j); joint >= 0; joint = parents[static_cast<std::size_t>(joint)]) {
            int& seen = visitor[static_cast<std::size_t>(joint)];
            if (seen == static_cast<int>(j))
                throw ValueError(at(j) + " lies on a cycle of the kinematic tree; parents must lead to the root");
            if (seen >= 0) break; // from there on to the root, as was seen before
            seen = static_cast<int>(j);
        }
    for (std::size_t j = 0; j < parents.size(); ++j) {
        if ((parents[j] < 0) != (j == 0))
            throw ValueError(at(j) + (j == 0 ? " has a parent; the first joint must be the root"
                                             : " is a second root; give it a parent"));
        if (parents[j] > static_cast<int>(j))
            throw ValueError(at(j) + " comes before its parent " + std::to_string(parents[j]) +
                             "; order the joints so that parents come first");
    }
}

inline void check_coefficients(std::string_view where, std::string_view argument, std::size_t found,
                               std::size_t available) {
    if (found > available)
        throw ShapeError(std::string(where) + ": " + std::string(argument) + " has " + std::to_string(found) +
                         " elements, the model has " + std::to_string(available) + " such directions; drop the rest");
}

} // namespace detail

inline void validate(const BodyModel& model, std::string_view where) {
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    check_value(V > 0, where, "v_template is empty, expected at least one vertex");
    check_value(J > 0, where, "the kinematic tree is empty, expected at least one joint");
    check_value(J <= 65535, where, "there are more than 65535 joints");
    check_value(model.shape_count >= 0 && model.expression_count >= 0, where, "a count of directions is negative");
    detail::check_tree(where, model.parents);

    check_size(where, "shapedirs", model.shapedirs.size(), V * static_cast<std::size_t>(model.shape_count));
    check_size(where, "exprdirs", model.exprdirs.size(), V * static_cast<std::size_t>(model.expression_count));
    if (!model.posedirs.empty())
        check_size(where, "posedirs", model.posedirs.size(), V * model.pose_feature_count(),
                   "store 9 directions per vertex and non-root joint");
    check_size(where, "weights", model.weights.size(), V * J, "store one weight per vertex and joint");
    check_size(where, "J_regressor", model.J_regressor.size(), J, "store one row per joint");
    detail::check_coordinates(where, "v_template", model.v_template);
    detail::check_coordinates(where, "shapedirs", model.shapedirs);
    detail::check_coordinates(where, "exprdirs", model.exprdirs);
    detail::check_coordinates(where, "posedirs", model.posedirs);
    check_finite<double>(where, "weights", model.weights);

    for (std::size_t v = 0; v < V; ++v) {
        double sum = 0;
        for (std::size_t j = 0; j < J; ++j) {
            const double weight = model.weights[v * J + j];
            if (weight < -1e-6)
                throw ValueError(std::string(where) + ": weights of vertex " + std::to_string(v) + " hold " +
                                 detail::number_text(weight) + ", expected no negative number");
            sum += weight;
        }
        if (!(std::abs(sum - 1) <= 1e-3))
            throw ValueError(std::string(where) + ": weights of vertex " + std::to_string(v) + " sum to " +
                             detail::number_text(sum) + ", expected 1; normalise the rows of the file");
    }
    for (std::size_t j = 0; j < J; ++j) {
        double sum = 0;
        for (const auto& [vertex, weight] : model.J_regressor[j]) {
            if (vertex < 0 || static_cast<std::size_t>(vertex) >= V || !(std::abs(weight) <= 1e30))
                throw ValueError(std::string(where) + ": J_regressor row " + std::to_string(j) + " holds weight " +
                                 detail::number_text(weight) + " of vertex " + std::to_string(vertex) +
                                 ", expected a finite weight of a vertex below " + std::to_string(V));
            sum += weight;
        }
        if (!(std::abs(sum - 1) <= 1e-3))
            throw ValueError(std::string(where) + ": J_regressor row " + std::to_string(j) + " sums to " +
                             detail::number_text(sum) + ", expected 1, or joints would not move with the mesh");
    }
    detail::check_triangles(where, "f", model.faces, V);
    if (!model.ft.empty()) {
        check_size(where, "ft", model.ft.size(), model.faces.size(), "store one triple per face");
        detail::check_triangles(where, "ft", model.ft, model.vt.size());
    }
    if (!model.joint_names.empty()) check_size(where, "joint_names", model.joint_names.size(), J);
    for (const auto* hand : {&model.hands_mean_left, &model.hands_mean_right}) {
        if (!hand->empty()) check_size(where, "hands_mean", hand->size(), 15, "store 15 axis-angle vectors");
        detail::check_coordinates(where, "hands_mean", *hand);
    }
    for (const auto* components : {&model.hands_components_left, &model.hands_components_right}) {
        check_size(where, "hands_components", components->size(), components->size() / 45 * 45,
                   "store rows of 45 numbers");
        check_finite<double>(where, "hands_components", *components);
    }
    detail::check_index_range(where, "face_vertices", model.face_vertices, V);
    detail::check_index_range(where, "left_hand_vertices", model.left_hand_vertices, V);
    detail::check_index_range(where, "right_hand_vertices", model.right_hand_vertices, V);
}

inline std::vector<vec3<double>> shaped_vertices(const BodyModel& model, Span<const double> betas,
                                                 Span<const double> expression) {
    const auto S = static_cast<std::size_t>(model.shape_count), E = static_cast<std::size_t>(model.expression_count);
    detail::check_coefficients("shaped_vertices", "betas", betas.size(), S);
    detail::check_coefficients("shaped_vertices", "expression", expression.size(), E);
    std::vector<vec3<double>> vertices = model.v_template;
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        for (std::size_t k = 0; k < betas.size(); ++k) vertices[v] += model.shapedirs[v * S + k] * betas[k];
        for (std::size_t k = 0; k < expression.size(); ++k) vertices[v] += model.exprdirs[v * E + k] * expression[k];
    }
    return vertices;
}

inline std::vector<vec3<double>> regress_joints(const BodyModel& model, Span<const vec3<double>> vertices) {
    check_size("regress_joints", "vertices", vertices.size(), model.vertex_count());
    return joint_directions(model, vertices);
}

inline std::vector<vec3<double>> joint_directions(const BodyModel& model, Span<const vec3<double>> directions) {
    const std::size_t V = model.vertex_count(), count = V ? directions.size() / V : 0;
    check_size("joint_directions", "directions", directions.size(), V * count, "store as many for each vertex");
    std::vector<vec3<double>> result(model.joint_count() * count, vec3<double>(0));
    for (std::size_t j = 0; j < model.joint_count(); ++j)
        for (const auto& [vertex, weight] : model.J_regressor[j])
            for (std::size_t k = 0; k < count; ++k)
                result[j * count + k] += directions[static_cast<std::size_t>(vertex) * count + k] * weight;
    return result;
}

} // namespace gsh
