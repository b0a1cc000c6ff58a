// SPDX-License-Identifier: Apache-2.0
/// @file  The frames of shadow maps: how the map of each light is aimed at the meshes that cast shadows.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

/// The map of one light: where a point of the world lies in it.
///
/// A point p is at texel (x(p) / w(p), y(p) / w(p)), with nearness q(p) / w(p), which grows towards the light: the
/// reciprocal depth of a point light, metres towards the light for a direction. Both are linear across a triangle's
/// image.
template <class T>
struct ShadowFrame {
    /// An affine function of a point.
    struct Row {
        vec3<T> factor;
        T offset;
        [[nodiscard]] GSH_HD T operator()(const vec3<T>& p) const { return dot(factor, p) + offset; }
    };
    Row x, y, q, w;
    vec3<T> light;  ///< position of a point light, or direction towards the light
    T has_position; ///< 1 for a point light, 0 for a direction
    T near;         ///< smallest w at which anything is drawn or received
    T radius;       ///< texels: half the width of the filter, in [0.5, 1.5]
    T slope_lift;   ///< metres per unit w: lift of a receiver that the light grazes; 0 if casters are closed
    std::int32_t width, height, stride; ///< texels
    std::uint32_t begin;                ///< first texel in the array of all maps
};

namespace detail {

inline constexpr std::size_t shadow_box_vertices = 64; // vertices per box
inline constexpr int shadow_taps = 4;                  // texels along a side of the largest filter
inline constexpr int shadow_margin = 3;                // texels before the casters that stay empty: a filter's width
inline constexpr int shadow_margins = shadow_margin + shadow_taps; // and those before and after them
inline constexpr int largest_shadow_map = 1024; // texels; 4 more bits for parts of a texel: products fit 32

/// Nearness of a texel that nothing covers.
template <class T>
inline constexpr T shadow_empty = T(-1e30);

template <class T>
struct ShadowBox {
    vec3<T> low, high;

    GSH_HD void include(const ShadowBox& other) {
        low = {min(low.x, other.low.x), min(low.y, other.low.y), min(low.z, other.low.z)};
        high = {max(high.x, other.high.x), max(high.y, other.high.y), max(high.z, other.high.z)};
    }
};

/// The bounds of `shadow_box_vertices` consecutive vertices.
template <class T>
struct BoundShadowCasters {
    Span<const vec3<T>> vertices;
    Span<ShadowBox<T>> boxes;
    GSH_HD void operator()(std::size_t i) const {
        const std::size_t begin = i * shadow_box_vertices, past = begin + shadow_box_vertices;
        const std::size_t end = past < vertices.size() ? past : vertices.size();
        ShadowBox<T> box{vertices[begin], vertices[begin]};
        for (std::size_t v = begin + 1; v < end; ++v) box.include({vertices[v], vertices[v]});
        boxes[i] = box;
    }
};

/// The frame of each light: it looks at the middle of the casters, and its map covers them tightly.
template <class T>
struct AimShadowMaps {
    using Frame = ShadowFrame<T>;
    using Row = typename Frame::Row;

    Span<const vec3<T>> points, directions;
    Span<const ShadowBox<T>> boxes;
    Span<Frame> frames;
    std::int32_t resolutions[2]; // of points and of directions
    T softness[2];
    bool closed;

    GSH_HD void operator()(std::size_t l) const {
        vec3<T> center(T(0));
        if (!boxes.empty()) {
            ShadowBox<T> all = boxes[0];
            for (std::size_t b = 1; b < boxes.size(); ++b) all.include(boxes[b]);
            center = middle(all);
        }
        const View view = look(l, center);
        Bounds bounds(view);
        for (std::size_t b = 0; b < boxes.size(); ++b) bounds.include(view, boxes[b]);
        frames[l] = cover(l, view, bounds);
    }

    [[nodiscard]] GSH_HD static vec3<T> middle(const ShadowBox<T>& all) { return (all.low + all.high) * T(0.5); }

    /// A frame that looks at the middle but has no scale yet.
    struct View {
        Frame frame;
        T distance; ///< of the middle
        T widest;   ///< largest x / w and y / w; a wider angle is cut off
    };
    [[nodiscard]] GSH_HD View look(std::size_t l, const vec3<T>& center) const {
        const bool is_point = l < points.size();
        View view;
        Frame& frame = view.frame;
        frame.light = is_point ? points[l] : directions[l - points.size()];
        frame.has_position = is_point ? T(1) : T(0);
        frame.stride = resolutions[is_point ? 0 : 1];
        frame.begin = begin_of(l);

        // Axes x right, y down, z away from the light; the vertical of the world is the map's, for people are tall.
        vec3<T> z = is_point ? center - frame.light : -frame.light;
        T distance = length(z);
        z = distance > T(1e-6) ? z * (T(1) / distance) : vec3<T>(T(0), T(-1), T(0));
        const vec3<T> up = abs(z.y) < T(0.999) ? vec3<T>(T(0), T(1), T(0)) : vec3<T>(T(1), T(0), T(0));
        const vec3<T> x = normalize(cross(z, up)), y = cross(z, x);
        const vec3<T> origin = is_point ? frame.light : center;
        const auto row = [&](const vec3<T>& axis) { return Row{axis, -dot(axis, origin)}; };
        const Row one{vec3<T>(T(0)), T(1)};
        frame.x = row(x), frame.y = row(y);
        frame.w = is_point ? row(z) : one;
        frame.q = is_point ? one : row(-z);
        if (!is_point) distance = 1;
        frame.near = is_point ? T(0.02) : T(0.5);
        view.distance = max(distance, frame.near);
        view.widest = is_point ? T(3) : T(1e6);
        return view;
    }

    /// Bounds of x / w and y / w.
    struct Bounds {
        T low[2], high[2];

        GSH_HD explicit Bounds(const View& view) : low{view.widest, view.widest}, high{-view.widest, -view.widest} {}

        GSH_HD void include(const View& view, const ShadowBox<T>& box) {
            const Frame& frame = view.frame;
            const T widest = view.widest;
            const vec3<T> half = (box.high - box.low) * T(0.5), at = box.low + half;
            const T depth = frame.w(at), depth_half = reach(frame.w, half);
            const T far = depth + depth_half, close = max(depth - depth_half, frame.near);
            if (!(far > frame.near)) return;
            const Row* rows[2] = {&frame.x, &frame.y};
            for (int k = 0; k < 2; ++k) {
                const T value = (*rows[k])(at), size = reach(*rows[k], half);
                const T least = value - size, most = value + size;
                low[k] = min(low[k], max(least / (least < T(0) ? close : far), -widest));
                high[k] = max(high[k], min(most / (most < T(0) ? far : close), widest));
            }
        }
    };

    /// The frame whose map covers the bounds.
    [[nodiscard]] GSH_HD Frame cover(std::size_t l, const View& view, const Bounds& bounds) const {
        const int kind = l < points.size() ? 0 : 1;
        Frame frame = view.frame;
        T extent[2], low[2] = {bounds.low[0], bounds.low[1]};
        for (int k = 0; k < 2; ++k) {
            extent[k] = bounds.high[k] - low[k];
            if (!(extent[k] >= T(0) && extent[k] < T(1e6))) extent[k] = low[k] = T(0); // no casters, or not finite
        }

        // A texel need not be smaller than the filter requires.
        const T finest = softness[kind] / (T(1.5) * view.distance);
        const T texel = max(max(extent[0], extent[1]) / T(frame.stride - shadow_margins - 1), max(finest, T(1e-6)));
        const T scale = T(1) / texel;
        frame.width = static_cast<std::int32_t>(extent[0] * scale) + 1 + shadow_margins;
        frame.height = static_cast<std::int32_t>(extent[1] * scale) + 1 + shadow_margins;
        frame.x = to_texels(frame.x, frame.w, low[0], scale);
        frame.y = to_texels(frame.y, frame.w, low[1], scale);
        frame.radius = clamp(softness[kind] / (view.distance * texel), T(0.5), T(1.5));
        frame.slope_lift = closed ? T(0) : (frame.radius + T(0.5)) * texel;
        return frame;
    }

    [[nodiscard]] GSH_HD std::uint32_t begin_of(std::size_t l) const {
        const std::size_t before = l < points.size() ? l : points.size(), after = l - before;
        const auto area = [&](int kind) {
            return static_cast<std::size_t>(resolutions[kind]) * static_cast<std::size_t>(resolutions[kind]);
        };
        return static_cast<std::uint32_t>(before * area(0) + after * area(1));
    }

private:
    /// How far a row changes from the middle of a box to its corners.
    [[nodiscard]] GSH_HD static T reach(const Row& row, const vec3<T>& half) {
        return abs(row.factor.x) * half.x + abs(row.factor.y) * half.y + abs(row.factor.z) * half.z;
    }
    /// The row that is `shadow_margin` w where `row` / w is `low`, in texels.
    [[nodiscard]] GSH_HD static Row to_texels(const Row& row, const Row& w, T low, T scale) {
        const T shift = T(shadow_margin) - low * scale;
        return {row.factor * scale + w.factor * shift, row.offset * scale + w.offset * shift};
    }
};

} // namespace detail

} // namespace gsh
