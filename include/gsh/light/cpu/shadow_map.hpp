// SPDX-License-Identifier: Apache-2.0
/// @file  Drawing of shadow maps on the CPU, in parallel over lights and bands of rows.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
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
    const auto first = [](std::int32_t v) { return (v + 7) >> 4; }; // first texel whose centre is not before v
    const std::int32_t left = first(std::min({a.x, b.x, c.x})), right = first(std::max({a.x, b.x, c.x}) + 1);
    const std::int32_t top = std::max(first(std::min({a.y, b.y, c.y})), row_begin);
    const std::int32_t bottom = std::min(first(std::max({a.y, b.y, c.y}) + 1), row_end);
    // One branch for all reasons to leave: it faces the light, has no area, is not in the map, or covers no centre.
    const bool faces_light = closed ? area <= 0 : area == 0;
    if (faces_light | ((a.x | b.x | c.x) < 0) | (left >= right) | (top >= bottom)) return;
    if (area < 0) std::swap(b, c), area = -area;

    typedef std::int32_t Ints __attribute__((vector_size(16)));
    typedef T Numbers __attribute__((vector_size(4 * sizeof(T))));
    using Mask = decltype(Numbers{} < Numbers{});
    constexpr Ints lanes{0, 1, 2, 3};
    const std::int32_t x = left * shadow_subtexels + shadow_subtexels / 2;
    const std::int32_t y = top * shadow_subtexels + shadow_subtexels / 2;
    struct Edge { // not negative inside: less one, unless points of the edge, a top or left one, are inside
        Ints at;
        std::int32_t column_step, row_step, less;
    };
    const auto edge = [&](const ShadowVertex<T>& p, const ShadowVertex<T>& q) {
        const std::int32_t dx = q.x - p.x, dy = q.y - p.y, column_step = -dy * shadow_subtexels;
        const std::int32_t less = (dy < 0) | ((dy == 0) & (dx > 0)) ? 0 : 1;
        return Edge{dx * (y - p.y) - dy * (x - p.x) - less + lanes * column_step, column_step, dx * shadow_subtexels,
                    less};
    };
    Edge bc = edge(b, c), ca = edge(c, a), ab = edge(a, b);
    const T inverse_area = T(1) / static_cast<T>(area);
    const T to_b = (b.nearness - a.nearness) * inverse_area, to_c = (c.nearness - a.nearness) * inverse_area;
    const T at_a = a.nearness + static_cast<T>(ca.less) * to_b + static_cast<T>(ab.less) * to_c;
    // Four columns at a time. The map's margin lies behind the last of them.
    static_assert(gsh::detail::shadow_margin >= 3);
    for (std::int32_t row = top; row < bottom; ++row) {
        T* texels = map + static_cast<std::ptrdiff_t>(row) * stride + left;
        Ints at_bc = bc.at, at_ca = ca.at, at_ab = ab.at;
        for (std::int32_t column = left; column < right; column += 4, texels += 4) {
            const Mask inside = __builtin_convertvector((at_bc | at_ca | at_ab) >= 0, Mask);
            const Numbers nearness = at_a + __builtin_convertvector(at_ca, Numbers) * to_b +
                                     __builtin_convertvector(at_ab, Numbers) * to_c;
            Numbers texel;
            std::memcpy(&texel, texels, sizeof texel);
            texel = (inside & (nearness > texel)) ? nearness : texel;
            std::memcpy(texels, &texel, sizeof texel);
            at_bc += 4 * bc.column_step, at_ca += 4 * ca.column_step, at_ab += 4 * ab.column_step;
        }
        bc.at += bc.row_step, ca.at += ca.row_step, ab.at += ab.row_step;
    }
}

/// As shadow_visibility for a receiver that is in place, a row of the filter in each register.
template <class T>
[[nodiscard]] GSH_INLINE T filter_shadow(const ShadowFrame<T>& frame, const T* map, T left, T top, T nearness, T length,
                                         T scale) {
    typedef T Four __attribute__((vector_size(4 * sizeof(T))));
    static_assert(gsh::detail::shadow_taps == 4);
    const auto column = static_cast<std::int32_t>(left), row = static_cast<std::int32_t>(top);
    Four across, down;
    const auto weigh = [&](T from, Four& weights) { // filter_weights
        const Four begins{0, 1, 2, 3}, ends{1, 2, 3, 4}, start = from - Four{}, stop = (from + length) - Four{};
        const Four share = (stop < ends ? stop : ends) - (begins < start ? start : begins);
        weights = (share < Four{} ? Four{} : share) * scale;
    };
    weigh(left - static_cast<T>(column), across), weigh(top - static_cast<T>(row), down);
    const T* texels = map + static_cast<std::ptrdiff_t>(row) * frame.stride + column;
    Four hidden{};
    for (int j = 0; j < 4; ++j, texels += frame.stride) {
        Four texel;
        std::memcpy(&texel, texels, sizeof texel);
        hidden += texel > nearness ? down[j] - Four{} : Four{};
    }
    hidden *= across;
    return clamp(T(1) - ((hidden[0] + hidden[1]) + (hidden[2] + hidden[3])), T(0), T(1));
}

} // namespace detail

/// A chunk of receivers is placed in a light's map lane by lane; then those that face the light are filtered.
template <CpuBackend B, std::floating_point T>
void shadow_receive(B& backend, const gsh::detail::ReceiveShadows<T>& element) {
    using W = Wide<T>;
    constexpr std::size_t width = W::width, grain = 256; // vertices: their places stay in the first-level cache
    static_assert(grain % width == 0);
    const std::size_t L = element.frames.size();
    backend.for_chunks(element.vertices.size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const std::size_t count = end - begin;
        alignas(64) T points[3][grain], normals[3][grain], left[grain], top[grain], nearness[grain], state[grain];
        std::uint16_t facing[grain];
        for (std::size_t i = 0; i < grain; ++i) { // the last vertex fills the lanes beyond the end
            const std::size_t v = begin + std::min(i, count - 1);
            for (int k = 0; k < 3; ++k)
                points[k][i] = element.vertices[v][k], normals[k][i] = element.normals[v][k];
        }
        T* const out = element.visibility.data() + begin * L;
        for (std::size_t l = 0; l < L; ++l) {
            const ShadowFrame<T> frame = element.frames[l];
            for (std::size_t i = 0; i < count; i += width) {
                const auto load = [i](const T(&from)[3][grain]) {
                    return vec3<W>(W::load(from[0] + i), W::load(from[1] + i), W::load(from[2] + i));
                };
                const auto place = gsh::detail::place_receiver(frame, load(points), load(normals), element.lift);
                place.left.store(left + i), place.top.store(top + i), place.nearness.store(nearness + i);
                select(place.away, W(T(0)), select(place.unseen, W(T(1)), W(T(-1)))).store(state + i);
            }
            std::size_t kept = 0;
            for (std::size_t i = 0; i < count; ++i) {
                facing[kept] = static_cast<std::uint16_t>(i);
                kept += state[i] < T(0);
                out[i * L + l] = state[i];
            }
            const T* const map = element.maps.data() + frame.begin;
            const T length = 2 * frame.radius, scale = T(1) / length;
            for (std::size_t k = 0; k < kept; ++k) {
                const std::size_t i = facing[k];
                out[i * L + l] = detail::filter_shadow(frame, map, left[i], top[i], nearness[i], length, scale);
            }
        }
    });
}

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
