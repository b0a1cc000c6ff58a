// SPDX-License-Identifier: Apache-2.0
/// @file  A test backend with its own memory. Code that assumes host memory crashes on it or is refused.
///
/// It computes what cpu::Serial computes, in the same order, so results are bit-identical. Its buffers cannot be
/// accessed outside its own work. Code that runs on it therefore also handles a device's memory correctly.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/cpu.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/mlp.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/render/raster_cache.hpp>

#include "support/guarded_memory.hpp"

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace gsh::test {

/// The backend while its guard is open. Only then can its buffers be accessed, and the CPU's overloads may run on them.
struct GuardedInside : cpu::Serial {
    template <class T>
    using Buffer = GuardedBuffer<T>;
};
static_assert(CpuBackend<GuardedInside>);

/// A backend on which host code cannot read or write a buffer.
///
/// Errors  MemoryError for host memory where the backend's is required, in its own functions and in function objects.
///         Access to a buffer outside its work is a crash with a stack trace.
class Guarded {
public:
    template <class T>
    using Buffer = GuardedBuffer<T>;
    static constexpr bool host_memory = false;

    Guarded() { GuardedMemory::instance().watch(); }

    [[nodiscard]] static constexpr std::string_view name() { return "guarded"; }
    [[nodiscard]] static bool available() { return true; }
    [[nodiscard]] bool owns(const void* memory, std::size_t bytes) const {
        return GuardedMemory::instance().owns(memory, bytes);
    }

    template <class Body>
    void for_each(std::size_t n, const Body& body) {
        check_pointers("Guarded::for_each", body);
        run([&](GuardedInside& inside) { inside.for_each(n, body); });
    }
    template <class T>
    void fill(Span<T> values, std::type_identity_t<T> value) {
        check_memory(*this, "Guarded::fill", "values", values);
        run([&](GuardedInside& inside) { inside.fill(values, value); });
    }
    template <class T>
    void copy(Span<const T> from, Span<std::type_identity_t<T>> to) {
        check_memory(*this, "Guarded::copy", "from", from);
        check_memory(*this, "Guarded::copy", "to", to);
        run([&](GuardedInside& inside) { inside.copy(from, to); });
    }
    template <class T>
    void upload(Span<const T> from, Span<std::type_identity_t<T>> to) {
        check_host("Guarded::upload", "from", from);
        check_memory(*this, "Guarded::upload", "to", to);
        run([&](GuardedInside& inside) { inside.copy(from, to); });
    }
    template <class T>
    void download(Span<const T> from, Span<std::type_identity_t<T>> to) {
        check_memory(*this, "Guarded::download", "from", from);
        check_host("Guarded::download", "to", Span<const T>(to));
        run([&](GuardedInside& inside) { inside.copy(from, to); });
    }
    void synchronize() {}

    /// Calls work(inside) with the guard open.
    template <class Work>
    static auto run(const Work& work) {
        const OpenGuard guard;
        GuardedInside inside;
        return work(inside);
    }

    /// Refuses an argument that contains the address of host memory.
    template <class T>
    static void check_pointers(std::string_view where, const T& argument) {
        if (const std::string found = host_address_in(argument); !found.empty())
            throw MemoryError(std::string(where) + ": " + found + "; upload it into a Buffer of the backend first");
    }

private:
    template <class T>
    void check_host(std::string_view where, std::string_view argument, Span<const T> memory) const {
        if (!memory.empty() && owns(memory.data(), 1))
            throw MemoryError(std::string(where).append(": ").append(argument).append(
                " is memory of the backend, expected the host's; copy stays within the backend"));
    }
};
static_assert(Backend<Guarded> && !CpuBackend<Guarded>);

} // namespace gsh::test

// Caches and scratch of the guarded backend are also those of the backend inside, which the CPU's overloads require.
namespace gsh {

template <std::floating_point T>
struct RasterCache<test::Guarded, T> : RasterCache<test::GuardedInside, T> {};
template <std::floating_point T>
struct PhotometricCache<test::Guarded, T> : PhotometricCache<test::GuardedInside, T> {};
template <std::floating_point T>
struct LpipsWeights<test::Guarded, T> : LpipsWeights<test::GuardedInside, T> {};
template <std::floating_point T>
struct LpipsFeatures<test::Guarded, T> : LpipsFeatures<test::GuardedInside, T> {};
template <std::floating_point T>
struct HashScratch<test::Guarded, T> : HashScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct MlpScratch<test::Guarded, T> : MlpScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct SkinnedSplatsScratch<test::Guarded, T> : SkinnedSplatsScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct OcclusionFieldScratch<test::Guarded, T> : OcclusionFieldScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct LitSplatsScratch<test::Guarded, T> : LitSplatsScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct BlendShapesScratch<test::Guarded, T> : BlendShapesScratch<test::GuardedInside, T> {};
template <std::floating_point T>
struct ShadowMapScratch<test::Guarded, T> : ShadowMapScratch<test::GuardedInside, T> {};

} // namespace gsh

// The overloads call those of the CPU with the guard open.
namespace gsh::test {

/// Converts a cache to its base class. Other arguments are unchanged.
template <class T>
T& as_inside(T& argument) {
    return argument;
}
template <template <Backend, std::floating_point> class Cache, class T>
    requires std::derived_from<Cache<Guarded, T>, Cache<GuardedInside, T>>
Cache<GuardedInside, T>& as_inside(Cache<Guarded, T>& cache) {
    return cache;
}
template <template <Backend, std::floating_point> class Cache, class T>
    requires std::derived_from<Cache<Guarded, T>, Cache<GuardedInside, T>>
const Cache<GuardedInside, T>& as_inside(const Cache<Guarded, T>& cache) {
    return cache;
}

/// Calls the CPU's overload with these arguments and the guard open.
#define GSH_GUARDED_OVERLOAD(function, ...)                                                                            \
    [](auto&... arguments) {                                                                                           \
        (Guarded::check_pointers(#function, arguments), ...);                                                          \
        return Guarded::run([&](GuardedInside& inside) { return cpu::function(inside, as_inside(arguments)...); });    \
    }(__VA_ARGS__)

template <class C, class S, class Bg, class P, class Target, class Cache>
void composite_forward(Guarded&, const C& camera, const S& splats, const Bg& background, const P& params,
                       const Target& target, Cache& cache) {
    GSH_GUARDED_OVERLOAD(composite_forward, camera, splats, background, params, target, cache);
}
template <class C, class S, class Bg, class P, class G, class Cache, class D, class DC, class DB>
void composite_backward(Guarded&, const C& camera, const S& splats, const Bg& background, const P& params,
                        const G& dL_dtarget, Cache& cache, const D& dL_dsplats, const DC& dL_dcamera,
                        const DB& dL_dbackground) {
    GSH_GUARDED_OVERLOAD(composite_backward, camera, splats, background, params, dL_dtarget, cache, dL_dsplats,
                         dL_dcamera, dL_dbackground);
}
template <class R, class P, class Cache>
void photometric_forward(Guarded&, const R& render, const R& truth, const P& params, Cache& cache) {
    GSH_GUARDED_OVERLOAD(photometric_forward, render, truth, params, cache);
}
template <class R, class T, class P, class Cache, class D>
void photometric_backward(Guarded&, const R& render, const R& truth, const T& dL_dloss, const P& params, Cache& cache,
                          const D& dL_drender) {
    GSH_GUARDED_OVERLOAD(photometric_backward, render, truth, dL_dloss, params, cache, dL_drender);
}
template <class N, class I, class S, class F>
void lpips_forward(Guarded&, const N& network, const I& image, const S& scaling, F& features) {
    GSH_GUARDED_OVERLOAD(lpips_forward, network, image, scaling, features);
}
template <class N, class F>
double lpips_distance(Guarded&, const N& network, const F& a, const F& b) {
    return GSH_GUARDED_OVERLOAD(lpips_distance, network, a, b);
}
template <int Degree, class T>
void static_splats_forward(Guarded&, const gsh::detail::StaticSplatForward<Degree, T>& element) {
    GSH_GUARDED_OVERLOAD(static_splats_forward, element);
}
template <int Degree, class T>
void static_splats_backward(Guarded&, const gsh::detail::StaticSplatBackward<Degree, T>& element) {
    GSH_GUARDED_OVERLOAD(static_splats_backward, element);
}
template <int Degree, class T, class D>
void skinned_splats_pose(Guarded&, const gsh::detail::SkinnedSplatForward<Degree, T, D>& element) {
    GSH_GUARDED_OVERLOAD(skinned_splats_pose, element);
}
template <class Element, class Bones, class Center, class Scratch>
void skinned_splats_accumulate(Guarded&, const Element& element, const Bones& dL_dbones, const Center& dL_dcenter,
                               Scratch& scratch) {
    GSH_GUARDED_OVERLOAD(skinned_splats_accumulate, element, dL_dbones, dL_dcenter, scratch);
}
template <class T>
void lit_vertices_shade(Guarded&, const gsh::detail::LitVertexForward<T>& element) {
    GSH_GUARDED_OVERLOAD(lit_vertices_shade, element);
}
template <class T>
void lit_splats_color(Guarded&, const gsh::detail::LitColorForward<T>& element) {
    GSH_GUARDED_OVERLOAD(lit_splats_color, element);
}
template <class T>
void lit_splats_color_backward(Guarded&, const gsh::detail::LitColorBackward<T>& element) {
    GSH_GUARDED_OVERLOAD(lit_splats_color_backward, element);
}
template <class Element, class Light, class Center, class Scratch>
void lit_vertices_accumulate(Guarded&, const Element& element, const Light& dL_dlight, const Center& dL_dcenter,
                             Scratch& scratch) {
    GSH_GUARDED_OVERLOAD(lit_vertices_accumulate, element, dL_dlight, dL_dcenter, scratch);
}
template <class Network, class W, class L, class Cache>
void occlusion_forward(Guarded&, const Network& network, const W& weights, const W& neurons, const W& pose,
                       const L& logits, Cache& cache) {
    GSH_GUARDED_OVERLOAD(occlusion_forward, network, weights, neurons, pose, logits, cache);
}
template <class Network, class W, class Cache, class D>
void occlusion_backward(Guarded&, const Network& network, const W& weights, const W& neurons, const W& pose,
                        const W& dL_dlogits, Cache& cache, const D& dL_dpose) {
    GSH_GUARDED_OVERLOAD(occlusion_backward, network, weights, neurons, pose, dL_dlogits, cache, dL_dpose);
}
template <class Grid, class P, class W, class Query>
void hash_prepare(Guarded&, const Grid& grid, const P& points, const W& weights, Query& query) {
    GSH_GUARDED_OVERLOAD(hash_prepare, grid, points, weights, query);
}
template <class Grid, class T, class Query, class F>
void hash_forward(Guarded&, const Grid& grid, const T& table, const Query& query, const F& features, Write mode) {
    GSH_GUARDED_OVERLOAD(hash_forward, grid, table, query, features, mode);
}
template <class Grid, class F, class Query, class T>
void hash_backward(Guarded&, const Grid& grid, const F& dL_dfeatures, const Query& query, const T& dL_dtable) {
    GSH_GUARDED_OVERLOAD(hash_backward, grid, dL_dfeatures, query, dL_dtable);
}
template <class Network, class W, class I, class O, class Cache>
void mlp_forward(Guarded&, const Network& network, const W& weights, const I& inputs, const O& outputs, Cache& cache) {
    GSH_GUARDED_OVERLOAD(mlp_forward, network, weights, inputs, outputs, cache);
}
template <class Network, class W, class I, class Cache, class D, class F>
void mlp_backward(Guarded&, const Network& network, const W& weights, const I& inputs, const W& dL_doutputs,
                  Cache& cache, const D& dL_dweights, const F& dL_dfeatures, Write features_mode, const D& dL_dshared) {
    GSH_GUARDED_OVERLOAD(mlp_backward, network, weights, inputs, dL_doutputs, cache, dL_dweights, dL_dfeatures,
                         features_mode, dL_dshared);
}
template <class Step>
void adam_step(Guarded&, const Step& step, std::size_t count) {
    GSH_GUARDED_OVERLOAD(adam_step, step, count);
}
template <class Step, class Rows>
void adam_step_rows(Guarded&, const Step& step, const Rows& rows, std::size_t width) {
    GSH_GUARDED_OVERLOAD(adam_step_rows, step, rows, width);
}
template <class Step>
void adam_step_columns(Guarded&, const Step& first_step, const Step& other_step, std::size_t rows, std::size_t width,
                       std::size_t first) {
    GSH_GUARDED_OVERLOAD(adam_step_columns, first_step, other_step, rows, width, first);
}
template <class D, class C, class O>
void blend_shapes_forward(Guarded&, const D& directions, const C& coefficients, const O& offsets) {
    GSH_GUARDED_OVERLOAD(blend_shapes_forward, directions, coefficients, offsets);
}
template <class D, class C, class Scratch>
void blend_shapes_backward(Guarded&, const D& directions, const D& dL_doffsets, const C& dL_dcoefficients,
                           Scratch& scratch) {
    GSH_GUARDED_OVERLOAD(blend_shapes_backward, directions, dL_doffsets, dL_dcoefficients, scratch);
}
template <class F, class C, class M, class Scratch>
void shadow_draw(Guarded&, const F& frames, const C& caster, bool closed, bool clear, const M& maps, Scratch& scratch) {
    GSH_GUARDED_OVERLOAD(shadow_draw, frames, caster, closed, clear, maps, scratch);
}
template <class V, class R, class Scratch>
void add_sum(Guarded&, const V& values, const R& result, Scratch& scratch) {
    GSH_GUARDED_OVERLOAD(add_sum, values, result, scratch);
}

#undef GSH_GUARDED_OVERLOAD

} // namespace gsh::test
