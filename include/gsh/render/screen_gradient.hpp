// SPDX-License-Identifier: Apache-2.0
/// @file  The gradient of splats on the image plane, between the blend and the projection.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/splat_moments.hpp>
#include <gsh/render/tiles.hpp>

namespace gsh {

/// Gradient with respect to what the projection hands to the blend. Empty spans are skipped.
///
/// Shapes  [N] each; 0 for a splat that is not visible.
/// Units   means2d 1/pixel; conics 1/(1/px²), with respect to the packed numbers of Σ⁻¹, so xy counts both entries;
///         depths 1/metre; opacities of the compensated ones.
template <class T>
struct ScreenGradient {
    Span<vec2<T>> means2d = {};
    Span<sym2<T>> conics = {};
    Span<T> depths = {};
    Span<T> opacities = {};
    Span<vec3<T>> colors = {};
    /// The sum over a splat's pixels of the absolute values of each pixel's share of dL_dmean2d, for density control
    /// after Ye et al., "AbsGS: Recovering Fine Details for 3D Gaussian Splatting", 2024.
    Span<vec2<T>> absolute_means2d = {};
};

/// The gradient of a conic Σ⁻¹ from a splat's moments. With d = pixel - mean2d, ln α = ln opacity - dᵀ Σ⁻¹ d / 2, so
/// the gradient is -Σ G d dᵀ / 2; and d = W⁻¹ (u, v).
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD sym2<T> conic_gradient(const Whitening<T>& W, const SplatMoments<T>& moments) {
    using S = ScalarOf<T>;
    const T half(S(0.5)), two(S(2)), shear = W.uy / W.vy;
    const T xx = moments.uu + shear * (shear * moments.vv - two * moments.uv), xy = moments.uv - shear * moments.vv;
    return {-half * xx / (W.ux * W.ux), -xy / (W.ux * W.vy), -half * moments.vv / (W.vy * W.vy)};
}

/// Adjoint of the inverse of a symmetric matrix: the gradient of Σ from that of conic = Σ⁻¹, both packed.
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD sym2<T> conic_backward(const sym2<T>& conic, const sym2<T>& dL_dconic) {
    using S = ScalarOf<T>;
    const T half(S(0.5)), two(S(2)), a = dL_dconic.xx, b = half * dL_dconic.xy, c = dL_dconic.yy;
    // The columns of (the gradient's matrix) Σ⁻¹, then -Σ⁻¹ of them.
    const T a0 = a * conic.xx + b * conic.xy, b0 = b * conic.xx + c * conic.xy;
    const T a1 = a * conic.xy + b * conic.yy, b1 = b * conic.xy + c * conic.yy;
    return {-(conic.xx * a0 + conic.xy * b0), -two * (conic.xx * a1 + conic.xy * b1),
            -(conic.xy * a1 + conic.yy * b1)};
}

} // namespace gsh
