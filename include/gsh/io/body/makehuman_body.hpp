// SPDX-License-Identifier: Apache-2.0
/// @file  Makes a body in the layout of SMPL-X from MakeHuman's files, and writes it.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/joint_regressor.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_shapes.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh {

/// Of a number of betas, one in five describes the head alone. The others describe the whole body.
[[nodiscard]] constexpr std::size_t body_directions_of(int betas) {
    return static_cast<std::size_t>(betas - betas / 5);
}

struct MakeHumanBodyParams {
    int betas = 40;            ///< shape directions
    std::size_t people = 4000; ///< random adults whose shapes the directions describe
    std::uint64_t seed = 0;
};

/// A body with the names and lists that its file has beyond BodyModel.
struct MakeHumanBody {
    BodyModel body;
    std::vector<std::uint8_t> vertex_part; // [V] index into makehuman_part_names
    std::vector<int> head_vertices;
};

/// The mean adult in T-pose, with shape directions of unit variance and ten expressions, no pose correctives and no
/// mean hand.
///
/// Frame   y up, facing +z, its left at +x; the pelvis is at the origin.
/// Errors  ValueError for a number of betas that is not in 1 .. 300, or fewer than two people.
[[nodiscard]] inline MakeHumanBody makehuman_body(const MakeHumanData& data, const MakeHumanShapes& shapes, int betas);

/// Writes the body as load_body_model and programs for SMPL-X read it, with the licence of its data.
inline void save_makehuman_body(const std::filesystem::path& path, const MakeHumanBody& body);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline std::vector<vec3<double>> vectors_of(const std::vector<float>& numbers) {
    std::vector<vec3<double>> vectors;
    for (std::size_t i = 0; i + 2 < numbers.size(); i += 3)
        vectors.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
    return vectors;
}

} // namespace detail

inline MakeHumanBody makehuman_body(const MakeHumanData& data, const MakeHumanShapes& shapes, int betas) {
    check_value(betas >= 1 && betas <= 300, "makehuman_body",
                "there are " + std::to_string(betas) + " betas, expected 1 to 300");
    const std::size_t V = shapes.vertices.size(), J = shapes.joints.size();
    MakeHumanBody result;
    BodyModel& body = result.body;
    body.v_template = shapes.vertices;
    body.faces = data.surface.faces, body.ft = data.surface.ft, body.vt = data.surface.vt;
    body.parents = data.skeleton.parents;
    body.joint_names.assign(smplx_joint_names.begin(), smplx_joint_names.end());

    const std::size_t of_body = body_directions_of(betas);
    const auto directions = makehuman_directions(shapes, of_body, static_cast<std::size_t>(betas) - of_body);
    body.shape_count = static_cast<int>(directions.size());
    body.expression_count = static_cast<int>(shapes.expressions.size());
    std::vector<std::vector<vec3<double>>> moved = {shapes.vertices}, joints = {shapes.joints};
    for (const MakeHumanDirection& direction : directions) {
        moved.push_back(detail::vectors_of(direction.shape.vertices));
        joints.push_back(direction.shape.joints);
    }
    for (std::size_t v = 0; v < V; ++v) {
        for (std::size_t k = 1; k < moved.size(); ++k) body.shapedirs.push_back(moved[k][v]);
        for (const TurnedShape& expression : shapes.expressions)
            body.exprdirs.emplace_back(expression.vertices[3 * v], expression.vertices[3 * v + 1],
                                       expression.vertices[3 * v + 2]);
    }
    body.weights.assign(V * J, 0.0);
    for (std::size_t v = 0; v < V; ++v)
        for (const JointWeight& w : data.skeleton.weights[static_cast<std::size_t>(data.surface.vertices[v])])
            body.weights[v * J + static_cast<std::size_t>(w.joint)] = w.weight;

    result.vertex_part = data.surface.parts;
    for (std::size_t j = 0; j < J; ++j) {
        const int part = smplx_joint_names[j] == "left_eye" ? 2 : smplx_joint_names[j] == "right_eye" ? 3 : 0;
        std::vector<bool> allowed(V);
        for (std::size_t v = 0; v < V; ++v) allowed[v] = result.vertex_part[v] == part;
        std::vector<vec3<double>> positions;
        for (const auto& shape : joints) positions.push_back(shape[j]);
        body.J_regressor.push_back(
            fitted_regressor_row<double>(vertices_around(shapes.vertices, allowed, positions[0]), moved, positions));
    }

    result.head_vertices = vertices_of_joints(data, is_head_joint);
    for (const int v : result.head_vertices)
        if (result.vertex_part[static_cast<std::size_t>(v)] != 0 ||
            data.in_face[static_cast<std::size_t>(data.surface.vertices[static_cast<std::size_t>(v)])])
            body.face_vertices.push_back(v);
    for (const bool left : {true, false}) {
        const std::string side = left ? "left_" : "right_";
        const auto is_hand = [&](std::string_view joint) {
            return joint.starts_with(side) && (joint.ends_with("wrist") || std::isdigit(joint.back()));
        };
        (left ? body.left_hand_vertices : body.right_hand_vertices) = vertices_of_joints(data, is_hand);
    }
    validate(body, "makehuman_body");
    return result;
}

inline void save_makehuman_body(const std::filesystem::path& path, const MakeHumanBody& body) {
    NpzWriter file(path, Packing::deflated);
    add_body_model(file, body.body, {}, ArrayStorage::single);
    file.add("head_vertices", body.head_vertices);
    file.add("vertex_part", body.vertex_part);
    file.add_texts("part_names", {makehuman_part_names.begin(), makehuman_part_names.end()});
    file.add_texts("expression_names", {makehuman_expression_names.begin(), makehuman_expression_names.end()});
    file.add_text("licence", "CC0 1.0 (public domain), as MakeHuman's data from which gsh-body made this body");
    file.commit();
}

} // namespace gsh
