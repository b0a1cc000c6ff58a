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
#include <gsh/light/shadow_frame.hpp>
#include <gsh/light/shadow_triangle.hpp>
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

namespace detail {

/// The place of a receiver in a map.
template <class T>
struct ShadowPlace {
    T left, top;          ///< texels: the first corner of the filter's square
    T nearness;
    MaskOf<T> away;       ///< it faces away from the light
    MaskOf<T> unseen;     ///< it lies behind the light, or too near
};

/// A point with the given unit normal, lifted by `lift` and by the frame's slope_lift. T is a number or a lane.
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

/// Writes the bounds of pieces of a caster. This version and the next two need no overload; a backend may have faster
/// ones with the same results.
template <Backend B, std::floating_point T>
void shadow_bound(B& backend, const detail::BoundShadowCasters<T>& element) {
    backend.for_each(element.boxes.size(), element);
}
/// Aims the map of each light.
template <Backend B, std::floating_point T>
void shadow_aim(B& backend, const detail::AimShadowMaps<T>& element) {
    backend.for_each(element.frames.size(), element);
}
/// Writes the visibility of each vertex from each light.
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
                        "a length is " + detail::number_text(metres) + ", expected metres, not negative");
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
            shadow_bound(*backend_, BoundShadowCasters<T>{caster.vertices,
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
        shadow_aim(*backend_, aim);
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
