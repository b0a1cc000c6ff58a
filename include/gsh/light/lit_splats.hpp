// SPDX-License-Identifier: Apache-2.0
/// @file  Colours of posed Gaussians under a light, from normals and visibilities of the vertices of the body's mesh.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
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
/// Shapes  N Gaussians, V vertices, P points and D directions of the light: means, base [N]; normals [V];
///         visibility [V, P + D].
/// Frame   the world, with the body posed.
/// Units   means in metres; base display-referred sRGB without light, not negative; normals of any length; visibility
///         the share of each light that reaches the vertex, 0 to 1.
template <class T>
struct LitSplatsInput {
    LightView<const T> light = {};
    Span<const vec3<T>> means = {};
    Span<const vec3<T>> base = {};
    Span<const vec3<T>> normals = {};
    Span<const T> visibility = {};
    vec3<T> center = vec3<T>(T(0));
};

/// Gradients with respect to a LitSplatsInput. Each may be empty; it is then not computed. Visibility has none.
///
/// Shapes  as the input; center [1].
template <class T>
struct LitSplatsGradient {
    LightView<T> light = {};
    Span<vec3<T>> means = {};
    Span<vec3<T>> base = {};
    Span<vec3<T>> normals = {};
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

    Buffer<T> irradiance, specular;  // [N] E and S of LitGaussian
    Buffer<T> factors;               // [P + D + 2] of LitLight
    Buffer<vec3<T>> dL_dnormals;     // [N] of the interpolated normals
    LitSplatsScratch<B, T> scratch;  // the backend's own
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

/// V_k of one Gaussian.
template <class T>
struct InterpolatedVisibility {
    const Contribution<T>* corner;
    const T* visibility; // [V, lights]
    std::size_t lights;
    [[nodiscard]] GSH_HD T operator()(std::size_t k) const {
        T sum = visibility[corner[0].index * lights + k] * corner[0].weight;
        for (int c = 1; c < 3; ++c) sum += visibility[corner[c].index * lights + k] * corner[c].weight;
        return sum;
    }
};

template <class T>
struct LitSplatInput {
    LitLight<T> light;
    Span<const Contribution<T>> corners;   // [N, 3]
    Span<const vec3<T>> means, base, normals;
    Span<const T> visibility;
    vec3<T> center;

    /// Of the three corners.
    [[nodiscard]] GSH_HD vec3<T> normal(std::size_t i) const {
        const Contribution<T>* corner = corners.data() + 3 * i;
        return normals[corner[0].index] * corner[0].weight + normals[corner[1].index] * corner[1].weight +
               normals[corner[2].index] * corner[2].weight;
    }
    [[nodiscard]] GSH_HD LitGaussian::Input<T> operator[](std::size_t i) const {
        return {means[i], base[i], normal(i), center};
    }
    [[nodiscard]] GSH_HD InterpolatedVisibility<T> visibility_of(std::size_t i) const {
        return {corners.data() + 3 * i, visibility.data(), light.size()};
    }
};

template <class T>
struct LitSplatForward {
    LitSplatInput<T> input;
    Span<vec3<T>> colors;             // may be the memory of input.base
    Span<T> irradiance, specular;     // [N]

    GSH_HD void operator()(std::size_t i) const {
        const auto in = input[i];
        const auto shading = LitGaussian::shading(input.light, in, input.visibility_of(i));
        irradiance[i] = shading.irradiance;
        specular[i] = shading.specular;
        colors[i] = LitGaussian::color(in.base, shading, input.light.clamping);
    }
};

/// The adjoint of one Gaussian: adds to its own attributes, and to sums and a centre that the caller provides.
template <class T>
struct LitSplatBackward {
    LitSplatInput<T> input;
    Span<const T> irradiance, specular;
    Span<const vec3<T>> dL_dcolors;
    Span<vec3<T>> dL_dmeans, dL_dbase, dL_dnormals; // [N] or empty; dL_dnormals is overwritten

    GSH_HD void operator()(std::size_t i, const LitLightSums<T>& sums, vec3<T>& dL_dcenter) const {
        LitGaussian::Gradient<T> gradient;
        if (!unseen(i)) {
            gradient = adjoint(i, dL_dcolors[i], sums);
            dL_dcenter += gradient.center;
        }
        store(i, gradient);
    }

    [[nodiscard]] GSH_HD LitGaussian::Gradient<T> adjoint(std::size_t i, const vec3<T>& dL_dcolor,
                                                          const auto& sums) const {
        const auto in = input[i];
        const LitGaussian::Shading<T> shading{irradiance[i], specular[i]};
        LitGaussian::Shading<T> dL_dshading{T(0), T(0)};
        LitGaussian::Gradient<T> gradient;
        LitGaussian::color_backward(in.base, shading, dL_dcolor, input.light.clamping, gradient.base, dL_dshading);
        LitGaussian::shading_backward(input.light, in, input.visibility_of(i), shading, dL_dshading, gradient, sums);
        return gradient;
    }
    /// Adds to the Gaussian's own attributes, and writes the gradient of its normal.
    GSH_HD void store(std::size_t i, const LitGaussian::Gradient<T>& gradient) const {
        if (!dL_dmeans.empty()) dL_dmeans[i] += gradient.mean;
        if (!dL_dbase.empty()) dL_dbase[i] += gradient.base;
        if (!dL_dnormals.empty()) dL_dnormals[i] = gradient.normal;
    }

    /// True if the colour has no gradient. The adjoint is linear, so such a Gaussian contributes nothing.
    [[nodiscard]] GSH_HD bool unseen(std::size_t i) const {
        return dL_dcolors[i].x == T(0) && dL_dcolors[i].y == T(0) && dL_dcolors[i].z == T(0);
    }
};

} // namespace detail

/// Fallback for backends without an overload: each index is one Gaussian.
template <Backend B, class T>
void lit_splats_shade(B& backend, const detail::LitSplatForward<T>& element) {
    static_assert(!CpuBackend<B>, "LitSplats: include its backend's overloads, "
                                  "<gsh/light/cpu/lit_splats.hpp> or <gsh/cpu.hpp>");
    backend.for_each(element.colors.size(), element);
}

/// Fallback without the backend's overloads, which the sums over Gaussians require: fails to compile, and names the
/// header to include.
template <Backend B, class... Arguments>
void lit_splats_accumulate(B&, const Arguments&...) {
    static_assert(detail::overload_is_included<B>, "LitSplats: include its backend's overloads, "
                                                   "<gsh/light/cpu/lit_splats.hpp> or <gsh/cpu.hpp>");
}

/// Colours of posed Gaussians under a light: LitGaussian for each of N Gaussians, whose normals and visibilities are
/// interpolated between the vertices of the triangle on which the Gaussian stands.
///
/// Only the product of base colours and intensities is observable, up to the gloss. Who learns both fixes one number of
/// the scale; the gradient here is the full one, whatever the caller fixes.
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
        cache.irradiance.resize(size());
        cache.specular.resize(size());
        cache.factors.resize(in.light.size() + 2);
        backend_->for_each(cache.factors.size(),
                           detail::LitFactors<T>{in.light.log_intensities, in.light.gloss, cache.factors});
        lit_splats_shade(*backend_, detail::LitSplatForward<T>{kernel_input(in, cache), colors, cache.irradiance,
                                                               cache.specular});
    }

    /// Adjoint of the last forward with this cache and the same input: adds to the non-empty attributes of dL_din.
    void backward(const Input& in, Span<const vec3<T>> dL_dcolors, Cache& cache, const Gradient& dL_din) const {
        constexpr auto where = "LitSplats::backward";
        check_input(where, in);
        check_size(where, "dL_dcolors", dL_dcolors.size(), size(), "one per Gaussian");
        check_size(where, "cache.irradiance", cache.irradiance.size(), size(), "forward must come first");
        check_size(where, "cache.factors", cache.factors.size(), in.light.size() + 2, "forward must come first");
        const auto check = [&](const char* name, std::size_t found, std::size_t expected) {
            if (found != 0) check_size(where, name, found, expected, "or none");
        };
        check("dL_din.light.points", dL_din.light.points.size(), in.light.points.size());
        check("dL_din.light.log_intensities", dL_din.light.log_intensities.size(), in.light.size());
        check("dL_din.light.gloss", dL_din.light.gloss.size(), in.light.gloss.size());
        check("dL_din.means", dL_din.means.size(), size());
        check("dL_din.base", dL_din.base.size(), size());
        check("dL_din.normals", dL_din.normals.size(), vertex_count());
        check("dL_din.center", dL_din.center.size(), 1);
        check_memory(*backend_, where, "dL_dcolors", dL_dcolors);
        check_memory(*backend_, where, "dL_din.light", dL_din.light);
        check_memory(*backend_, where, "dL_din", dL_din.means, "means");
        check_memory(*backend_, where, "dL_din", dL_din.base, "base");
        check_memory(*backend_, where, "dL_din", dL_din.normals, "normals");
        check_memory(*backend_, where, "dL_din", dL_din.center, "center");

        cache.dL_dnormals.resize(dL_din.normals.empty() ? 0 : size());
        lit_splats_accumulate(*backend_,
                              detail::LitSplatBackward<T>{kernel_input(in, cache), cache.irradiance, cache.specular,
                                                          dL_dcolors, dL_din.means, dL_din.base, cache.dL_dnormals},
                              dL_din.light, dL_din.center, cache.scratch);
        if (!dL_din.normals.empty()) surface_.backward(cache.dL_dnormals, dL_din.normals);
    }

private:
    void check_input(std::string_view where, const Input& in) const {
        check_light(where, in.light);
        check_size(where, "means", in.means.size(), size(), "one per Gaussian");
        check_size(where, "base", in.base.size(), size(), "one per Gaussian");
        check_size(where, "normals", in.normals.size(), vertex_count(), "one per vertex");
        check_size(where, "visibility", in.visibility.size(), vertex_count() * in.light.size(),
                   "one per vertex and light");
        check_memory(*backend_, where, "light", in.light);
        check_memory(*backend_, where, "means", in.means);
        check_memory(*backend_, where, "base", in.base);
        check_memory(*backend_, where, "normals", in.normals);
        check_memory(*backend_, where, "visibility", in.visibility);
    }
    [[nodiscard]] detail::LitSplatInput<T> kernel_input(const Input& in, const Cache& cache) const {
        return {{in.light.points, in.light.directions, cache.factors, !in.light.gloss.empty(), clamping_},
                surface_.corners(), in.means, in.base, in.normals, in.visibility, in.center};
    }

    B* backend_;
    ColorClamp clamping_;
    SurfaceInterpolation<B, T> surface_;
};

} // namespace gsh
