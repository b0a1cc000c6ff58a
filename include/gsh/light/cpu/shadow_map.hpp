// SPDX-License-Identifier: Apache-2.0
/// @file  Drawing of shadow maps on the CPU, in parallel over lights and bands of rows.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh {

namespace detail {

/// A vertex in a light's map, in sixteenths of a texel; x is negative if it is not in the map.
template <class T>
struct ShadowVertex {
    std::int32_t x, y;
    T nearness;
};

} // namespace detail

template <CpuBackend B, std::floating_point T>
struct ShadowMapScratch<B, T> {
    typename B::template Buffer<detail::ShadowVertex<T>> vertices; ///< [P + D, V] of one caster
};

namespace cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::ShadowVertex;

inline constexpr int shadow_subtexels = 16; // vertices are rounded to this part of a texel

template <class T>
[[nodiscard]] GSH_INLINE ShadowVertex<T> place_shadow_vertex(const ShadowFrame<T>& frame, const vec3<T>& p) {
    const T w = frame.w(p), inverse = T(1) / w;
    const T x = frame.x(p) * inverse, y = frame.y(p) * inverse;
    // Written so that a comparison with NaN is false: what cannot be placed is left out.
    const bool inside = w > frame.near && x >= T(0) && x <= T(frame.width) && y >= T(0) && y <= T(frame.height);
    const auto fixed = [&](T v) {
        return static_cast<std::int32_t>((inside ? v : T(0)) * T(shadow_subtexels) + T(0.5));
    };
    return {inside ? fixed(x) : -1, fixed(y), frame.q(p) * inverse};
}

/// Keeps the greater nearness at the texels of rows [row_begin, row_end) whose centres a triangle covers.
///
/// Coverage is decided in integers by the top-left rule, so neighbouring triangles leave no gap.
template <class T>
GSH_INLINE void draw_shadow_triangle(const ShadowVertex<T>& a, ShadowVertex<T> b, ShadowVertex<T> c, bool closed,
                                     std::int32_t row_begin, std::int32_t row_end, T* map, std::int32_t stride) {
    std::int32_t area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (area <= 0) {
        if (closed || area == 0) return; // it faces the light
        std::swap(b, c), area = -area;
    }
    if ((a.x | b.x | c.x) < 0) return;
    const auto first = [](std::int32_t v) { return (v + 7) >> 4; }; // first texel whose centre is not before v
    const std::int32_t left = first(std::min({a.x, b.x, c.x})), right = first(std::max({a.x, b.x, c.x}) + 1);
    const std::int32_t top = std::max(first(std::min({a.y, b.y, c.y})), row_begin);
    const std::int32_t bottom = std::min(first(std::max({a.y, b.y, c.y}) + 1), row_end);
    if (left >= right || top >= bottom) return;

    struct Edge {
        std::int32_t at, column_step, row_step, least;
        Edge(const ShadowVertex<T>& p, const ShadowVertex<T>& q, std::int32_t x, std::int32_t y)
            : at((q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x)), column_step(-(q.y - p.y) * shadow_subtexels),
              row_step((q.x - p.x) * shadow_subtexels), least(q.y < p.y || (q.y == p.y && q.x > p.x) ? 0 : 1) {}
    };
    const std::int32_t x = left * shadow_subtexels + shadow_subtexels / 2;
    const std::int32_t y = top * shadow_subtexels + shadow_subtexels / 2;
    Edge bc(b, c, x, y), ca(c, a, x, y), ab(a, b, x, y);
    const T inverse_area = T(1) / static_cast<T>(area);
    const T to_b = (b.nearness - a.nearness) * inverse_area, to_c = (c.nearness - a.nearness) * inverse_area;
    for (std::int32_t row = top; row < bottom; ++row) {
        T* const texels = map + static_cast<std::ptrdiff_t>(row) * stride;
        std::int32_t at_bc = bc.at, at_ca = ca.at, at_ab = ab.at;
        for (std::int32_t column = left; column < right; ++column) {
            if (((at_bc - bc.least) | (at_ca - ca.least) | (at_ab - ab.least)) >= 0) {
                const T nearness = a.nearness + static_cast<T>(at_ca) * to_b + static_cast<T>(at_ab) * to_c;
                texels[column] = std::max(texels[column], nearness);
            }
            at_bc += bc.column_step, at_ca += ca.column_step, at_ab += ab.column_step;
        }
        bc.at += bc.row_step, ca.at += ca.row_step, ab.at += ab.row_step;
    }
}

} // namespace detail

/// Draws one caster into the maps of all lights; `clear` empties them first.
///
/// A texel keeps the greatest of the values that its triangles have there, so the order of triangles and the division
/// into bands do not change the result.
template <CpuBackend B, std::floating_point T>
void shadow_draw(B& backend, Span<const ShadowFrame<T>> frames, const ShadowCaster<T>& caster, bool closed, bool clear,
                 Span<T> maps, ShadowMapScratch<B, T>& scratch) {
    using detail::ShadowVertex;
    const std::size_t L = frames.size(), V = caster.vertices.size();
    scratch.vertices.resize(L * V);
    constexpr std::size_t grain = 2048; // vertices
    const std::size_t chunks = chunk_count(V, grain);
    backend.for_chunks(L * chunks, 1, [&](std::size_t task, std::size_t, std::size_t) {
        const std::size_t l = task / chunks, begin = task % chunks * grain, end = std::min(begin + grain, V);
        const ShadowFrame<T> frame = frames[l];
        ShadowVertex<T>* const placed = scratch.vertices.data() + l * V;
        for (std::size_t v = begin; v < end; ++v) placed[v] = detail::place_shadow_vertex(frame, caster.vertices[v]);
    });

    // One band per light occupies a few threads; more threads share the rows of a map, at the price of reading the
    // triangles once more for each band.
    const std::size_t bands = L ? std::clamp<std::size_t>(2 * backend.thread_count() / L, 1, 8) : 1;
    backend.for_chunks(L * bands, 1, [&](std::size_t task, std::size_t, std::size_t) {
        const ShadowFrame<T>& frame = frames[task / bands];
        const ShadowVertex<T>* const placed = scratch.vertices.data() + task / bands * V;
        const auto cut = [&](std::size_t band) {
            return static_cast<std::int32_t>(static_cast<std::size_t>(frame.height) * band / bands);
        };
        const std::int32_t row_begin = cut(task % bands), row_end = cut(task % bands + 1);
        T* const map = maps.data() + frame.begin;
        if (clear)
            for (std::int32_t row = row_begin; row < row_end; ++row)
                std::fill_n(map + static_cast<std::ptrdiff_t>(row) * frame.stride, frame.width,
                            gsh::detail::shadow_empty<T>);
        for (const vec3<std::uint32_t>& t : caster.triangles)
            detail::draw_shadow_triangle(placed[t.x], placed[t.y], placed[t.z], closed, row_begin, row_end, map,
                                         frame.stride);
    });
}

} // namespace cpu

} // namespace gsh
