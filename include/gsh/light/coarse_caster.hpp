// SPDX-License-Identifier: Apache-2.0
/// @file  A coarse mesh that casts the shadows of a posed surface, for speed.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/coarse_mesh.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

namespace detail {

template <class T>
struct PickVertices {
    Span<const std::uint32_t> picked; // [C]
    Span<const vec3<T>> vertices;     // [V]
    Span<vec3<T>> result;             // [C]
    GSH_HD void operator()(std::size_t i) const { result[i] = vertices[picked[i]]; }
};

} // namespace detail

/// Metres. The texels of a person's map are larger than half of this, and fingers are still round.
inline constexpr double default_caster_spacing = 0.013;

/// Some vertices of a surface and triangles between them (coarse_mesh), chosen once in the rest pose. They follow the
/// surface in every pose, since they are vertices of it.
///
/// Shapes  vertices [V] of the surface.
/// Units   metres.
template <Backend B, std::floating_point T = float>
class CoarseCaster {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    struct Cache {
        Buffer<vec3<T>> vertices; // [C] the picked ones
    };

    /// Shapes  rest [V] vertices in the rest pose, faces indices into them.
    /// Errors  those of coarse_mesh.
    CoarseCaster(B& backend, Span<const vec3<double>> rest, Span<const std::array<int, 3>> faces,
                 double spacing = default_caster_spacing)
        : backend_(&backend), vertex_count_(rest.size()) {
        const CoarseMesh mesh = coarse_mesh(rest, faces, spacing);
        const std::vector<vec3<std::uint32_t>> triangles = triangle_indices(mesh.faces);
        assign(backend, mesh.picked, picked_);
        assign(backend, triangles, triangles_);
    }

    [[nodiscard]] std::size_t vertex_count() const { return vertex_count_; }
    [[nodiscard]] std::size_t picked_count() const { return picked_.size(); }
    [[nodiscard]] std::size_t triangle_count() const { return triangles_.size(); }

    /// The caster for a posed surface; valid until the cache is used again.
    [[nodiscard]] ShadowCaster<T> forward(Span<const vec3<T>> vertices, Cache& cache) const {
        check_size("CoarseCaster::forward", "vertices", vertices.size(), vertex_count_,
                   "the surface must be the one that it was made for");
        check_memory(*backend_, "CoarseCaster::forward", "vertices", vertices);
        cache.vertices.resize(picked_.size());
        backend_->for_each(picked_.size(), detail::PickVertices<T>{picked_, vertices, cache.vertices});
        return {cache.vertices, triangles_};
    }

private:
    B* backend_;
    std::size_t vertex_count_;
    Buffer<std::uint32_t> picked_;
    Buffer<vec3<std::uint32_t>> triangles_;
};

} // namespace gsh
