// SPDX-License-Identifier: Apache-2.0
/// @file  Barycentric interpolation of per-vertex values at points on the mesh, with adjoint.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace gsh {

namespace detail {

/// An index and its weight.
template <class T>
struct Contribution {
    std::uint32_t index;
    T weight;
};

template <class T, class Vector = vec3<T>>
struct SurfaceGather {
    Span<const Contribution<T>> corners; // [N, 3]
    Span<const Vector> values;           // [V]
    Span<Vector> points;                 // [N]
    GSH_HD void operator()(std::size_t i) const {
        const Contribution<T>* corner = corners.data() + 3 * i;
        points[i] += values[corner[0].index] * corner[0].weight + values[corner[1].index] * corner[1].weight +
                     values[corner[2].index] * corner[2].weight;
    }
};

template <class T, class Vector = vec3<T>>
struct SurfaceScatter {
    Span<const std::uint32_t> starts;      // [V + 1]
    Span<const Contribution<T>> entries;   // [3 N], grouped by vertex
    Span<const Vector> dL_dpoints;         // [N]
    Span<Vector> dL_dvalues;               // [V]
    GSH_HD void operator()(std::size_t v) const {
        Vector sum(T(0));
        for (std::uint32_t e = starts[v]; e < starts[v + 1]; ++e)
            sum += dL_dpoints[entries[e].index] * entries[e].weight;
        dL_dvalues[v] += sum;
    }
};

} // namespace detail

/// Sums the gradients of each vertex's samples. This version needs no overload; a backend may have a faster one.
template <Backend B, class T, class Vector>
void surface_scatter(B& backend, const detail::SurfaceScatter<T, Vector>& element) {
    backend.for_each(element.dL_dvalues.size(), element);
}

/// points[i] += Σ_c barycentric[i][c] values[triangle_i[c]].
///
/// The triangles and barycentric coordinates are fixed, so the transpose is sorted once (compressed rows, one per
/// vertex). backward is then a gather like forward: each vertex sums its samples in a fixed order, without atomics or
/// partial sums. Propagating a gradient from N samples to C coefficients costs 3N + VC products this way. The direct
/// way would cost NC products and would store directions per sample.
///
/// Shapes  values [V], points [N].
template <Backend B, std::floating_point T = float>
class SurfaceInterpolation {
public:
    /// Shapes  triangles [N] vertex indices, barycentric [N].
    /// Errors  ShapeError if they differ in size, ValueError for a vertex index out of range.
    SurfaceInterpolation(B& backend, std::size_t vertex_count, Span<const std::array<int, 3>> triangles,
                         Span<const vec3<double>> barycentric)
        : backend_(&backend), vertex_count_(vertex_count), point_count_(triangles.size()) {
        check_size("SurfaceInterpolation", "barycentric", barycentric.size(), triangles.size(),
                   "store one triple per point");
        std::vector<detail::Contribution<T>> corners(3 * point_count_), entries(3 * point_count_);
        std::vector<std::uint32_t> starts(vertex_count + 1, 0);
        for (std::size_t i = 0; i < point_count_; ++i)
            for (int c = 0; c < 3; ++c) {
                const int v = triangles[i][static_cast<std::size_t>(c)];
                check_value(v >= 0 && static_cast<std::size_t>(v) < vertex_count, "SurfaceInterpolation",
                            "a triangle names a vertex that the mesh does not have");
                corners[3 * i + static_cast<std::size_t>(c)] = {static_cast<std::uint32_t>(v), T(barycentric[i][c])};
                ++starts[static_cast<std::size_t>(v) + 1];
            }
        for (std::size_t v = 0; v < vertex_count; ++v) starts[v + 1] += starts[v];
        std::vector<std::uint32_t> next(starts.begin(), starts.end() - 1);
        for (std::size_t n = 0; n < corners.size(); ++n)
            entries[next[corners[n].index]++] = {static_cast<std::uint32_t>(n / 3), corners[n].weight};

        assign(backend, corners, corners_);
        assign(backend, entries, entries_);
        assign(backend, starts, starts_);
    }

    [[nodiscard]] std::size_t vertex_count() const { return vertex_count_; }
    [[nodiscard]] std::size_t point_count() const { return point_count_; }
    /// The three vertices and weights of each point, [N, 3], for kernels that interpolate more than one array.
    [[nodiscard]] Span<const detail::Contribution<T>> corners() const { return corners_; }

    /// Adds to points. Values are vec3<T>, vec2<T> or T.
    template <class Vector = vec3<T>>
    void forward(std::type_identity_t<Span<const Vector>> values, std::type_identity_t<Span<Vector>> points) const {
        check_size("SurfaceInterpolation::forward", "values", values.size(), vertex_count_, "store one per vertex");
        check_size("SurfaceInterpolation::forward", "points", points.size(), point_count_, "store one per sample");
        check_memory(*backend_, "SurfaceInterpolation::forward", "values", values);
        check_memory(*backend_, "SurfaceInterpolation::forward", "points", points);
        backend_->for_each(point_count_, detail::SurfaceGather<T, Vector>{corners_, values, points});
    }

    /// Adds to dL_dvalues.
    template <class Vector = vec3<T>>
    void backward(std::type_identity_t<Span<const Vector>> dL_dpoints,
                  std::type_identity_t<Span<Vector>> dL_dvalues) const {
        check_size("SurfaceInterpolation::backward", "dL_dpoints", dL_dpoints.size(), point_count_,
                   "store one per sample");
        check_size("SurfaceInterpolation::backward", "dL_dvalues", dL_dvalues.size(), vertex_count_,
                   "store one per vertex");
        check_memory(*backend_, "SurfaceInterpolation::backward", "dL_dpoints", dL_dpoints);
        check_memory(*backend_, "SurfaceInterpolation::backward", "dL_dvalues", dL_dvalues);
        surface_scatter(*backend_, detail::SurfaceScatter<T, Vector>{starts_, entries_, dL_dpoints, dL_dvalues});
    }

private:
    B* backend_;
    std::size_t vertex_count_, point_count_;
    typename B::template Buffer<detail::Contribution<T>> corners_, entries_;
    typename B::template Buffer<std::uint32_t> starts_;
};

} // namespace gsh
