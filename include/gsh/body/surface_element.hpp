// SPDX-License-Identifier: Apache-2.0
/// @file  The arithmetic of one vertex, triangle or bone of a posed mesh, and its adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

namespace detail {

/// x_v = M_v (rest_v + offset_v), M_v the blend of the bones.
template <class T>
struct PoseVertex {
    SkinWeights<T> skin;
    Span<const Affine<T>> bones;           // [J]
    Span<const vec3<T>> rest, offsets;     // [V]
    Span<vec3<T>> vertices;                // [V]
    GSH_HD void operator()(std::size_t v) const { vertices[v] = blend(skin, v, bones)(rest[v] + offsets[v]); }
};

/// (b - a) × (c - a): twice the area of a triangle, along its normal.
template <class T>
struct TriangleCross {
    Span<const vec3<std::uint32_t>> triangles; // [F]
    Span<const vec3<T>> vertices;              // [V]
    Span<vec3<T>> crosses;                     // [F]
    GSH_HD void operator()(std::size_t f) const {
        const vec3<std::uint32_t> t = triangles[f];
        const vec3<T> a = vertices[t.x];
        crosses[f] = cross(vertices[t.y] - a, vertices[t.z] - a);
    }
};

/// The normal of a vertex: the sum over its triangles, normalised. Both results are zero where the sum is.
template <class T>
struct VertexNormal {
    Span<const std::uint32_t> starts, corners; // [V + 1], [3 F] triangle * 3 + corner, grouped by vertex
    Span<const vec3<T>> crosses;               // [F]
    Span<vec3<T>> normals;                     // [V]
    Span<T> inverse_lengths;                   // [V]
    GSH_HD void operator()(std::size_t v) const {
        vec3<T> sum(T(0));
        for (std::uint32_t e = starts[v]; e < starts[v + 1]; ++e) sum += crosses[corners[e] / 3];
        const T size = length(sum), inverse = size > T(0) ? T(1) / size : T(0);
        normals[v] = sum * inverse;
        inverse_lengths[v] = inverse;
    }
};

/// Adjoint of the normalisation; the gradient of a sum that is zero counts as zero.
template <class T>
struct VertexNormalBackward {
    Span<const vec3<T>> normals, dL_dnormals; // [V]
    Span<const T> inverse_lengths;            // [V]
    Span<vec3<T>> dL_dsums;                   // [V]
    GSH_HD void operator()(std::size_t v) const {
        const vec3<T> n = normals[v], g = dL_dnormals[v];
        dL_dsums[v] = (g - n * dot(n, g)) * inverse_lengths[v];
    }
};

/// From gradients of the vertices and of the sums of cross products to the gradient of a vertex, of its canonical
/// point, and to what its bones need.
template <class T>
struct PoseVertexBackward {
    SkinWeights<T> skin;
    Span<const Affine<T>> bones;                       // [J]
    Span<const std::uint32_t> starts, corners;         // as in VertexNormal
    Span<const vec3<std::uint32_t>> triangles;         // [F]
    Span<const vec3<T>> vertices;                      // [V]
    Span<const vec3<T>> dL_dvertices, dL_dsums;        // [V], or empty
    Span<vec3<T>> dL_dposed;                           // [V] assigned: the whole gradient of the vertex
    Span<vec3<T>> dL_doffsets;                         // [V] added to, or empty

    GSH_HD void operator()(std::size_t v) const {
        vec3<T> gradient = dL_dvertices.empty() ? vec3<T>(T(0)) : dL_dvertices[v];
        if (!dL_dsums.empty())
            for (std::uint32_t e = starts[v]; e < starts[v + 1]; ++e) {
                // g·((b - a) × (c - a)) is the same for each cyclic order; its gradient with respect to a is
                // (b - c) × g.
                const vec3<std::uint32_t> t = triangles[corners[e] / 3];
                const std::uint32_t corner = corners[e] % 3;
                const std::uint32_t b = corner == 0 ? t.y : corner == 1 ? t.z : t.x;
                const std::uint32_t c = corner == 0 ? t.z : corner == 1 ? t.x : t.y;
                gradient += cross(vertices[b] - vertices[c], dL_dsums[t.x] + dL_dsums[t.y] + dL_dsums[t.z]);
            }
        dL_dposed[v] = gradient;
        if (!dL_doffsets.empty()) dL_doffsets[v] += transposed_times(blend(skin, v, bones).linear, gradient);
    }
};

/// n_v + L_v offset_v, L_v the linear part of the blend of the bones.
template <class T>
struct OffsetNormal {
    SkinWeights<T> skin;
    Span<const Affine<T>> bones;              // [J]
    Span<const vec3<T>> normals, offsets;     // [V]
    Span<vec3<T>> result;                     // [V]
    GSH_HD void operator()(std::size_t v) const {
        result[v] = normals[v] + blend(skin, v, bones).linear * offsets[v];
    }
};

template <class T>
struct OffsetNormalBackward {
    SkinWeights<T> skin;
    Span<const Affine<T>> bones;              // [J]
    Span<const vec3<T>> dL_dresult;           // [V]
    Span<vec3<T>> dL_doffsets;                // [V] added to
    GSH_HD void operator()(std::size_t v) const {
        dL_doffsets[v] += transposed_times(blend(skin, v, bones).linear, dL_dresult[v]);
    }
};

/// A vertex that a bone moves.
template <class T>
struct MovedVertex {
    std::uint32_t vertex;
    T weight;
};

/// Sums the gradient of one bone over a piece of its vertices: of what it does to points, rest + offset, or to
/// directions, offset, if `rest` is empty.
template <class T>
struct BonePieceBackward {
    Span<const std::uint32_t> piece_starts;             // [pieces + 1] into moved
    Span<const MovedVertex<T>> moved;                   // grouped by bone
    Span<const vec3<T>> rest, offsets, dL_dposed;       // [V]
    Span<Affine<T>> dL_dpieces;                         // [pieces]
    GSH_HD void operator()(std::size_t piece) const {
        Affine<T> sum = Affine<T>::zero();
        for (std::uint32_t e = piece_starts[piece]; e < piece_starts[piece + 1]; ++e) {
            const std::uint32_t v = moved[e].vertex;
            const vec3<T> g = dL_dposed[v] * moved[e].weight;
            sum.linear += outer(g, rest.empty() ? offsets[v] : rest[v] + offsets[v]);
            if (!rest.empty()) sum.translation += g;
        }
        dL_dpieces[piece] = sum;
    }
};

template <class T>
struct JoinBonePieces {
    Span<const std::uint32_t> bone_pieces; // [J + 1] into dL_dpieces
    Span<const Affine<T>> dL_dpieces;
    Span<Affine<T>> dL_dbones;             // [J]
    GSH_HD void operator()(std::size_t j) const {
        Affine<T> sum = Affine<T>::zero();
        for (std::uint32_t piece = bone_pieces[j]; piece < bone_pieces[j + 1]; ++piece)
            sum.add_scaled(dL_dpieces[piece], T(1));
        dL_dbones[j].add_scaled(sum, T(1));
    }
};

} // namespace detail

/// Sums the gradient of each piece of a bone's vertices. This version and the next need no overload; a backend may have
/// faster ones.
template <Backend B, class T>
void bone_pieces_sum(B& backend, const detail::BonePieceBackward<T>& element) {
    backend.for_each(element.dL_dpieces.size(), element);
}
/// Adds the pieces of each bone.
template <Backend B, class T>
void bone_pieces_join(B& backend, const detail::JoinBonePieces<T>& element) {
    backend.for_each(element.dL_dbones.size(), element);
}

} // namespace gsh
