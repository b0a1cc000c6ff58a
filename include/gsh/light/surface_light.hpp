// SPDX-License-Identifier: Apache-2.0
/// @file  Light on a posed body: its mesh gives normals and casts shadows, and its Gaussians are shaded by both.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/posed_surface.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// Settings of SurfaceLight.
struct SurfaceLightParams {
    bool shadows = true; ///< if false, every light reaches every vertex, and only where the surface faces counts
    double caster_spacing = default_caster_spacing; ///< metres between vertices that cast shadows
    ShadowMapParams maps = {};
    ColorClamp clamping = ColorClamp::both; ///< of lit colours
};

/// The surface of a body in a pose, as SurfaceLight reads it. All are arrays of the backend.
///
/// Shapes  bones [J]; offsets [V] as in PosedSurface; normal_offsets [V] as in PosedSurface::offset_normals, or empty
///         for the normals of the mesh.
template <class T>
struct LitSurface {
    Span<const Affine<T>> bones;
    Span<const vec3<T>> offsets;
    Span<const vec3<T>> normal_offsets = {};
};

/// Shades the Gaussians of a body from its posed mesh, which gives the direction that the surface faces, and what this
/// body and others hide from each light.
///
///     vertices, normals = PosedSurface(bones, offsets), with normal_offsets added for shading if there are any
///     visibility        = ShadowMaps(CoarseCaster of the own mesh, and of others; light)
///     colors            = LitSplats(base colours, vertices, normals, visibility, light)
///
/// Shapes  N Gaussians on the triangles of a mesh with V vertices; J bones.
/// Frame   bones lead from canonical space to the world; center and light are in the world.
template <Backend B, std::floating_point T = float>
class SurfaceLight {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    struct Cache {
        typename PosedSurface<B, T>::Cache surface;
        Buffer<vec3<T>> offset_normals;         // [V], or empty without normal_offsets
        Buffer<T> visibility;                   // [V, P + D]
        Buffer<vec3<T>> base;                   // [N] colours without light, which the caller writes
        Buffer<vec3<T>> dL_dbase;               // [N], the result of backward
        // working storage
        Buffer<vec3<T>> dL_dvertices, dL_dnormals; // [V]
        typename CoarseCaster<B, T>::Cache caster;
        typename ShadowMaps<B, T>::Cache maps;
        typename LitSplats<B, T>::Cache lit;
    };

    /// Where backward adds. Each may be empty; it is then not computed.
    struct Gradient {
        LightView<T> light = {};
        Span<Affine<T>> bones = {};   // [J]
        Span<vec3<T>> offsets = {};   // [V]
        Span<vec3<T>> normal_offsets = {}; // [V]
        Span<vec3<T>> center = {};    // [1]
    };

    /// `triangles` and `barycentric` [N] say where each Gaussian is attached to the body.
    /// Errors  ValueError for a body without triangles; ShapeError as for the parts.
    SurfaceLight(B& backend, const BodyModel& body, Span<const double> betas,
                 Span<const std::array<int, 3>> triangles, Span<const vec3<double>> barycentric,
                 const SurfaceLightParams& params = {})
        : backend_(&backend), shadows_(params.shadows), surface_(checked(backend, body, betas)),
          caster_(backend, shaped_vertices(body, betas), body.faces, params.caster_spacing),
          maps_(backend, params.maps), lit_(backend, body.vertex_count(), triangles, barycentric, params.clamping) {}

    /// From now on, shadows are computed or not.
    void set_shadows(bool shadows) { shadows_ = shadows; }

    /// The coarse mesh in a pose, which casts shadows. It is valid until the next call with this cache.
    ShadowCaster<T> caster(const LitSurface<T>& posed, Cache& cache) const {
        surface_.forward(posed.bones, posed.offsets, cache.surface);
        return caster_.forward(cache.surface.vertices, cache.caster);
    }

    /// Writes lit colours. The caller has written cache.base, the colours without light; it stays for backward.
    ///
    /// Shapes  cache.base, colors [N]; `others` casts shadows on this body.
    void forward(const LitSurface<T>& posed, const LightView<const T>& light, Span<const ShadowCaster<T>> others,
                 const Deferred<vec3<T>>& center, Span<vec3<T>> colors, Cache& cache) const {
        surface_.forward(posed.bones, posed.offsets, cache.surface);
        cache.offset_normals.resize(posed.normal_offsets.size());
        if (!posed.normal_offsets.empty())
            surface_.offset_normals(posed.bones, posed.normal_offsets, cache.surface, cache.offset_normals);
        cache.visibility.resize(surface_.vertex_count() * light.size());
        if (shadows_) {
            std::vector<ShadowCaster<T>> casters{caster_.forward(cache.surface.vertices, cache.caster)};
            casters.insert(casters.end(), others.begin(), others.end());
            maps_.forward(casters, light, cache.surface.vertices, cache.surface.normals, cache.visibility, cache.maps);
        } else {
            backend_->fill(Span<T>(cache.visibility), T(1));
        }
        lit_.forward(input(light, center, cache), colors, cache.lit);
    }

    /// Irradiance and gloss of each Gaussian in the last forward, [N].
    [[nodiscard]] Span<const LitShading<T>> shading(Cache& cache) const { return lit_.interpolate(cache.lit); }

    /// Adjoint of forward, but for visibility, which counts as constant. Writes cache.dL_dbase and adds to dL_din.
    void backward(const LitSurface<T>& posed, const LightView<const T>& light, const Deferred<vec3<T>>& center,
                  Span<const vec3<T>> dL_dcolors, Cache& cache, const Gradient& dL_din) const {
        const bool surface_moves = !dL_din.bones.empty() || !dL_din.offsets.empty();
        const bool normals_count = surface_moves || !dL_din.normal_offsets.empty();
        cache.dL_dbase.resize(dL_dcolors.size());
        cache.dL_dvertices.resize(surface_moves ? surface_.vertex_count() : 0);
        cache.dL_dnormals.resize(normals_count ? surface_.vertex_count() : 0);
        for (auto* gradient : {&cache.dL_dbase, &cache.dL_dvertices, &cache.dL_dnormals})
            backend_->fill(Span<vec3<T>>(*gradient), vec3<T>(T(0)));
        lit_.backward(input(light, center, cache), dL_dcolors, cache.lit,
                      {.light = dL_din.light,
                       .vertices = cache.dL_dvertices,
                       .normals = cache.dL_dnormals,
                       .base = cache.dL_dbase,
                       .center = dL_din.center});
        if (normals_count && !posed.normal_offsets.empty())
            surface_.offset_normals_backward(posed.bones, posed.normal_offsets, cache.dL_dnormals, cache.surface,
                                             dL_din.bones, dL_din.normal_offsets);
        if (surface_moves)
            surface_.backward(posed.bones, posed.offsets, cache.dL_dvertices, cache.dL_dnormals, cache.surface,
                              dL_din.bones, dL_din.offsets);
    }

private:
    [[nodiscard]] static PosedSurface<B, T> checked(B& backend, const BodyModel& body, Span<const double> betas) {
        check_value(!body.faces.empty(), "SurfaceLight",
                    "the body has no triangles; light needs a mesh, so use shadows over time or pose, or none");
        return PosedSurface<B, T>(backend, body, betas);
    }
    [[nodiscard]] typename LitSplats<B, T>::Input input(const LightView<const T>& light,
                                                        const Deferred<vec3<T>>& center, const Cache& cache) const {
        const Span<const vec3<T>> normals = cache.offset_normals.size() ? Span<const vec3<T>>(cache.offset_normals)
                                                                        : Span<const vec3<T>>(cache.surface.normals);
        return {light, cache.surface.vertices, normals, cache.visibility, cache.base, center};
    }

    B* backend_;
    bool shadows_;
    PosedSurface<B, T> surface_;
    CoarseCaster<B, T> caster_;
    ShadowMaps<B, T> maps_;
    LitSplats<B, T> lit_;
};

} // namespace gsh
