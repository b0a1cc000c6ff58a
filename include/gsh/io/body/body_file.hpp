// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes body models as .npz files in the layout of SMPL, SMPL-H and SMPL-X.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/compact_arrays.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads v_template, f, shapedirs, J_regressor, weights, kintree_table and, if present, posedirs, vt, ft, hands_meanl,
/// hands_meanr, hands_componentsl, hands_componentsr, joint_names, face_vertices, left_hand_vertices,
/// right_hand_vertices. Pickled members of the second group are skipped.
///
/// shapedirs holds shape directions followed by expression directions. num_betas and num_expressions give their numbers
/// if present. Otherwise, in a body of 55 joints, 400 directions are 300 + 100 and 20 are 10 + 10, as in SMPL-X. In all
/// other cases all directions are shape.
///
/// Errors  IoError, ShapeError or ValueError, naming file and key, for anything that makes the model invalid.
[[nodiscard]] inline BodyModel load_body_model(const InputFile& input);

/// Writes the same layout in double precision, atomically; reading it back gives the same model.
inline void save_body_model(const std::filesystem::path& path, const BodyModel& model);

/// The same as part of an archive, with a prefix before each key. Large arrays may be stored in other forms than dense.
[[nodiscard]] inline BodyModel read_body_model(const NpzReader& file, const std::string& prefix = {});
inline void add_body_model(NpzWriter& file, const BodyModel& model, const std::string& prefix = {},
                           ArrayStorage storage = ArrayStorage::dense);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::int64_t any_length = -1;

/// Rows of three numbers as vectors.
inline std::vector<vec3<double>> rows_of_three(const NpyArray<double>& array) {
    std::vector<vec3<double>> rows(array.size() / 3);
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] = {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
    return rows;
}

inline std::vector<std::array<int, 3>> triangles_of(const NpyArray<int>& array) {
    std::vector<std::array<int, 3>> triangles(array.size() / 3);
    for (std::size_t i = 0; i < triangles.size(); ++i)
        triangles[i] = {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
    return triangles;
}

/// Directions [V, 3, C] of a file as vectors [V, count], from `first` on.
inline std::vector<vec3<double>> directions_of(const NpyArray<double>& array, std::size_t first, std::size_t count) {
    const std::size_t V = array.dim(0), C = array.dim(2);
    std::vector<vec3<double>> directions(V * count);
    for (std::size_t v = 0; v < V; ++v)
        for (std::size_t k = 0; k < count; ++k)
            for (int axis = 0; axis < 3; ++axis)
                directions[v * count + k][axis] = array[(3 * v + static_cast<std::size_t>(axis)) * C + first + k];
    return directions;
}

/// The number of shape directions among C; the others are expression.
inline std::size_t count_shape_directions(const NpzReader& file, const std::string& prefix, std::size_t C,
                                          std::size_t joint_count) {
    const std::string num_betas = prefix + "num_betas", num_expressions = prefix + "num_expressions";
    const bool betas = file.has_array(num_betas), expressions = file.has_array(num_expressions);
    if (betas || expressions) {
        const auto read = [&](const std::string& key) {
            const auto count = file.read_number<std::int64_t>(key);
            check_value(count >= 0 && static_cast<std::size_t>(count) <= C, file.name_of(key),
                        "is " + std::to_string(count) + ", expected 0 to " + std::to_string(C) +
                            ", the number of shapedirs");
            return static_cast<std::size_t>(count);
        };
        const std::size_t shape = betas ? read(num_betas) : C - read(num_expressions);
        if (betas && expressions)
            check_value(shape + read(num_expressions) == C, file.name_of(num_betas),
                        "and num_expressions do not add up to the " + std::to_string(C) + " directions of shapedirs");
        return shape;
    }
    if (joint_count == 55 && C > 300) return 300;
    if (joint_count == 55 && C == 20) return 10;
    return C;
}

inline std::vector<int> parents_of(const NpzReader& file, const std::string& key) {
    const auto table = file.read<std::int64_t>(key, {2, any_length});
    const std::size_t J = table.dim(1);
    std::vector<int> parents(J);
    for (std::size_t j = 0; j < J; ++j) {
        check_value(table[J + j] == static_cast<std::int64_t>(j), file.name_of(key),
                    "[1, " + std::to_string(j) + "] is " + std::to_string(table[J + j]) +
                        ", expected the joints in order");
        const bool root = table[j] == -1 || table[j] == 4294967295; // signed or unsigned
        check_value(root || (table[j] >= 0 && static_cast<std::size_t>(table[j]) < J), file.name_of(key),
                    "[0, " + std::to_string(j) + "] is " + std::to_string(table[j]) + ", expected a joint below " +
                        std::to_string(J) + ", or -1 for the root");
        parents[j] = root ? -1 : static_cast<int>(table[j]);
    }
    return parents;
}

} // namespace detail

inline BodyModel load_body_model(const InputFile& input) {
    const NpzReader file(input);
    detail::check_first_version(file, "body");
    return read_body_model(file);
}

inline BodyModel read_body_model(const NpzReader& file, const std::string& prefix) {
    using detail::any_length;
    BodyModel model;
    model.v_template = detail::rows_of_three(read_numbers<double>(file, prefix + "v_template", {any_length, 3}));
    model.parents = detail::parents_of(file, prefix + "kintree_table");
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    const auto vertices = static_cast<std::int64_t>(V), joints = static_cast<std::int64_t>(J);
    model.faces = detail::triangles_of(file.read<int>(prefix + "f", {any_length, 3}));
    model.weights = read_numbers<double>(file, prefix + "weights", {vertices, joints}).data;

    const auto regressor = read_numbers<double>(file, prefix + "J_regressor", {joints, vertices});
    model.J_regressor.resize(J);
    for (std::size_t j = 0; j < J; ++j)
        for (std::size_t v = 0; v < V; ++v)
            if (const double weight = regressor[j * V + v]; weight != 0)
                model.J_regressor[j].push_back({static_cast<int>(v), weight});

    const auto shapedirs = read_numbers<double>(file, prefix + "shapedirs", {vertices, 3, any_length});
    const std::size_t C = shapedirs.dim(2), S = detail::count_shape_directions(file, prefix, C, J);
    model.shapedirs = detail::directions_of(shapedirs, 0, S);
    model.exprdirs = detail::directions_of(shapedirs, S, C - S);
    model.shape_count = static_cast<int>(S);
    model.expression_count = static_cast<int>(C - S);
    if (const auto features = static_cast<std::int64_t>(model.pose_feature_count());
        has_numbers(file, prefix + "posedirs"))
        model.posedirs = detail::directions_of(read_numbers<double>(file, prefix + "posedirs", {vertices, 3, features}),
                                               0, model.pose_feature_count());

    if (file.has_array(prefix + "vt") && file.has_array(prefix + "ft")) {
        const auto vt = file.read<double>(prefix + "vt", {any_length, 2});
        for (std::size_t i = 0; i < vt.dim(0); ++i) model.vt.emplace_back(vt[2 * i], vt[2 * i + 1]);
        model.ft = detail::triangles_of(file.read<int>(prefix + "ft", {any_length, 3}));
    }
    if (file.has_array(prefix + "joint_names") && file.header(prefix + "joint_names").is_text())
        model.joint_names = file.read_texts(prefix + "joint_names");
    const auto read_hand = [&](const char* key, std::vector<vec3<double>>& mean) {
        if (file.has_array(prefix + key)) mean = detail::rows_of_three(file.read<double>(prefix + key, {45}));
    };
    read_hand("hands_meanl", model.hands_mean_left);
    read_hand("hands_meanr", model.hands_mean_right);
    const auto read_components = [&](const char* key, std::vector<double>& components) {
        if (file.has_array(prefix + key)) components = file.read<double>(prefix + key, {any_length, 45}).data;
    };
    read_components("hands_componentsl", model.hands_components_left);
    read_components("hands_componentsr", model.hands_components_right);
    const auto read_region = [&](const char* key, std::vector<int>& region) {
        if (file.has_array(prefix + key)) region = file.read<int>(prefix + key, {any_length}).data;
    };
    read_region("face_vertices", model.face_vertices);
    read_region("left_hand_vertices", model.left_hand_vertices);
    read_region("right_hand_vertices", model.right_hand_vertices);
    validate(model, file.path().string());
    return model;
}

inline void save_body_model(const std::filesystem::path& path, const BodyModel& model) {
    NpzWriter file(path);
    add_body_model(file, model);
    file.commit();
}

inline void add_body_model(NpzWriter& file, const BodyModel& model, const std::string& prefix, ArrayStorage storage) {
    validate(model, "add_body_model");
    const std::size_t V = model.vertex_count(), J = model.joint_count();
    const auto S = static_cast<std::size_t>(model.shape_count), E = static_cast<std::size_t>(model.expression_count);
    const auto add_numbers = [&](const char* key, Span<const double> numbers, const Shape& shape) {
        if (storage == ArrayStorage::single)
            file.add(prefix + key, std::vector<float>(numbers.begin(), numbers.end()), shape);
        else
            file.add<double>(prefix + key, numbers, shape);
    };
    const auto add_vectors = [&](const char* key, const std::vector<vec3<double>>& rows, const Shape& shape) {
        add_numbers(key, {rows.empty() ? nullptr : &rows[0].x, 3 * rows.size()}, shape);
    };
    const auto add_large = [&](const char* key, const std::vector<double>& numbers, const Shape& shape) {
        if (storage == ArrayStorage::dense || storage == ArrayStorage::single)
            add_numbers(key, numbers, shape);
        else
            add_sparse(file, prefix + key, numbers, shape);
    };
    const auto add_triangles = [&](const char* key, const std::vector<std::array<int, 3>>& triangles) {
        file.add<int>(prefix + key, {triangles.empty() ? nullptr : triangles[0].data(), 3 * triangles.size()},
                      {triangles.size(), 3});
    };
    const auto add_directions = [&](const char* key, std::size_t count, const auto& direction) {
        std::vector<double> rows(3 * V * count);
        for (std::size_t v = 0; v < V; ++v)
            for (std::size_t axis = 0; axis < 3; ++axis)
                for (std::size_t k = 0; k < count; ++k)
                    rows[(3 * v + axis) * count + k] = direction(v, k)[static_cast<int>(axis)];
        if (storage != ArrayStorage::compact) return add_large(key, rows, {V, 3, count});
        // Corrections by the pose are many and small.
        if (key == std::string("posedirs"))
            add_quantised<std::int8_t, double>(file, prefix + key, rows, count, true);
        else
            add_quantised<std::int16_t, double>(file, prefix + key, rows, count, true);
    };
    if (storage == ArrayStorage::compact)
        add_quantised<std::int16_t, double>(file, prefix + "v_template", {V ? &model.v_template[0].x : nullptr, 3 * V},
                                            3);
    else
        add_vectors("v_template", model.v_template, {V, 3});
    add_triangles("f", model.faces);
    add_directions("shapedirs", S + E, [&](std::size_t v, std::size_t k) {
        return k < S ? model.shapedirs[v * S + k] : model.exprdirs[v * E + k - S];
    });
    file.add(prefix + "num_betas", std::int64_t(model.shape_count));
    file.add(prefix + "num_expressions", std::int64_t(model.expression_count));
    if (const std::size_t features = model.pose_feature_count(); !model.posedirs.empty())
        add_directions("posedirs", features,
                       [&](std::size_t v, std::size_t k) { return model.posedirs[v * features + k]; });
    std::vector<double> regressor(J * V, 0.0);
    for (std::size_t j = 0; j < J; ++j)
        for (const auto& [vertex, weight] : model.J_regressor[j])
            regressor[j * V + static_cast<std::size_t>(vertex)] += weight;
    add_large("J_regressor", regressor, {J, V});
    std::vector<double> weights = model.weights;
    if (storage == ArrayStorage::compact)
        for (double& weight : weights) weight = std::round(weight * 65536) / 65536; // short numbers deflate well
    add_large("weights", weights, {V, J});
    std::vector<std::int64_t> table(2 * J);
    for (std::size_t j = 0; j < J; ++j) table[j] = model.parents[j], table[J + j] = static_cast<std::int64_t>(j);
    file.add(prefix + "kintree_table", table, {2, J});

    if (!model.ft.empty()) {
        add_numbers("vt", {model.vt.empty() ? nullptr : &model.vt[0].x, 2 * model.vt.size()}, {model.vt.size(), 2});
        add_triangles("ft", model.ft);
    }
    if (!model.joint_names.empty()) file.add_texts(prefix + "joint_names", model.joint_names);
    if (!model.hands_mean_left.empty()) add_vectors("hands_meanl", model.hands_mean_left, {45});
    if (!model.hands_mean_right.empty()) add_vectors("hands_meanr", model.hands_mean_right, {45});
    const auto add_components = [&](const char* key, const std::vector<double>& components) {
        if (!components.empty()) file.add(prefix + key, components, {components.size() / 45, 45});
    };
    add_components("hands_componentsl", model.hands_components_left);
    add_components("hands_componentsr", model.hands_components_right);
    const auto add_region = [&](const char* key, const std::vector<int>& region) {
        if (!region.empty()) file.add(prefix + key, region);
    };
    add_region("face_vertices", model.face_vertices);
    add_region("left_hand_vertices", model.left_hand_vertices);
    add_region("right_hand_vertices", model.right_hand_vertices);
}

} // namespace gsh
