// SPDX-License-Identifier: Apache-2.0
/// @file  A triangle of a caster in the map of a light: which texels it covers, and its nearness there.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/shadow_frame.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstdint>

namespace gsh {

/// A mesh that casts shadows, in the backend's memory.
///
/// Shapes  vertices [V], in the world; triangles [F] indices below V, counter-clockwise from outside.
template <std::floating_point T>
struct ShadowCaster {
    Span<const vec3<T>> vertices;
    Span<const vec3<std::uint32_t>> triangles;
};

namespace detail {

inline constexpr int shadow_subtexels = 16; // vertices are rounded to this part of a texel

/// A vertex in a light's map, in sixteenths of a texel; x is negative if it is not in the map.
template <class T>
struct ShadowVertex {
    std::int32_t x, y;
    T nearness;
};

template <class T>
[[nodiscard]] GSH_INLINE GSH_HD ShadowVertex<T> place_shadow_vertex(const ShadowFrame<T>& frame, const vec3<T>& p) {
    const T w = frame.w(p), inverse = T(1) / w;
    const T x = frame.x(p) * inverse, y = frame.y(p) * inverse;
    // Written so that a comparison with NaN is false: what cannot be placed is left out.
    const bool inside = w > frame.near && x >= T(0) && x <= T(frame.width) && y >= T(0) && y <= T(frame.height);
    const auto fixed = [&](T v) {
        return static_cast<std::int32_t>((inside ? v : T(0)) * T(shadow_subtexels) + T(0.5));
    };
    return {inside ? fixed(x) : -1, fixed(y), frame.q(p) * inverse};
}

/// The texels whose centres a triangle covers, and its nearness there.
///
/// Coverage is decided in integers by the top-left rule, so neighbouring triangles leave no gap.
template <class T>
struct ShadowTriangle {
    /// Not negative inside: less one, unless points of the edge, a top or left one, are inside.
    struct Edge {
        std::int32_t at, column_step, row_step, less; ///< `at` is the value at the first texel
    };
    std::int32_t left, right, top, bottom; ///< texels: columns [left, right) and rows [top, bottom)
    Edge bc, ca, ab;
    T at_a, to_b, to_c; ///< nearness = at_a + ca to_b + ab to_c

    /// Texels of rows [row_begin, row_end). False if there are none, or if the triangle is not drawn.
    [[nodiscard]] GSH_INLINE GSH_HD bool place(const ShadowVertex<T>& a, ShadowVertex<T> b, ShadowVertex<T> c,
                                               bool closed, std::int32_t row_begin, std::int32_t row_end) {
        std::int32_t area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        const auto first = [](std::int32_t v) { return (v + 7) >> 4; }; // first texel whose centre is not before v
        left = first(least(least(a.x, b.x), c.x)), right = first(most(most(a.x, b.x), c.x) + 1);
        top = most(first(least(least(a.y, b.y), c.y)), row_begin);
        bottom = least(first(most(most(a.y, b.y), c.y) + 1), row_end);
        // One branch for all reasons to leave: it faces the light, has no area, is not in the map, or covers no centre.
        const bool faces_light = closed ? area <= 0 : area == 0;
        if (faces_light | ((a.x | b.x | c.x) < 0) | (left >= right) | (top >= bottom)) return false;
        if (area < 0) {
            const ShadowVertex<T> kept = b;
            b = c, c = kept, area = -area;
        }
        const std::int32_t x = left * shadow_subtexels + shadow_subtexels / 2;
        const std::int32_t y = top * shadow_subtexels + shadow_subtexels / 2;
        const auto edge = [&](const ShadowVertex<T>& p, const ShadowVertex<T>& q) {
            const std::int32_t dx = q.x - p.x, dy = q.y - p.y, column_step = -dy * shadow_subtexels;
            const std::int32_t less = (dy < 0) | ((dy == 0) & (dx > 0)) ? 0 : 1;
            return Edge{dx * (y - p.y) - dy * (x - p.x) - less, column_step, dx * shadow_subtexels, less};
        };
        bc = edge(b, c), ca = edge(c, a), ab = edge(a, b);
        const T inverse_area = T(1) / static_cast<T>(area);
        to_b = (b.nearness - a.nearness) * inverse_area, to_c = (c.nearness - a.nearness) * inverse_area;
        at_a = a.nearness + static_cast<T>(ca.less) * to_b + static_cast<T>(ab.less) * to_c;
        return true;
    }

private:
    [[nodiscard]] GSH_INLINE GSH_HD static std::int32_t least(std::int32_t a, std::int32_t b) { return b < a ? b : a; }
    [[nodiscard]] GSH_INLINE GSH_HD static std::int32_t most(std::int32_t a, std::int32_t b) { return a < b ? b : a; }
};

} // namespace detail

} // namespace gsh
