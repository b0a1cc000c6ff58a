// SPDX-License-Identifier: Apache-2.0
/// @file  Drawing of shadow maps on the CPU, in parallel over lights and bands of rows.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/light/shadow_triangle.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct ShadowMapScratch<B, T> {
    typename B::template Buffer<detail::ShadowVertex<T>> vertices; ///< [P + D, V] of one caster
};

namespace cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::ShadowTriangle;
using gsh::detail::ShadowVertex;

/// Keeps the greater nearness at the texels of rows [row_begin, row_end) whose centres a triangle covers.
template <class T>
GSH_INLINE void draw_shadow_triangle(const ShadowVertex<T>& a, const ShadowVertex<T>& b, const ShadowVertex<T>& c,
                                     bool closed, std::int32_t row_begin, std::int32_t row_end, T* map,
                                     std::int32_t stride) {
    ShadowTriangle<T> triangle;
    if (!triangle.place(a, b, c, closed, row_begin, row_end)) return;
    using Ints = Wide<std::int32_t, 4>;
    using Row = Wide<T, 4>;
    const Ints lanes = Ints::generate([](std::size_t lane) { return lane; });
    const auto &bc = triangle.bc, &ca = triangle.ca, &ab = triangle.ab;
    Ints row_bc = bc.at + lanes * bc.column_step, row_ca = ca.at + lanes * ca.column_step,
         row_ab = ab.at + lanes * ab.column_step;
    // Four columns at a time. The map's margin lies behind the last of them.
    static_assert(gsh::detail::shadow_margin >= 3);
    for (std::int32_t row = triangle.top; row < triangle.bottom; ++row) {
        T* texels = map + static_cast<std::ptrdiff_t>(row) * stride + triangle.left;
        Ints at_bc = row_bc, at_ca = row_ca, at_ab = row_ab;
        for (std::int32_t column = triangle.left; column < triangle.right; column += 4, texels += 4) {
            const auto inside = static_cast<typename Row::Mask>((at_bc | at_ca | at_ab) >= 0);
            const Row nearness = triangle.at_a + Row(at_ca) * triangle.to_b + Row(at_ab) * triangle.to_c;
            const Row texel = Row::load(texels);
            select(inside & (nearness > texel), nearness, texel).store(texels);
            at_bc += 4 * bc.column_step, at_ca += 4 * ca.column_step, at_ab += 4 * ab.column_step;
        }
        row_bc += bc.row_step, row_ca += ca.row_step, row_ab += ab.row_step;
    }
}

/// As shadow_visibility for a receiver that is in place, a row of the filter in each register.
template <class T>
[[nodiscard]] GSH_INLINE T filter_shadow(const ShadowFrame<T>& frame, const T* map, T left, T top, T nearness, T length,
                                         T scale) {
    using Row = Wide<T, gsh::detail::shadow_taps>;
    const auto column = static_cast<std::int32_t>(left), row = static_cast<std::int32_t>(top);
    const auto weights = [&](T from) { // filter_weights
        const Row begins = Row::generate([](std::size_t lane) { return lane; });
        return max(min(begins + T(1), Row(from + length)) - max(begins, Row(from)), Row(T(0))) * scale;
    };
    const Row across = weights(left - static_cast<T>(column)), down = weights(top - static_cast<T>(row));
    const T* texels = map + static_cast<std::ptrdiff_t>(row) * frame.stride + column;
    Row hidden(T(0));
    for (std::size_t j = 0; j < Row::width; ++j, texels += frame.stride)
        hidden += select(Row::load(texels) > nearness, Row(down[j]), Row(T(0)));
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
        for (std::size_t v = begin; v < end; ++v)
            placed[v] = gsh::detail::place_shadow_vertex(frame, caster.vertices[v]);
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
