// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians in the form that the rasterizer takes: posed, activated and coloured.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <type_traits>

namespace gsh {

/// How splats are filtered on the pixel grid. A scene must be rendered with the filter that it was trained with.
struct PixelFilter {
    double dilation = 0.3;           ///< square pixels, added to both variances of a projected splat
    bool compensate_opacity = false; ///< reduce the opacity so that dilation preserves a splat's total weight

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("filter.dilation", self.dilation, SettingRange::at_least(0));
        f("filter.compensate_opacity", self.compensate_opacity, SettingRange());
    }
};

/// One splat, in units and frame of a SplatView; also its gradient.
template <class T>
struct Splat {
    vec3<T> mean;
    sym3<T> covariance;
    T opacity;
    vec3<T> color;
};

/// One splat by a factor F of its covariance F Fᵀ; also its gradient.
template <class T>
struct FactoredSplat {
    vec3<T> mean;
    mat3<T> factor;
    T opacity;
    vec3<T> color;
};

/// Views of N Gaussians in world space; `SplatView<const T>` is an input, `SplatView<T>` an output or a gradient.
///
/// A splat's shape is its covariance, or a factor of it; one of the two arrays is empty. A covariance in single
/// precision cannot hold an axis that is thousands of times thinner than another one: the square of the thin axis is
/// below the rounding of the square of the long one. A factor holds both.
///
/// Shapes  means [N], covariances [N] or factors [N], opacities [N], colors [N] RGB.
/// Units   metres, square metres (factors: metres), opacities in (0, 1), display-referred sRGB.
template <class T>
struct SplatView {
    using Scalar = std::remove_const_t<T>;
    template <class U>
    using Like = std::conditional_t<std::is_const_v<T>, const U, U>;

    Span<Like<vec3<Scalar>>> means;
    Span<Like<sym3<Scalar>>> covariances;
    Span<T> opacities;
    Span<Like<vec3<Scalar>>> colors;
    Span<Like<mat3<Scalar>>> factors = {};

    [[nodiscard]] GSH_HD std::size_t size() const { return means.size(); }
    /// Whether shapes are factors. Of no splats, false.
    [[nodiscard]] GSH_HD bool is_factored() const { return !factors.empty(); }
    [[nodiscard]] GSH_HD Splat<Scalar> operator[](std::size_t i) const {
        return {means[i], covariances[i], opacities[i], colors[i]};
    }
    [[nodiscard]] GSH_HD FactoredSplat<Scalar> factored(std::size_t i) const {
        return {means[i], factors[i], opacities[i], colors[i]};
    }
    GSH_HD void set(std::size_t i, const Splat<Scalar>& splat) const
        requires(!std::is_const_v<T>)
    {
        means[i] = splat.mean;
        covariances[i] = splat.covariance;
        opacities[i] = splat.opacity;
        colors[i] = splat.color;
    }
    GSH_HD void set(std::size_t i, const FactoredSplat<Scalar>& splat) const
        requires(!std::is_const_v<T>)
    {
        means[i] = splat.mean;
        factors[i] = splat.factor;
        opacities[i] = splat.opacity;
        colors[i] = splat.color;
    }
    /// `count` splats starting at index `first`, for instance one person's part of a scene.
    [[nodiscard]] GSH_HD SplatView subview(std::size_t first, std::size_t count) const {
        const bool factored = is_factored();
        return {means.subspan(first, count), factored ? covariances : covariances.subspan(first, count),
                opacities.subspan(first, count), colors.subspan(first, count),
                factored ? factors.subspan(first, count) : factors};
    }
    template <std::same_as<T> U> // a template, because nvcc warns about a conversion to the same type
        requires(!std::is_const_v<T>)
    [[nodiscard]] operator SplatView<const U>() const
    {
        return {means, covariances, opacities, colors, factors};
    }
};

/// Sets every number of every attribute to zero, the initial value of a gradient.
template <Backend B, std::floating_point T>
void fill_zero(B& backend, const SplatView<T>& gradient) {
    backend.fill(gradient.means, vec3<T>(T(0)));
    backend.fill(gradient.covariances, sym3<T>{});
    backend.fill(gradient.opacities, T(0));
    backend.fill(gradient.colors, vec3<T>(T(0)));
    backend.fill(gradient.factors, mat3<T>(T(0)));
}

/// Whether every number of the gradient of splat i is zero. Adjoints are linear, so such a splat contributes nothing.
/// Splats outside of the picture are of this kind, and hidden ones with RasterParams::gradient_transmittance_min.
template <class T>
[[nodiscard]] GSH_INLINE GSH_HD bool is_zero(const SplatView<const T>& dL_dsplats, std::size_t i) {
    const vec3<T>&mean = dL_dsplats.means[i], &color = dL_dsplats.colors[i];
    if (!(dL_dsplats.opacities[i] == T(0) && mean.x == T(0) && mean.y == T(0) && mean.z == T(0) && color.x == T(0) &&
          color.y == T(0) && color.z == T(0)))
        return false;
    if (dL_dsplats.is_factored()) {
        const mat3<T>& F = dL_dsplats.factors[i];
        for (int c = 0; c < 3; ++c)
            if (!(F[c].x == T(0) && F[c].y == T(0) && F[c].z == T(0))) return false;
        return true;
    }
    const sym3<T>& cov = dL_dsplats.covariances[i];
    return cov.xx == T(0) && cov.xy == T(0) && cov.xz == T(0) && cov.yy == T(0) && cov.yz == T(0) && cov.zz == T(0);
}

/// Throws MemoryError unless the backend reaches every attribute.
template <Backend B, class T>
void check_memory(const B& backend, std::string_view where, std::string_view argument, const SplatView<T>& splats) {
    check_memory(backend, where, argument, splats.means, "means");
    check_memory(backend, where, argument, splats.covariances, "covariances");
    check_memory(backend, where, argument, splats.opacities, "opacities");
    check_memory(backend, where, argument, splats.colors, "colors");
    check_memory(backend, where, argument, splats.factors, "factors");
}

/// Storage behind a SplatView.
template <Backend B, std::floating_point T = float>
struct Splats {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    Buffer<vec3<T>> means;
    Buffer<sym3<T>> covariances;
    Buffer<T> opacities;
    Buffer<vec3<T>> colors;
    Buffer<mat3<T>> factors;

    /// Room for splats with covariances, or with factors of them.
    void resize(std::size_t count, bool factored = false) {
        means.resize(count);
        covariances.resize(factored ? 0 : count);
        opacities.resize(count);
        colors.resize(count);
        factors.resize(factored ? count : 0);
    }
    [[nodiscard]] SplatView<T> view() { return {means, covariances, opacities, colors, factors}; }
    [[nodiscard]] SplatView<const T> view() const { return {means, covariances, opacities, colors, factors}; }
};

} // namespace gsh
