// SPDX-License-Identifier: Apache-2.0
/// @file  The posed mesh of a body with unit vertex normals, with adjoint to bones and canonical offsets.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_element.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace gsh {

/// The mesh of a body in a pose, by linear blend skinning, and its unit vertex normals.
///
///     x_v = M_v (rest_v + offset_v),   M_v = Σ_j w_vj B_j
///     n_v = s_v / |s_v|,               s_v = Σ_{triangles (a, b, c) at v} (b - a) × (c - a)
///
/// Both passes are gathers in a fixed order: from a vertex to its triangles, and from a bone to its vertices. Results
/// therefore do not depend on the number of threads, and no backend needs an overload.
///
/// Shapes  bones [J], offsets [V], vertices and normals [V].
/// Frame   rest and offsets canonical; vertices and normals in the frame to which the bones lead, normals outward.
/// Units   metres.
template <Backend B, std::floating_point T = float>
class PosedSurface {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    struct Cache {
        Buffer<vec3<T>> vertices; // [V]
        Buffer<vec3<T>> normals;  // [V] unit vectors, zero at a vertex without area
        // working storage
        Buffer<vec3<T>> crosses;       // [F]
        Buffer<T> inverse_lengths;     // [V] 1 / |s_v|, or 0
        Buffer<vec3<T>> dL_dsums;      // [V]
        Buffer<vec3<T>> dL_dposed;     // [V]
        Buffer<Affine<T>> dL_dpieces;  // [pieces]
    };

    /// The surface of a body of shape `betas` with a neutral face. The weights are the body's, all of them, normalised.
    ///
    /// Errors  ShapeError or ValueError for weights or faces that do not fit the vertices.
    PosedSurface(B& backend, const BodyModel& body, Span<const double> betas)
        : backend_(&backend), vertex_count_(body.vertex_count()), joint_count_(body.joint_count()),
          face_count_(body.faces.size()) {
        check_size("PosedSurface", "weights", body.weights.size(), vertex_count_ * joint_count_,
                   "store one weight per vertex and joint");
        detail::check_triangles("PosedSurface", "faces", body.faces, vertex_count_);
        const std::vector<vec3<double>> shaped = shaped_vertices(body, betas);
        assign(*backend_, std::vector<vec3<T>>(shaped.begin(), shaped.end()), rest_);

        const SkinWeightTable<T> skin = sparse_weights(body.weights, joint_count_).template cast<T>();
        influences_ = skin.influences;
        assign(*backend_, skin.joints, skin_joints_);
        assign(*backend_, skin.weights, skin_weights_);
        group_by_bone(skin);
        group_by_vertex(body.faces);
    }

    [[nodiscard]] std::size_t vertex_count() const { return vertex_count_; }
    [[nodiscard]] std::size_t joint_count() const { return joint_count_; }
    [[nodiscard]] std::size_t triangle_count() const { return face_count_; }
    /// The body's faces, in the backend's memory.
    [[nodiscard]] Span<const vec3<std::uint32_t>> triangles() const { return triangles_; }

    /// Writes vertices and normals to the cache.
    ///
    /// Shapes  offsets [V] are added to the rest vertices before skinning, as Rig::Cache::vertex_offsets.
    void forward(Span<const Affine<T>> bones, Span<const vec3<T>> offsets, Cache& cache) const {
        check_inputs("PosedSurface::forward", bones, offsets);
        cache.vertices.resize(vertex_count_), cache.normals.resize(vertex_count_);
        cache.crosses.resize(face_count_), cache.inverse_lengths.resize(vertex_count_);
        backend_->for_each(vertex_count_, detail::PoseVertex<T>{skin(), bones, rest_, offsets, cache.vertices});
        backend_->for_each(face_count_, detail::TriangleCross<T>{triangles_, cache.vertices, cache.crosses});
        backend_->for_each(vertex_count_, detail::VertexNormal<T>{corner_starts_, corners_, cache.crosses,
                                                                  cache.normals, cache.inverse_lengths});
    }

    /// Adds to dL_dbones and dL_doffsets. Each of the four gradients may be empty: it then counts as zero, or is not
    /// computed. bones, offsets and cache are those of forward.
    void backward(Span<const Affine<T>> bones, Span<const vec3<T>> offsets, Span<const vec3<T>> dL_dvertices,
                  Span<const vec3<T>> dL_dnormals, Cache& cache, Span<Affine<T>> dL_dbones,
                  Span<vec3<T>> dL_doffsets) const {
        constexpr std::string_view where = "PosedSurface::backward";
        check_inputs(where, bones, offsets);
        check_size(where, "cache.vertices", cache.vertices.size(), vertex_count_, "forward must come first");
        check_optional(where, "dL_dvertices", dL_dvertices, vertex_count_, "store one per vertex, or none");
        check_optional(where, "dL_dnormals", dL_dnormals, vertex_count_, "store one per vertex, or none");
        check_optional(where, "dL_dbones", dL_dbones, joint_count_, "store one per joint, or none");
        check_optional(where, "dL_doffsets", dL_doffsets, vertex_count_, "store one per vertex, or none");
        if ((dL_dvertices.empty() && dL_dnormals.empty()) || (dL_dbones.empty() && dL_doffsets.empty())) return;

        Span<const vec3<T>> dL_dsums;
        if (!dL_dnormals.empty()) {
            cache.dL_dsums.resize(vertex_count_);
            backend_->for_each(vertex_count_,
                               detail::VertexNormalBackward<T>{cache.normals, dL_dnormals, cache.inverse_lengths,
                                                               cache.dL_dsums});
            dL_dsums = cache.dL_dsums;
        }
        cache.dL_dposed.resize(vertex_count_);
        backend_->for_each(vertex_count_,
                           detail::PoseVertexBackward<T>{skin(), bones, corner_starts_, corners_, triangles_,
                                                         cache.vertices, dL_dvertices, dL_dsums, cache.dL_dposed,
                                                         dL_doffsets});
        if (!dL_dbones.empty()) add_to_bones(rest_, offsets, cache.dL_dposed, cache, dL_dbones);
    }

    /// Normals that differ from those of the mesh, as under cloth:
    ///
    ///     result_v = n_v + L_v normal_offset_v,   L_v the linear part of M_v
    ///
    /// The offsets are canonical and turn with the skin. Results have any length. n is that of the last forward.
    ///
    /// Shapes  normal_offsets, result [V].
    void offset_normals(Span<const Affine<T>> bones, Span<const vec3<T>> normal_offsets, const Cache& cache,
                        Span<vec3<T>> result) const {
        constexpr std::string_view where = "PosedSurface::offset_normals";
        check_inputs(where, bones, normal_offsets, "normal_offsets");
        check_size(where, "cache.normals", cache.normals.size(), vertex_count_, "forward must come first");
        check_size(where, "result", result.size(), vertex_count_, "store one per vertex");
        check_memory(*backend_, where, "result", result);
        backend_->for_each(vertex_count_,
                           detail::OffsetNormal<T>{skin(), bones, cache.normals, normal_offsets, result});
    }

    /// Adjoint of offset_normals, but for the gradient of n, which is dL_dresult itself: adds to dL_dbones and
    /// dL_dnormal_offsets, each of which may be empty.
    void offset_normals_backward(Span<const Affine<T>> bones, Span<const vec3<T>> normal_offsets,
                                 Span<const vec3<T>> dL_dresult, Cache& cache, Span<Affine<T>> dL_dbones,
                                 Span<vec3<T>> dL_dnormal_offsets) const {
        constexpr std::string_view where = "PosedSurface::offset_normals_backward";
        check_inputs(where, bones, normal_offsets, "normal_offsets");
        check_size(where, "dL_dresult", dL_dresult.size(), vertex_count_, "store one per vertex");
        check_memory(*backend_, where, "dL_dresult", dL_dresult);
        check_optional(where, "dL_dbones", dL_dbones, joint_count_, "store one per joint, or none");
        check_optional(where, "dL_dnormal_offsets", dL_dnormal_offsets, vertex_count_, "store one per vertex, or none");
        if (!dL_dnormal_offsets.empty())
            backend_->for_each(vertex_count_,
                               detail::OffsetNormalBackward<T>{skin(), bones, dL_dresult, dL_dnormal_offsets});
        if (!dL_dbones.empty()) add_to_bones({}, normal_offsets, dL_dresult, cache, dL_dbones);
    }

private:
    /// Vertices whose contributions to one bone are summed by one element: short enough to share the heaviest bones
    /// between threads.
    static constexpr std::size_t piece_length = 64;

    [[nodiscard]] SkinWeights<T> skin() const { return {skin_joints_, skin_weights_, influences_}; }

    /// Adds to dL_dbones what BonePieceBackward sums.
    void add_to_bones(Span<const vec3<T>> rest, Span<const vec3<T>> offsets, Span<const vec3<T>> dL_dposed,
                      Cache& cache, Span<Affine<T>> dL_dbones) const {
        const std::size_t pieces = piece_starts_.size() - 1;
        cache.dL_dpieces.resize(pieces);
        bone_pieces_sum(*backend_, detail::BonePieceBackward<T>{piece_starts_, moved_, rest, offsets, dL_dposed,
                                                                cache.dL_dpieces});
        bone_pieces_join(*backend_, detail::JoinBonePieces<T>{bone_pieces_, cache.dL_dpieces, dL_dbones});
    }

    void group_by_bone(const SkinWeightTable<T>& skin) {
        std::vector<std::vector<detail::MovedVertex<T>>> of_bone(joint_count_);
        for (std::size_t i = 0; i < skin.weights.size(); ++i)
            if (skin.weights[i] != T(0))
                of_bone[skin.joints[i]].push_back({static_cast<std::uint32_t>(i / influences_), skin.weights[i]});
        std::vector<detail::MovedVertex<T>> moved;
        std::vector<std::uint32_t> piece_starts{0}, bone_pieces{0};
        for (const auto& vertices : of_bone) {
            for (std::size_t k = 0; k < vertices.size(); k += piece_length) {
                moved.insert(moved.end(), vertices.begin() + static_cast<std::ptrdiff_t>(k),
                             vertices.begin() +
                                 static_cast<std::ptrdiff_t>(std::min(vertices.size(), k + piece_length)));
                piece_starts.push_back(static_cast<std::uint32_t>(moved.size()));
            }
            bone_pieces.push_back(static_cast<std::uint32_t>(piece_starts.size() - 1));
        }
        assign(*backend_, moved, moved_);
        assign(*backend_, piece_starts, piece_starts_);
        assign(*backend_, bone_pieces, bone_pieces_);
    }

    void group_by_vertex(const std::vector<std::array<int, 3>>& faces) {
        std::vector<std::uint32_t> starts(vertex_count_ + 1, 0), corners(3 * faces.size());
        for (const auto& face : faces)
            for (const int v : face) ++starts[static_cast<std::size_t>(v) + 1];
        for (std::size_t v = 0; v < vertex_count_; ++v) starts[v + 1] += starts[v];
        std::vector<std::uint32_t> next(starts.begin(), starts.end() - 1);
        for (std::size_t n = 0; n < corners.size(); ++n)
            corners[next[static_cast<std::size_t>(faces[n / 3][n % 3])]++] = static_cast<std::uint32_t>(n);
        assign(*backend_, triangle_indices(faces), triangles_);
        assign(*backend_, starts, corner_starts_);
        assign(*backend_, corners, corners_);
    }

    void check_inputs(std::string_view where, Span<const Affine<T>> bones, Span<const vec3<T>> offsets,
                      std::string_view argument = "offsets") const {
        check_size(where, "bones", bones.size(), joint_count_, "store one per joint");
        check_size(where, argument, offsets.size(), vertex_count_, "store one per vertex");
        check_memory(*backend_, where, "bones", bones);
        check_memory(*backend_, where, argument, offsets);
    }
    template <class U>
    void check_optional(std::string_view where, std::string_view argument, Span<U> found, std::size_t count,
                        std::string_view hint) const {
        if (found.empty()) return;
        check_size(where, argument, found.size(), count, hint);
        check_memory(*backend_, where, argument, found);
    }

    B* backend_;
    std::size_t vertex_count_, joint_count_, face_count_, influences_ = 0;
    Buffer<vec3<T>> rest_;                                 // [V]
    Buffer<std::uint16_t> skin_joints_;                    // [V, influences]
    Buffer<T> skin_weights_;                               // [V, influences]
    Buffer<vec3<std::uint32_t>> triangles_;                // [F]
    Buffer<std::uint32_t> corner_starts_, corners_;        // [V + 1], [3 F] triangle * 3 + corner
    Buffer<detail::MovedVertex<T>> moved_;                 // grouped by bone, in pieces
    Buffer<std::uint32_t> piece_starts_, bone_pieces_;     // [pieces + 1], [J + 1]
};

} // namespace gsh
