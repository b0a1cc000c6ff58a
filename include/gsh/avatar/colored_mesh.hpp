// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar as a skinned, coloured mesh: the body displaced to its Gaussians, with their colours.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <utility>
#include <vector>

namespace gsh {

/// A mesh for programs without Gaussians.
///
/// Shapes  V vertices, J joints, E expressions; four influences a vertex, which sum to 1.
/// Frame   canonical. A vertex moves by the linear blend of its joints, as in Affine blending of a skeleton.
/// Units   colours display-referred sRGB in [0, 1].
struct ColoredMesh {
    std::vector<vec3<double>> vertices, normals;       // [V]
    std::vector<vec3<float>> colors;                   // [V]
    std::vector<std::array<std::uint16_t, 4>> joints;  // [V]
    std::vector<std::array<float, 4>> weights;         // [V]
    std::vector<std::vector<vec3<float>>> expressions; // [E] of displacements [V]
    std::vector<std::array<int, 3>> faces;             // counter-clockwise from outside
    std::vector<vec3<double>> rest_joints;             // [J]
};

/// How a mesh follows the Gaussians.
struct ColoredMeshParams {
    int most_levels = 2;   ///< of subdivision: a triangle becomes four while Gaussians outnumber vertices two to one
    std::size_t near = 12; ///< Gaussians that a vertex takes place and colour from
    int smoothing = 2;     ///< rounds in which a displacement becomes the mean of itself and its neighbours
    double most_offset = 0.08; ///< metres by which a vertex follows its Gaussians at most
};

namespace detail {

/// A mesh whose vertices have rows of numbers that are interpolated when edges are halved: position, weights,
/// expressions.
class DivisibleMesh {
public:
    DivisibleMesh(std::vector<std::array<int, 3>> faces, std::vector<double> rows, std::size_t width)
        : faces_(std::move(faces)), rows_(std::move(rows)), width_(width) {}

    [[nodiscard]] std::size_t size() const { return rows_.size() / width_; }
    [[nodiscard]] const std::vector<std::array<int, 3>>& faces() const { return faces_; }
    [[nodiscard]] Span<const double> row(std::size_t v) const {
        return Span<const double>(rows_).subspan(v * width_, width_);
    }
    [[nodiscard]] vec3<double> position(std::size_t v) const {
        return {rows_[v * width_], rows_[v * width_ + 1], rows_[v * width_ + 2]};
    }

    /// Each triangle becomes four.
    void divide() {
        std::map<std::pair<int, int>, int> middles;
        const auto middle = [&](int a, int b) {
            const auto [found, is_new] = middles.try_emplace(std::minmax(a, b), static_cast<int>(size()));
            for (std::size_t c = 0; c < width_ && is_new; ++c)
                rows_.push_back(0.5 * (rows_[static_cast<std::size_t>(a) * width_ + c] +
                                       rows_[static_cast<std::size_t>(b) * width_ + c]));
            return found->second;
        };
        std::vector<std::array<int, 3>> fine;
        for (const auto& [a, b, c] : faces_) {
            const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
            fine.insert(fine.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
        }
        faces_ = std::move(fine);
    }

private:
    std::vector<std::array<int, 3>> faces_;
    std::vector<double> rows_;
    std::size_t width_;
};

/// The mean over each vertex and its neighbours, `rounds` times. A neighbour counts for each triangle that has both.
inline void smooth(std::vector<vec3<double>>& values, Span<const std::array<int, 3>> faces, int rounds) {
    for (int round = 0; round < rounds; ++round) {
        std::vector<vec3<double>> sums = values;
        std::vector<double> counts(values.size(), 1);
        for (const auto& face : faces)
            for (std::size_t k = 0; k < 3; ++k) {
                const auto a = static_cast<std::size_t>(face[k]), b = static_cast<std::size_t>(face[(k + 1) % 3]);
                sums[a] += values[b], sums[b] += values[a], ++counts[a], ++counts[b];
            }
        for (std::size_t v = 0; v < values.size(); ++v) values[v] = sums[v] * (1 / counts[v]);
    }
}

/// A body's mesh, divided. Rows: position at the shape `rest`, position at `shape`, weights, expressions.
inline DivisibleMesh divided_body(const BodyModel& body, const std::vector<vec3<double>>& rest,
                                  const std::vector<vec3<double>>& shape, std::size_t gaussians, int most_levels) {
    const std::size_t V = body.vertex_count(), J = body.joint_count(),
                      E = static_cast<std::size_t>(body.expression_count), width = 6 + J + 3 * E;
    std::vector<double> rows;
    rows.reserve(V * width);
    for (std::size_t v = 0; v < V; ++v) {
        for (const auto& p : {rest[v], shape[v]}) rows.insert(rows.end(), {p.x, p.y, p.z});
        rows.insert(rows.end(), body.weights.begin() + static_cast<std::ptrdiff_t>(v * J),
                    body.weights.begin() + static_cast<std::ptrdiff_t>((v + 1) * J));
        for (std::size_t e = 0; e < E; ++e) {
            const vec3<double>& d = body.exprdirs[v * E + e];
            rows.insert(rows.end(), {d.x, d.y, d.z});
        }
    }
    DivisibleMesh mesh(body.faces, std::move(rows), width);
    for (int level = 0; level < most_levels && 2 * mesh.size() < gaussians; ++level) mesh.divide();
    return mesh;
}

/// What the vertices of a mesh take from the Gaussians around them.
struct VertexShares {
    std::vector<vec3<double>> offsets{};                                  // [V] mean of the Gaussians' offsets
    std::vector<std::vector<std::pair<double, std::size_t>>> gaussians{}; // [V] weights and Gaussians
};

/// `rest` is the mesh of the body at the avatar's shape, to which the Gaussians are attached.
inline VertexShares vertex_shares(const DivisibleMesh& mesh, const RigData& rig, const GaussianCloud<float>& cloud,
                                  const std::vector<vec3<double>>& rest, const ColoredMeshParams& params) {
    std::vector<vec3<double>> attached(cloud.size(), vec3<double>(0));
    for (std::size_t i = 0; i < cloud.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k)
            attached[i] +=
                rest[static_cast<std::size_t>(rig.triangles[i][k])] * rig.barycentric[i][static_cast<int>(k)];
    const NearestPoints grid{Span<const vec3<double>>(attached)};
    VertexShares shares;
    for (std::size_t v = 0; v < mesh.size(); ++v) {
        auto near = grid.nearest(mesh.position(v), params.near);
        const double reach = std::max(near[near.size() / 2].first, 1e-12); // half of them lie within
        double total = 1e-9;
        vec3<double> offset(0);
        auto& own = shares.gaussians.emplace_back();
        for (const auto& [squared, i] : near) {
            const double weight = std::exp(-squared / reach) * sigmoid(double(cloud.opacity_logits[i]));
            own.push_back({weight, i});
            offset += (vec3<double>(cloud.means[i]) - attached[i]) * weight;
            total += weight;
        }
        offset = offset * (1 / total);
        if (const double size = length(offset); size > params.most_offset) offset *= params.most_offset / size;
        shares.offsets.push_back(offset);
    }
    smooth(shares.offsets, mesh.faces(), params.smoothing);
    return shares;
}

/// Adds the four largest of a vertex's weights [J] to a mesh, made to sum to 1.
inline void add_influences(ColoredMesh& mesh, Span<const double> all) {
    std::vector<std::pair<double, std::uint16_t>> influences;
    for (std::size_t j = 0; j < all.size(); ++j)
        if (all[j] > 0) influences.push_back({all[j], static_cast<std::uint16_t>(j)});
    std::sort(influences.begin(), influences.end(), std::greater<>());
    influences.resize(4);
    double total = 0;
    for (const auto& [weight, joint] : influences) total += weight;
    auto& joints = mesh.joints.emplace_back();
    auto& weights = mesh.weights.emplace_back();
    for (std::size_t k = 0; k < 4; ++k)
        joints[k] = influences[k].second, weights[k] = static_cast<float>(influences[k].first / total);
}

/// The colours of Gaussians as seen from outside, along a vertex's normal `outward`: the mean by their shares.
inline std::vector<vec3<float>> vertex_colors(const GaussianCloud<float>& cloud, const VertexShares& shares,
                                              const std::vector<vec3<double>>& outward) {
    std::vector<vec3<float>> colors;
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        constexpr std::size_t basis = sh_basis_count(decltype(degree)::value);
        for (std::size_t v = 0; v < outward.size(); ++v) {
            vec3<double> sum(0);
            double total = 1e-9;
            for (const auto& [weight, i] : shares.gaussians[v]) {
                const vec3<float> color =
                    unclamped_color<decltype(degree)::value>(&cloud.sh[i * basis], -vec3<float>(outward[v]));
                sum += vec3<double>(glm::clamp(color, 0.0f, 1.0f)) * weight, total += weight;
            }
            colors.push_back(vec3<float>(sum * (1 / total)));
        }
    });
    return colors;
}

} // namespace detail

/// Makes the mesh of an avatar for a shape `betas` (of the avatar itself if empty).
///
/// A vertex moves by the mean offset of the Gaussians around it from the places where they are attached, and takes
/// their mean colour as seen from outside, along its normal; opaque and near ones count more. Colours include the mean
/// ambient occlusion and the mean light of training (shaded_cloud). Corrections of the body that depend on the pose are
/// left out, and joints stay where they are under expressions, because formats of meshes have neither.
///
/// Errors  ValueError for a body without triangles or an avatar without Gaussians; ShapeError for more betas than the
///         avatar has.
[[nodiscard]] inline ColoredMesh colored_mesh(const AvatarData& avatar, Span<const double> betas = {},
                                              const ColoredMeshParams& params = {}) {
    const BodyModel& body = avatar.rig.body;
    check_value(!body.faces.empty(), "colored_mesh", "the body has no triangles");
    check_value(avatar.gaussians.size() > 0, "colored_mesh", "the avatar has no Gaussians");
    const std::size_t J = body.joint_count(), E = static_cast<std::size_t>(body.expression_count);
    const std::vector<vec3<double>> rest = shaped_vertices(body, avatar.rig.betas),
                                    shape = betas.empty() ? rest : shaped_vertices(body, betas);
    const auto mesh = detail::divided_body(body, rest, shape, avatar.gaussians.size(), params.most_levels);
    const GaussianCloud<float> cloud = shaded_cloud(avatar);
    const auto shares = detail::vertex_shares(mesh, avatar.rig, cloud, rest, params);

    ColoredMesh result;
    result.faces = mesh.faces();
    result.expressions.resize(E);
    std::vector<vec3<double>> places; // of the vertices, in the frame of the Gaussians: that of the avatar's own shape
    for (std::size_t v = 0; v < mesh.size(); ++v) {
        const Span<const double> row = mesh.row(v);
        result.vertices.push_back(vec3<double>(row[3], row[4], row[5]) + shares.offsets[v]);
        places.push_back(mesh.position(v) + shares.offsets[v]);
        detail::add_influences(result, row.subspan(6, J));
        for (std::size_t e = 0; e < E; ++e)
            result.expressions[e].push_back(
                vec3<float>(vec3<double>(row[6 + J + 3 * e], row[7 + J + 3 * e], row[8 + J + 3 * e])));
    }
    result.normals = vertex_normals(result.vertices, result.faces);
    result.colors = detail::vertex_colors(cloud, shares, vertex_normals(places, result.faces));
    const auto was = regress_joints(body, rest), is = regress_joints(body, shape);
    for (std::size_t j = 0; j < J; ++j) result.rest_joints.push_back(avatar.rig.joints[j] + is[j] - was[j]);
    return result;
}

} // namespace gsh
