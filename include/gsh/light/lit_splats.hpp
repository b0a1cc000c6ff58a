// SPDX-License-Identifier: Apache-2.0
/// @file  Colours of posed Gaussians under a light, from normals and visibilities of the vertices of the body's mesh.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/lit_element.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string_view>

namespace gsh {

/// What LitSplats reads. The camera's centre is a value, all else is memory of the backend.
///
/// Shapes  N Gaussians, V vertices, P points and D directions of the light: vertices, normals [V]; visibility
///         [V, P + D]; base [N].
/// Frame   the world, with the body posed.
/// Units   vertices in metres; normals of any length; visibility the share of each light that reaches the vertex, 0 to
///         1; base display-referred sRGB without light, not negative.
template <class T>
struct LitSplatsInput {
    LightView<const T> light = {};
    Span<const vec3<T>> vertices = {};
    Span<const vec3<T>> normals = {};
    Span<const T> visibility = {};
    Span<const vec3<T>> base = {};
    Deferred<vec3<T>> center = {};
};

/// Gradients with respect to a LitSplatsInput. Each may be empty; it is then not computed. Visibility has none.
///
/// Shapes  as the input; center [1].
template <class T>
struct LitSplatsGradient {
    LightView<T> light = {};
    Span<vec3<T>> vertices = {};
    Span<vec3<T>> normals = {};
    Span<vec3<T>> base = {};
    Span<vec3<T>> center = {};
};

/// Private storage of a backend in backward, for instance partial sums of the light's gradient. Each backend
/// specialises it beside its overloads.
template <Backend B, std::floating_point T>
struct LitSplatsScratch {
    static_assert(detail::overload_is_included<B>, "LitSplats: include its backend's overloads, "
                                                   "<gsh/light/cpu/lit_splats.hpp> or <gsh/cpu.hpp>");
};

/// Results of forward that backward reads, and working storage, kept from step to step.
template <Backend B, std::floating_point T = float>
struct LitSplatsCache {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    Buffer<LitShading<T>> shading;           // [V]
    Buffer<LitShading<T>> point_shading;     // [N], written by interpolate
    Buffer<T> factors;                       // [P + D + 2] of LitLight
    Buffer<LitShading<T>> dL_dpoint_shading; // [N]
    Buffer<LitShading<T>> dL_dshading;       // [V]
    LitSplatsScratch<B, T> scratch;          // the backend's own
};

namespace detail {

/// Intensities, then strength and sharpness of the gloss, or 0 for none.
template <class T>
struct LitFactors {
    Span<const T> log_intensities, gloss;
    Span<T> factors;
    GSH_HD void operator()(std::size_t k) const {
        const std::size_t lights = log_intensities.size();
        if (k < lights) factors[k] = exp(log_intensities[k]);
        else factors[k] = gloss.empty() ? T(0) : exp(gloss[k - lights]);
    }
};

/// The vertices of a surface under a light.
template <class T>
struct LitVertices {
    LitLight<T> light;
    Span<const vec3<T>> vertices, normals;
    Span<const T> visibility; // [V, P + D]
    Deferred<vec3<T>> center;

    [[nodiscard]] GSH_HD LitPoint::Input<T> operator[](std::size_t v) const {
        return {vertices[v], normals[v], center()};
    }
    /// V_k of a vertex.
    [[nodiscard]] GSH_HD auto visibility_of(std::size_t v) const {
        return [row = visibility.data() + v * light.size()](std::size_t k) { return row[k]; };
    }
};

template <class T>
struct LitVertexForward {
    LitVertices<T> surface;
    Span<LitShading<T>> shading; // [V]

    GSH_HD void operator()(std::size_t v) const {
        shading[v] = LitPoint::forward(surface.light, surface[v], surface.visibility_of(v));
    }
};

/// The adjoint of a vertex: writes its own gradients, and adds to sums and a centre that the caller provides.
template <class T>
struct LitVertexBackward {
    LitVertices<T> surface;
    Span<const LitShading<T>> shading, dL_dshading; // [V]
    Span<vec3<T>> dL_dvertices, dL_dnormals;        // [V] or empty; adds

    GSH_HD void operator()(std::size_t v, const LitLightSums<T>& sums, vec3<T>& dL_dcenter) const {
        if (unseen(v)) return;
        const LitPoint::Gradient<T> gradient = adjoint(v, dL_dshading[v], sums);
        add(v, gradient);
        dL_dcenter += gradient.center;
    }

    [[nodiscard]] GSH_HD LitPoint::Gradient<T> adjoint(std::size_t v, const LitShading<T>& dL_dout,
                                                       const auto& sums) const {
        LitPoint::Gradient<T> gradient;
        LitPoint::backward(surface.light, surface[v], surface.visibility_of(v), shading[v], dL_dout, gradient, sums);
        return gradient;
    }
    /// Adds to the vertex's own attributes.
    GSH_HD void add(std::size_t v, const LitPoint::Gradient<T>& gradient) const {
        if (!dL_dvertices.empty()) dL_dvertices[v] += gradient.position;
        if (!dL_dnormals.empty()) dL_dnormals[v] += gradient.normal;
    }

    /// True if the shading has no gradient. The adjoint is linear, so such a vertex contributes nothing.
    [[nodiscard]] GSH_HD bool unseen(std::size_t v) const {
        return dL_dshading[v].x == T(0) && dL_dshading[v].y == T(0);
    }
};

/// Gaussians on a surface whose vertices are shaded.
template <class T>
struct LitColors {
    Span<const Contribution<T>> corners;  // [N, 3]
    Span<const LitShading<T>> shading;    // [V]
    Span<const vec3<T>> base;             // [N]
    ColorClamp clamping;

    /// Interpolated at the Gaussian's foot.
    [[nodiscard]] GSH_HD LitShading<T> shading_of(std::size_t i) const {
        const Contribution<T>* corner = corners.data() + 3 * i;
        return shading[corner[0].index] * corner[0].weight + shading[corner[1].index] * corner[1].weight +
               shading[corner[2].index] * corner[2].weight;
    }
};

template <class T>
struct LitColorForward {
    LitColors<T> splats;
    Span<vec3<T>> colors; // [N]; may be the memory of splats.base

    GSH_HD void operator()(std::size_t i) const {
        colors[i] = LitColor::forward(splats.base[i], splats.shading_of(i), splats.clamping);
    }
};

template <class T>
struct LitColorBackward {
    LitColors<T> splats;
    Span<const vec3<T>> dL_dcolors;      // [N]
    Span<LitShading<T>> dL_dshading;     // [N], overwritten
    Span<vec3<T>> dL_dbase;              // [N] or empty; adds

    GSH_HD void operator()(std::size_t i) const {
        LitShading<T> of_shading(T(0));
        vec3<T> of_base(T(0));
        if (!unseen(i))
            LitColor::backward(splats.base[i], splats.shading_of(i), dL_dcolors[i], splats.clamping, of_base,
                               of_shading);
        dL_dshading[i] = of_shading;
        if (!dL_dbase.empty()) dL_dbase[i] += of_base;
    }

    /// True if the colour has no gradient.
    [[nodiscard]] GSH_HD bool unseen(std::size_t i) const {
        return dL_dcolors[i].x == T(0) && dL_dcolors[i].y == T(0) && dL_dcolors[i].z == T(0);
    }
};

} // namespace detail

/// Fallbacks for backends without overloads: each index is one vertex, or one Gaussian.
template <Backend B, class T>
void lit_vertices_shade(B& backend, const detail::LitVertexForward<T>& element) {
    static_assert(!CpuBackend<B>, "LitSplats: include its backend's overloads, "
                                  "<gsh/light/cpu/lit_splats.hpp> or <gsh/cpu.hpp>");
    backend.for_each(element.shading.size(), element);
}
template <Backend B, class T>
void lit_splats_color(B& backend, const detail::LitColorForward<T>& element) {
    backend.for_each(element.colors.size(), element);
}
template <Backend B, class T>
void lit_splats_color_backward(B& backend, const detail::LitColorBackward<T>& element) {
    backend.for_each(element.dL_dcolors.size(), element);
}

/// Fallback without the backend's overloads, which the sums over vertices require: fails to compile, and names the
/// header to include.
template <Backend B, class... Arguments>
void lit_vertices_accumulate(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>, "LitSplats: include its backend's overloads, "
                                                   "<gsh/light/cpu/lit_splats.hpp> or <gsh/cpu.hpp>");
}

/// Colours of N Gaussians under a light. LitPoint gives irradiance and gloss at the vertices of the body's mesh. They
/// are interpolated at the foot of each Gaussian, in the triangle on which it stands, where LitColor takes the colour.
/// A body has a tenth as many vertices as Gaussians, and light changes little between two of them.
///
/// Only the product of base colours and intensities is observable, up to the gloss. Code that learns both fixes one
/// number of the scale; the gradient here is the full one, whatever the caller fixes.
///
/// Errors  ShapeError, MemoryError before any work starts.
template <Backend B, std::floating_point T = float>
class LitSplats {
public:
    using Input = LitSplatsInput<T>;
    using Gradient = LitSplatsGradient<T>;
    using Cache = LitSplatsCache<B, T>;

    /// Shapes  triangles [N] vertex indices, barycentric [N], of the mesh's V vertices.
    /// Errors  ShapeError if they differ in size, ValueError for a vertex index out of range.
    LitSplats(B& backend, std::size_t vertex_count, Span<const std::array<int, 3>> triangles,
              Span<const vec3<double>> barycentric, ColorClamp clamping = ColorClamp::below)
        : backend_(&backend), clamping_(clamping), surface_(backend, vertex_count, triangles, barycentric) {}

    [[nodiscard]] std::size_t vertex_count() const { return surface_.vertex_count(); }
    [[nodiscard]] std::size_t size() const { return surface_.point_count(); }

    /// Overwrites colors [N]. They may be the memory of in.base if backward is not called, since it reads the base.
    void forward(const Input& in, Span<vec3<T>> colors, Cache& cache) const {
        constexpr auto where = "LitSplats::forward";
        check_input(where, in);
        check_size(where, "colors", colors.size(), size(), "one per Gaussian");
        check_memory(*backend_, where, "colors", colors);
        cache.shading.resize(vertex_count());
        cache.factors.resize(in.light.size() + 2);
        backend_->for_each(cache.factors.size(),
                           detail::LitFactors<T>{in.light.log_intensities, in.light.gloss, cache.factors});
        lit_vertices_shade(*backend_, detail::LitVertexForward<T>{vertices(in, cache), cache.shading});
        lit_splats_color(*backend_, detail::LitColorForward<T>{splats(in, cache), colors});
    }

    /// The shading of each Gaussian in the last forward, [N].
    [[nodiscard]] Span<const LitShading<T>> interpolate(Cache& cache) const {
        check_size("LitSplats::interpolate", "cache.shading", cache.shading.size(), vertex_count(),
                   "forward must come first");
        cache.point_shading.resize(size());
        backend_->fill(Span<LitShading<T>>(cache.point_shading), LitShading<T>(T(0)));
        surface_.template forward<LitShading<T>>(cache.shading, cache.point_shading);
        return cache.point_shading;
    }

    /// Adjoint of the last forward with this cache and the same input: adds to the non-empty attributes of dL_din.
    void backward(const Input& in, Span<const vec3<T>> dL_dcolors, Cache& cache, const Gradient& dL_din) const {
        constexpr auto where = "LitSplats::backward";
        check_input(where, in);
        check_size(where, "dL_dcolors", dL_dcolors.size(), size(), "one per Gaussian");
        check_size(where, "cache.shading", cache.shading.size(), vertex_count(), "forward must come first");
        check_size(where, "cache.factors", cache.factors.size(), in.light.size() + 2, "forward must come first");
        const auto check = [&](const char* name, std::size_t found, std::size_t expected) {
            if (found != 0) check_size(where, name, found, expected, "or none");
        };
        check("dL_din.light.points", dL_din.light.points.size(), in.light.points.size());
        check("dL_din.light.log_intensities", dL_din.light.log_intensities.size(), in.light.size());
        check("dL_din.light.gloss", dL_din.light.gloss.size(), in.light.gloss.size());
        check("dL_din.vertices", dL_din.vertices.size(), vertex_count());
        check("dL_din.normals", dL_din.normals.size(), vertex_count());
        check("dL_din.base", dL_din.base.size(), size());
        check("dL_din.center", dL_din.center.size(), 1);
        check_memory(*backend_, where, "dL_dcolors", dL_dcolors);
        check_memory(*backend_, where, "dL_din.light", dL_din.light);
        check_memory(*backend_, where, "dL_din", dL_din.vertices, "vertices");
        check_memory(*backend_, where, "dL_din", dL_din.normals, "normals");
        check_memory(*backend_, where, "dL_din", dL_din.base, "base");
        check_memory(*backend_, where, "dL_din", dL_din.center, "center");

        cache.dL_dpoint_shading.resize(size());
        lit_splats_color_backward(*backend_, detail::LitColorBackward<T>{splats(in, cache), dL_dcolors,
                                                                         cache.dL_dpoint_shading, dL_din.base});
        cache.dL_dshading.resize(vertex_count());
        backend_->fill(Span<LitShading<T>>(cache.dL_dshading), LitShading<T>(T(0)));
        surface_.template backward<LitShading<T>>(cache.dL_dpoint_shading, cache.dL_dshading);
        lit_vertices_accumulate(*backend_,
                                detail::LitVertexBackward<T>{vertices(in, cache), cache.shading, cache.dL_dshading,
                                                             dL_din.vertices, dL_din.normals},
                                dL_din.light, dL_din.center, cache.scratch);
    }

private:
    void check_input(std::string_view where, const Input& in) const {
        check_light(where, in.light);
        check_size(where, "vertices", in.vertices.size(), vertex_count(), "one per vertex");
        check_size(where, "normals", in.normals.size(), vertex_count(), "one per vertex");
        check_size(where, "visibility", in.visibility.size(), vertex_count() * in.light.size(),
                   "one per vertex and light");
        check_size(where, "base", in.base.size(), size(), "one per Gaussian");
        check_memory(*backend_, where, "light", in.light);
        check_memory(*backend_, where, "vertices", in.vertices);
        check_memory(*backend_, where, "normals", in.normals);
        check_memory(*backend_, where, "visibility", in.visibility);
        check_memory(*backend_, where, "base", in.base);
    }
    [[nodiscard]] detail::LitVertices<T> vertices(const Input& in, const Cache& cache) const {
        return {{in.light.points, in.light.directions, cache.factors, !in.light.gloss.empty()},
                in.vertices, in.normals, in.visibility, in.center};
    }
    [[nodiscard]] detail::LitColors<T> splats(const Input& in, const Cache& cache) const {
        return {surface_.corners(), cache.shading, in.base, clamping_};
    }

    B* backend_;
    ColorClamp clamping_;
    SurfaceInterpolation<B, T> surface_;
};

} // namespace gsh
