// SPDX-License-Identifier: Apache-2.0
/// @file  Depth maps of meshes as the lights see them, and the soft visibility of surface vertices from each light.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

struct ShadowMapParams {
    int point_resolution = 256;        ///< texels: the longer side of a point's map is at most this long
    int direction_resolution = 96;     ///< texels: likewise for a direction
    double point_softness = 0.008;     ///< metres: half the width of the filter, at the casters
    double direction_softness = 0.045; ///< metres: likewise for a direction, which stands for a part of the sky
    double normal_offset = 0.004;      ///< metres: a receiver is lifted by this along its normal
    bool closed = true;                ///< casters are closed, so that the sides facing away from a light suffice
};

/// A mesh that casts shadows, in the backend's memory.
///
/// Shapes  vertices [V], in the world; triangles [F] indices below V, counter-clockwise from outside.
template <std::floating_point T>
struct ShadowCaster {
    Span<const vec3<T>> vertices;
    Span<const vec3<std::uint32_t>> triangles;
};

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
    vec3<T> light;     ///< position of a point light, or direction towards the light
    T has_position;    ///< 1 for a point light, 0 for a direction
    T near;            ///< smallest w at which anything is drawn or received
    T radius;          ///< texels: half the width of the filter, in [0.5, 1.5]
    T slope_lift;      ///< metres per unit w: lift of a receiver that the light grazes; 0 if casters are closed
    std::int32_t width, height, stride; ///< texels
    std::uint32_t begin;                ///< first texel in the array of all maps
};

namespace detail {

inline constexpr std::size_t shadow_box_vertices = 64; // vertices per box
inline constexpr int shadow_taps = 4;                  // texels along a side of the largest filter
inline constexpr int shadow_margin = 3;                // texels before the casters that stay empty: a filter's width
inline constexpr int shadow_margins = shadow_margin + shadow_taps; // and those before and after them
inline constexpr int largest_shadow_map = 1024;        // texels; 4 more bits for parts of a texel: products fit 32

/// Nearness of a texel that nothing covers.
template <class T>
inline constexpr T shadow_empty = T(-1e30);

template <class T>
struct ShadowBox {
    vec3<T> low, high;
};

/// The bounds of `shadow_box_vertices` consecutive vertices.
template <class T>
struct BoundShadowCasters {
    Span<const vec3<T>> vertices;
    Span<ShadowBox<T>> boxes;
    GSH_HD void operator()(std::size_t i) const {
        const std::size_t begin = i * shadow_box_vertices, past = begin + shadow_box_vertices;
        const std::size_t end = past < vertices.size() ? past : vertices.size();
        vec3<T> low = vertices[begin], high = low;
        for (std::size_t v = begin + 1; v < end; ++v) {
            const vec3<T> p = vertices[v];
            low = {min(low.x, p.x), min(low.y, p.y), min(low.z, p.z)};
            high = {max(high.x, p.x), max(high.y, p.y), max(high.z, p.z)};
        }
        boxes[i] = {low, high};
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
        const bool is_point = l < points.size();
        const int kind = is_point ? 0 : 1;
        const vec3<T> center = middle();
        Frame frame;
        frame.light = is_point ? points[l] : directions[l - points.size()];
        frame.has_position = is_point ? T(1) : T(0);
        frame.stride = resolutions[kind];
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
        distance = max(distance, frame.near);

        // Bounds of x / w and y / w. A wider angle than that of `widest` is cut off.
        const T widest = is_point ? T(3) : T(1e6);
        T low[2] = {widest, widest}, high[2] = {-widest, -widest};
        for (std::size_t b = 0; b < boxes.size(); ++b) {
            const vec3<T> half = (boxes[b].high - boxes[b].low) * T(0.5), at = boxes[b].low + half;
            const T depth = frame.w(at), depth_half = reach(frame.w, half);
            const T far = depth + depth_half, close = max(depth - depth_half, frame.near);
            if (!(far > frame.near)) continue;
            const Row* rows[2] = {&frame.x, &frame.y};
            for (int k = 0; k < 2; ++k) {
                const T value = (*rows[k])(at), size = reach(*rows[k], half);
                const T least = value - size, most = value + size;
                low[k] = min(low[k], max(least / (least < T(0) ? close : far), -widest));
                high[k] = max(high[k], min(most / (most < T(0) ? far : close), widest));
            }
        }
        T extent[2];
        for (int k = 0; k < 2; ++k) {
            extent[k] = high[k] - low[k];
            if (!(extent[k] >= T(0) && extent[k] < T(1e6))) extent[k] = low[k] = T(0); // no casters, or not finite
        }

        // A texel need not be smaller than the filter asks for.
        const T finest = softness[kind] / (T(1.5) * distance);
        const T texel = max(max(extent[0], extent[1]) / T(frame.stride - shadow_margins - 1), max(finest, T(1e-6)));
        const T scale = T(1) / texel;
        frame.width = static_cast<std::int32_t>(extent[0] * scale) + 1 + shadow_margins;
        frame.height = static_cast<std::int32_t>(extent[1] * scale) + 1 + shadow_margins;
        frame.x = to_texels(frame.x, frame.w, low[0], scale);
        frame.y = to_texels(frame.y, frame.w, low[1], scale);
        frame.radius = clamp(softness[kind] / (distance * texel), T(0.5), T(1.5));
        frame.slope_lift = closed ? T(0) : (frame.radius + T(0.5)) * texel;
        frames[l] = frame;
    }

    [[nodiscard]] GSH_HD std::uint32_t begin_of(std::size_t l) const {
        const std::size_t before = l < points.size() ? l : points.size(), after = l - before;
        const auto area = [&](int kind) {
            return static_cast<std::size_t>(resolutions[kind]) * static_cast<std::size_t>(resolutions[kind]);
        };
        return static_cast<std::uint32_t>(before * area(0) + after * area(1));
    }

private:
    [[nodiscard]] GSH_HD vec3<T> middle() const {
        if (boxes.empty()) return vec3<T>(T(0));
        vec3<T> low = boxes[0].low, high = boxes[0].high;
        for (std::size_t b = 1; b < boxes.size(); ++b) {
            const vec3<T> l = boxes[b].low, h = boxes[b].high;
            low = {min(low.x, l.x), min(low.y, l.y), min(low.z, l.z)};
            high = {max(high.x, h.x), max(high.y, h.y), max(high.z, h.z)};
        }
        return (low + high) * T(0.5);
    }
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

/// The place of a receiver in a map.
template <class T>
struct ShadowPlace {
    T left, top;          ///< texels: the first corner of the filter's square
    T nearness;
    MaskOf<T> away;       ///< it faces away from the light
    MaskOf<T> unseen;     ///< it lies behind the light, or too near
};

/// A point with the given unit normal, lifted by `lift` and by what the frame asks for. T is a number or a lane.
template <class F, Lane T>
[[nodiscard]] GSH_INLINE GSH_HD ShadowPlace<T> place_receiver(const ShadowFrame<F>& frame, const vec3<T>& point,
                                                              const vec3<T>& normal, F lift) {
    const auto row = [](const typename ShadowFrame<F>::Row& r, const vec3<T>& p) {
        return T(r.factor.x) * p.x + T(r.factor.y) * p.y + T(r.factor.z) * p.z + T(r.offset);
    };
    const T has_position(frame.has_position), zero(F(0));
    const vec3<T> to_light(T(frame.light.x) - point.x * has_position, T(frame.light.y) - point.y * has_position,
                           T(frame.light.z) - point.z * has_position);
    const T facing = dot(normal, to_light), squared = dot(to_light, to_light);
    T rise(lift);
    if (frame.slope_lift > F(0)) {
        const T sine = sqrt(max(T(F(1)) - facing * facing / max(squared, T(F(1e-20))), zero));
        rise = rise + T(frame.slope_lift) * abs(row(frame.w, point)) * sine;
    }
    const vec3<T> p(point.x + normal.x * rise, point.y + normal.y * rise, point.z + normal.z * rise);
    const T w = row(frame.w, p), inverse_w = T(F(1)) / w, r(frame.radius);
    // Comparisons with NaN are false, so all texels of the filter lie in the map whatever the receiver is. The first
    // and the last of its places there are empty.
    const auto within = [&](T x, std::int32_t size) {
        const T last(F(size - shadow_taps));
        return select(x > zero, select(x < last, x, last), zero);
    };
    return {within(row(frame.x, p) * inverse_w - r, frame.width), within(row(frame.y, p) * inverse_w - r, frame.height),
            row(frame.q, p) * inverse_w, facing * abs(facing) < T(F(-0.0625)) * squared, !(w > T(frame.near))};
}

/// Share of [from, from + length] that lies in each of the texels [0, 1], [1, 2], …; from in [0, 1), length in [1, 3].
template <class T>
GSH_INLINE GSH_HD void filter_weights(T from, T length, T scale, T* weights) {
    const T to = from + length;
    for (int k = 0; k < shadow_taps; ++k)
        weights[k] = max(min(T(k + 1), to) - max(T(k), from), T(0)) * scale;
}

/// Visibility of a light from a point with the given unit normal, in [0, 1].
///
/// The share of a square of texels, 2 radius on a side, whose nearest surface is not nearer to the light than the point
/// is. A surface that faces away from the light by more than about 15 degrees does not see it.
template <class T>
[[nodiscard]] GSH_HD T shadow_visibility(const ShadowFrame<T>& frame, const T* maps, const vec3<T>& point,
                                         const vec3<T>& normal, T lift) {
    const ShadowPlace<T> place = place_receiver(frame, point, normal, lift);
    if (place.away) return T(0);
    if (place.unseen) return T(1);
    const auto column = static_cast<std::int32_t>(place.left), row = static_cast<std::int32_t>(place.top);
    const T length = 2 * frame.radius, scale = T(1) / length;
    T across[shadow_taps], down[shadow_taps], hidden[shadow_taps] = {};
    filter_weights(place.left - T(column), length, scale, across);
    filter_weights(place.top - T(row), length, scale, down);
    const T* texels = maps + frame.begin + static_cast<std::size_t>(row) * static_cast<std::size_t>(frame.stride) +
                      static_cast<std::size_t>(column);
    for (int j = 0; j < shadow_taps; ++j, texels += frame.stride)
        for (int k = 0; k < shadow_taps; ++k) hidden[k] += texels[k] > place.nearness ? down[j] : T(0);
    for (int k = 0; k < shadow_taps; ++k) hidden[k] *= across[k];
    return clamp(T(1) - ((hidden[0] + hidden[1]) + (hidden[2] + hidden[3])), T(0), T(1));
}

template <class T>
struct ReceiveShadows {
    Span<const ShadowFrame<T>> frames;        // [L]
    Span<const T> maps;
    Span<const vec3<T>> vertices, normals;    // [V]
    Span<T> visibility;                       // [V, L]
    T lift;
    GSH_HD void operator()(std::size_t v) const {
        const vec3<T> p = vertices[v], n = normals[v];
        T* const out = visibility.data() + v * frames.size();
        for (std::size_t l = 0; l < frames.size(); ++l) out[l] = shadow_visibility(frames[l], maps.data(), p, n, lift);
    }
};

} // namespace detail

/// Writes the visibility of each vertex from each light. This version needs no overload; a backend may have a faster
/// one with the same results.
template <Backend B, std::floating_point T>
void shadow_receive(B& backend, const detail::ReceiveShadows<T>& element) {
    backend.for_each(element.vertices.size(), element);
}

/// Private storage of a backend: projected vertices. Each backend specialises it beside its overloads.
template <Backend B, std::floating_point T>
struct ShadowMapScratch {
    static_assert(detail::overload_is_included<B>,
                  "ShadowMaps: include its backend's overloads, <gsh/light/cpu/shadow_map.hpp> or <gsh/cpu.hpp>");
};

/// Fallback without the backend's overloads: fails to compile, and names the header to include.
template <Backend B, class... Arguments>
void shadow_draw(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>,
                  "ShadowMaps: include its backend's overloads, <gsh/light/cpu/shadow_map.hpp> or <gsh/cpu.hpp>");
}

/// The soft visibility of surface vertices from each light, by one depth map per light.
///
/// A map covers all casters tightly: in perspective for a point light, orthographic for a direction. Its texels hold
/// the nearness of the nearest surface to the light. A vertex, lifted a little along its normal, sees the share of a
/// square around its place in the map that is not nearer to the light than itself.
///
/// Closed casters are drawn by the sides that face away from the light. A ray from a lit surface towards the light that
/// meets a closed mesh enters it through such a side first, so no shadow is missed, and a lit surface is not in the map
/// that it is compared with: it does not shadow itself, whatever the resolution. Casters that are not closed are drawn
/// by both sides; a receiver is then lifted by the width of the filter times the sine of the light's angle, which is
/// what a plane needs.
///
/// A caster nearer than 0.02 m to a point light, or seen by it more than 71 degrees from the middle of the casters,
/// casts no shadow from it. The result has no gradient: where it is used, visibility is a constant.
///
/// Shapes  visibility [V, P + D], a row per vertex, columns as in LightView.
/// Frame   casters, light and vertices in the world.
/// Source  Williams, "Casting Curved Shadows on Curved Surfaces", 1978; Reeves et al., "Rendering Antialiased Shadows
///         with Depth Maps", 1987; Wang and Molnar, "Second-Depth Shadow Mapping", 1994.
template <Backend B, std::floating_point T = float>
class ShadowMaps {
public:
    using Params = ShadowMapParams;
    using Caster = ShadowCaster<T>;
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    struct Cache {
        Buffer<ShadowFrame<T>> frames;          // [P + D]
        Buffer<T> maps;                         // nearness, one map after the other, in their largest size
        Buffer<detail::ShadowBox<T>> boxes;     // of pieces of the casters
        ShadowMapScratch<B, T> scratch;         // the backend's own
    };

    /// Errors  ValueError for a resolution that is not in [16, 1024], or a length that is negative or not finite.
    explicit ShadowMaps(B& backend, const Params& params = {}) : backend_(&backend), params_(params) {
        for (const int resolution : {params.point_resolution, params.direction_resolution})
            check_value(resolution >= 16 && resolution <= detail::largest_shadow_map, "ShadowMaps",
                        "a resolution is " + std::to_string(resolution) + ", expected 16 to " +
                            std::to_string(detail::largest_shadow_map) + " texels");
        for (const double metres : {params.point_softness, params.direction_softness, params.normal_offset})
            check_value(metres >= 0 && metres < 1e3, "ShadowMaps",
                        "a length is " + std::to_string(metres) + ", expected metres, not negative");
    }

    [[nodiscard]] const Params& params() const { return params_; }

    /// Draws the maps and writes visibility.
    ///
    /// Shapes  casters: a list on the host of meshes in the backend's memory; vertices, normals [V]; visibility
    ///         [V, P + D]. The light's intensities are not read.
    void forward(Span<const Caster> casters, const LightView<const T>& light, Span<const vec3<T>> vertices,
                 Span<const vec3<T>> normals, Span<T> visibility, Cache& cache) const {
        constexpr std::string_view where = "ShadowMaps::forward";
        const std::size_t V = vertices.size(), L = light.size();
        check_size(where, "normals", normals.size(), V, "store one per vertex");
        check_size(where, "visibility", visibility.size(), V * L, "store one per vertex and light");
        check_memory(*backend_, where, "light", light);
        check_memory(*backend_, where, "vertices", vertices);
        check_memory(*backend_, where, "normals", normals);
        check_memory(*backend_, where, "visibility", visibility);
        for (const Caster& caster : casters) {
            check_memory(*backend_, where, "caster", caster.vertices, "vertices");
            check_memory(*backend_, where, "caster", caster.triangles, "triangles");
        }
        draw(casters, light, cache);
        shadow_receive(*backend_, detail::ReceiveShadows<T>{cache.frames, cache.maps, vertices, normals, visibility,
                                                            T(params_.normal_offset)});
    }

private:
    void draw(Span<const Caster> casters, const LightView<const T>& light, Cache& cache) const {
        using namespace detail;
        std::size_t boxes = 0;
        for (const Caster& caster : casters) boxes += chunk_count(caster.vertices.size(), shadow_box_vertices);
        cache.boxes.resize(boxes);
        boxes = 0;
        for (const Caster& caster : casters) {
            const std::size_t count = chunk_count(caster.vertices.size(), shadow_box_vertices);
            backend_->for_each(count, BoundShadowCasters<T>{caster.vertices,
                                                            Span<ShadowBox<T>>(cache.boxes).subspan(boxes, count)});
            boxes += count;
        }

        const std::size_t L = light.size();
        cache.frames.resize(L);
        const AimShadowMaps<T> aim{light.points,
                                   light.directions,
                                   cache.boxes,
                                   cache.frames,
                                   {params_.point_resolution, params_.direction_resolution},
                                   {T(params_.point_softness), T(params_.direction_softness)},
                                   params_.closed};
        cache.maps.resize(aim.begin_of(L));
        backend_->for_each(L, aim);
        bool first = true;
        for (const Caster& caster : casters) {
            shadow_draw(*backend_, Span<const ShadowFrame<T>>(cache.frames), caster, params_.closed, first,
                        Span<T>(cache.maps), cache.scratch);
            first = false;
        }
        if (first) backend_->fill(Span<T>(cache.maps), shadow_empty<T>);
    }

    B* backend_;
    Params params_;
};

} // namespace gsh
