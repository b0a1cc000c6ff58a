// SPDX-License-Identifier: Apache-2.0
/// @file  The rig of GalaBasketball, 27 joints with rotated rest frames, and its poses in Euler angles.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/number_lines.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <numbers>
#include <numeric>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// The data set's own body, without shapes, expressions or triangles. Place Gaussians with sample_vertices
/// (body/vertex_samples.hpp), one per vertex, as the direct baseline does.
struct GalaRig {
    BodyModel body;                           ///< the mesh in its T pose, right-handed, facing +z
    std::vector<vec3<double>> normals;        // [V] unit
    std::vector<mat3<double>> rest_rotations; // [J] world_from_joint in the T pose; poses are given in these axes
};

/// Reads a folder with mesh.txt (five lines per vertex: position, normal, uv, weights, joints), tpose.txt (three lines
/// per joint: position in the parent's frame, rotation, scale), tpose_mat.txt (16 numbers per joint: joint_from_world
/// in the T pose, row by row), jointParent.txt (-1 for the root) and optionally weights.npy [V, J]. Without
/// weights.npy, the weights of mesh.txt are used.
///
/// Frame   the files are left-handed, y up, facing +z. Mirroring x gives our frame, left at +x: v' = M v, R' = M R M.
///         Joints come from tpose_mat.txt; the regressor reproduces them as weighted sums of nearby vertices.
/// Errors  IoError, ShapeError, ValueError naming file and line.
[[nodiscard]] inline GalaRig load_gala_rig(const std::filesystem::path& folder,
                                           std::vector<std::string>* warnings = nullptr);

/// Reads pose files FOLDER/NUMBER.txt: for each person and joint three lines, position, Euler angles in degrees with R
/// = Ry Rx Rz, and scale. Only the roots' positions are used. Returns all people, with the frames as listed.
///
/// Frame   a joint's angles E include its rest rotation Q: the rotation relative to the T pose is Q_parent E Q⁻¹.
/// Units   timestamps are NUMBER / 30.
[[nodiscard]] inline std::vector<Motion> load_gala_motions(const std::filesystem::path& folder, const GalaRig& rig,
                                                           const std::vector<int>& frames);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Converts between the files' left-handed frame and ours.
inline vec3<double> mirrored(const vec3<double>& v) {
    return {-v.x, v.y, v.z};
}
inline mat3<double> mirrored(const mat3<double>& m) {
    const mat3<double> M(vec3<double>(-1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1));
    return M * m * M;
}

inline double inner(const std::vector<double>& a, const std::vector<double>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

/// The w of smallest norm with rows[r] · w = sums[r]. Equations whose rows depend linearly on earlier ones are skipped
/// and may be violated. The method is Gram-Schmidt: the part of a row orthogonal to the earlier rows satisfies its
/// equation and leaves theirs unchanged. It runs twice, because one pass loses precision if rows are almost parallel.
template <std::size_t R>
std::vector<double> smallest_solution(const std::array<std::vector<double>, R>& rows,
                                      const std::array<double, R>& sums) {
    std::vector<double> w(rows[0].size(), 0.0);
    std::vector<std::vector<double>> directions;
    const auto add = [](std::vector<double>& to, const std::vector<double>& v, double factor) {
        for (std::size_t i = 0; i < to.size(); ++i) to[i] += factor * v[i];
    };
    for (std::size_t r = 0; r < R; ++r) {
        std::vector<double> own = rows[r];
        for (int pass = 0; pass < 2; ++pass)
            for (const auto& q : directions) add(own, q, -inner(own, q));
        const double norm = std::sqrt(inner(own, own));
        if (!(norm > 1e-12 * std::sqrt(inner(rows[r], rows[r])))) continue;
        for (double& x : own) x /= norm;
        add(w, own, (sums[r] - inner(rows[r], w)) / norm);
        directions.push_back(std::move(own));
    }
    return w;
}

/// The weights of smallest norm, with sum 1, with which nearby vertices give a point exactly.
///
/// Errors  ValueError if the vertices lie in a plane that does not contain the point.
inline std::vector<RegressorEntry> affine_weights(const std::vector<vec3<double>>& vertices, const vec3<double>& point,
                                                  const std::string& where) {
    std::vector<std::pair<double, int>> by_distance;
    for (std::size_t v = 0; v < vertices.size(); ++v) {
        const vec3<double> d = vertices[v] - point;
        by_distance.emplace_back(dot(d, d), static_cast<int>(v));
    }
    std::sort(by_distance.begin(), by_distance.end());
    for (std::size_t k = std::min<std::size_t>(32, by_distance.size());; k = std::min(4 * k, by_distance.size())) {
        const double scale = std::sqrt(std::max(by_distance[k - 1].first, 1e-12));
        std::array<std::vector<double>, 4> rows; // ones, and the vertices' coordinates around the point
        for (std::size_t i = 0; i < k; ++i) {
            const vec3<double> d = (vertices[static_cast<std::size_t>(by_distance[i].second)] - point) * (1 / scale);
            rows[0].push_back(1);
            for (int c = 0; c < 3; ++c) rows[static_cast<std::size_t>(c) + 1].push_back(d[c]);
        }
        const std::array<double, 4> sums{1, 0, 0, 0};
        const std::vector<double> w = smallest_solution(rows, sums);
        double error = 0;
        for (std::size_t r = 0; r < 4; ++r) error = std::max(error, std::abs(inner(rows[r], w) - sums[r]));
        if (error < 1e-9) {
            std::vector<RegressorEntry> row;
            for (std::size_t i = 0; i < k; ++i) row.push_back({by_distance[i].second, w[i]});
            return row;
        }
        check_value(k < by_distance.size(), where,
                    "the vertices lie in a plane beside the joint, expected a body around it");
    }
}

} // namespace detail

inline GalaRig load_gala_rig(const std::filesystem::path& folder, std::vector<std::string>* warnings) {
    using detail::mirrored;
    GalaRig rig;
    BodyModel& body = rig.body;
    const NumberLines parents(folder / "jointParent.txt"), mesh(folder / "mesh.txt"), tpose(folder / "tpose.txt");
    for (std::size_t j = 0; j < parents.size(); ++j) {
        const double parent = parents.at(j, 1, "one parent a line")[0];
        check_value(parent == std::floor(parent) && parent >= -1 && parent < static_cast<double>(parents.size()),
                    parents.path().string(),
                    "holds " + detail::number_text(parent) + ", expected the number of a joint, or -1");
        body.parents.push_back(static_cast<int>(parent));
    }
    const std::size_t J = body.parents.size();
    detail::check_tree(parents.path().string(), body.parents);
    if (tpose.size() != 3 * J)
        throw ShapeError(tpose.path().string() + ": holds " + std::to_string(tpose.size()) + " lines, expected " +
                         std::to_string(3 * J) + ", three for each joint of jointParent.txt");

    // Positions and rotations of the joints.
    const NumberLines bind_file(folder / "tpose_mat.txt");
    const std::vector<double> bind = bind_file.all();
    if (bind.size() != 16 * J)
        throw ShapeError(bind_file.path().string() + ": holds " + std::to_string(bind.size()) + " numbers, expected " +
                         std::to_string(16 * J) + ", 16 a joint");
    std::vector<vec3<double>> joints;
    double furthest = 0;
    for (std::size_t j = 0; j < J; ++j) {
        const double* m = &bind[16 * j];
        const mat3<double> A(vec3<double>(m[0], m[4], m[8]), vec3<double>(m[1], m[5], m[9]),
                             vec3<double>(m[2], m[6], m[10]));
        const vec3<double> b(m[3], m[7], m[11]);
        bool rigid =
            determinant(A) > 0 && std::abs(m[12]) + std::abs(m[13]) + std::abs(m[14]) + std::abs(m[15] - 1) < 1e-3;
        for (int i = 0; i < 3; ++i)
            for (int k = 0; k < 3; ++k) rigid = rigid && std::abs(dot(A[i], A[k]) - (i == k)) < 1e-2;
        check_value(rigid, bind_file.path().string(),
                    "the matrix of joint " + std::to_string(j) +
                        " is not rigid (rotation and shift, last row 0 0 0 1)");
        const mat3<double> Q = transpose(rotation_matrix(quat_from_rotation(A)));
        rig.rest_rotations.push_back(mirrored(Q));
        joints.push_back(mirrored(-(Q * b)));
        if (j == 0) continue;
        const auto parent = static_cast<std::size_t>(body.parents[j]);
        const vec3<double> local = transpose(rig.rest_rotations[parent]) * (joints[j] - joints[parent]);
        furthest = std::max(furthest, length(local - mirrored(tpose.vector(3 * j, "position"))));
    }
    if (furthest > 1e-3 && warnings)
        warnings->push_back(tpose.path().string() + ": its positions differ from tpose_mat.txt by up to " +
                            detail::number_text(furthest) + " m; those of the matrices are taken");

    // The mesh.
    if (mesh.size() % 5 != 0)
        throw ShapeError(mesh.path().string() + ": holds " + std::to_string(mesh.size()) +
                         " lines, expected five a vertex");
    const std::size_t V = mesh.size() / 5;
    detail::check_claim(mesh.path().string() + ": the table of weights", std::uint64_t(V) * J * sizeof(double),
                        InputStream(mesh.path()).size());
    body.weights.assign(V * J, 0.0);
    for (std::size_t v = 0; v < V; ++v) {
        body.v_template.push_back(mirrored(mesh.vector(5 * v, "position")));
        const vec3<double> normal = mirrored(mesh.vector(5 * v + 1, "normal"));
        const double size = length(normal);
        rig.normals.push_back(size > 0 ? normal * (1 / size) : vec3<double>(0, 1, 0));
        const auto& weights = mesh.at(5 * v + 3, 0, "weights");
        const auto& indices = mesh.at(5 * v + 4, weights.size(), "as many joints as weights");
        for (std::size_t k = 0; k < weights.size(); ++k) {
            const bool fits =
                indices[k] >= 0 && indices[k] < static_cast<double>(J) && indices[k] == std::floor(indices[k]);
            check_value(fits || weights[k] == 0, mesh.path().string(),
                        "vertex " + std::to_string(v) + " hangs on joint " + detail::number_text(indices[k]) +
                            ", expected one below " + std::to_string(J));
            if (fits) body.weights[v * J + static_cast<std::size_t>(indices[k])] += weights[k];
        }
    }
    std::error_code ignored;
    std::filesystem::path weights_path = folder / "weights.npy";
    if (std::filesystem::exists(weights_path, ignored)) {
        const NpyArray<double> weights = read_npy<double>(weights_path);
        const std::int64_t pattern[] = {static_cast<std::int64_t>(V), static_cast<std::int64_t>(J)};
        detail::check_shape(weights_path.string(), weights.shape, pattern);
        body.weights = weights.data;
    } else {
        weights_path = mesh.path();
    }
    for (std::size_t v = 0; v < V; ++v) { // the text's numbers are rounded
        double sum = 0;
        for (std::size_t j = 0; j < J; ++j) sum += body.weights[v * J + j];
        check_value(std::abs(sum - 1) < 0.02, weights_path.string(),
                    "the weights of vertex " + std::to_string(v) + " sum to " + detail::number_text(sum) +
                        ", expected 1");
        for (std::size_t j = 0; j < J; ++j) body.weights[v * J + j] /= sum;
    }
    for (std::size_t j = 0; j < J; ++j)
        body.J_regressor.push_back(
            detail::affine_weights(body.v_template, joints[j], mesh.path().string() + ": joint " + std::to_string(j)));
    validate(body, folder.string());
    return rig;
}

inline std::vector<Motion> load_gala_motions(const std::filesystem::path& folder, const GalaRig& rig,
                                             const std::vector<int>& frames) {
    using detail::mirrored;
    const std::size_t J = rig.body.joint_count();
    check_size("load_gala_motions", "rig.rest_rotations", rig.rest_rotations.size(), J);
    const vec3<double> J0 = regress_joints(rig.body, rig.body.v_template)[0];
    std::map<long, std::filesystem::path> files;
    for (const auto& file : detail::list_numbered(folder, ".txt")) files[file.number] = file.path;
    std::vector<Motion> people;
    for (const int frame : frames) {
        const auto file = files.find(frame);
        if (file == files.end())
            throw IoError(folder.string() + ": the pose of frame " + std::to_string(frame) + " is missing");
        const NumberLines lines(file->second);
        const std::size_t found = lines.size() / (3 * J);
        if (lines.size() % (3 * J) != 0)
            throw ShapeError(lines.path().string() + ": holds " + std::to_string(lines.size()) +
                             " lines, expected a multiple of " + std::to_string(3 * J) +
                             ", three for each of the rig's joints");
        if (people.empty()) people.resize(found);
        if (people.size() != found)
            throw ShapeError(lines.path().string() + ": holds " + std::to_string(found) + " people, expected " +
                             std::to_string(people.size()) + " as in the first frame");
        for (std::size_t p = 0; p < found; ++p) {
            Motion& motion = people[p];
            motion.joint_count = J;
            for (std::size_t j = 0; j < J; ++j) {
                const std::size_t line = 3 * (p * J + j);
                const vec3<double> degrees = lines.vector(line + 1, "Euler angles");
                (void)lines.vector(line + 2, "scale"); // read and ignored
                const vec3<double> a = degrees * (std::numbers::pi / 180);
                const mat3<double> E = mirrored(rotation_from_euler(vec3<double>(a.y, a.x, a.z), EulerOrder::yxz));
                const mat3<double> before =
                    j == 0 ? mat3<double>(1.0) : rig.rest_rotations[static_cast<std::size_t>(rig.body.parents[j])];
                motion.pose.push_back(axis_angle_from_rotation(before * E * transpose(rig.rest_rotations[j])));
            }
            motion.transl.push_back(mirrored(lines.vector(3 * p * J, "position")) - J0);
            motion.timestamps.push_back(frame / 30.0);
        }
    }
    for (const Motion& motion : people) validate(motion, rig.body, folder.string());
    return people;
}

} // namespace gsh
