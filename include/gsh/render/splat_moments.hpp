// SPDX-License-Identifier: Apache-2.0
/// @file  The gradient of a splat's place and shape on the image, from sums over its pixels.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/tiles.hpp>

namespace gsh {

/// Sums over the pixels of a splat, with G = dL/dα α of a pixel and (u, v) its place in the splat's whitened frame.
template <Lane T>
struct SplatMoments {
    T u, v;       ///< Σ G u, Σ G v
    T uu, uv, vv; ///< Σ G u², Σ G u v, Σ G v²
};

/// Sets mean2d and covariance of the gradient of a projected splat from its moments.
///
/// ln α = ln opacity - ln 2 (u² + v²), (u, v) = W (pixel - mean2d), Σ⁻¹ = 2 ln 2 Wᵀ W. With the moments m = Σ G (u, v)
/// and M = Σ G (u, v)(u, v)ᵀ: dL/dmean2d = 2 ln 2 Wᵀ m, dL/dΣ = 2 (ln 2)² Wᵀ M W, whose xy counts both entries.
template <Lane T>
GSH_INLINE GSH_HD void moments_backward(const Whitening<T>& W, const SplatMoments<T>& moments,
                                        Projection<T>& dL_dprojection) {
    using S = ScalarOf<T>;
    const T two(S(2)), ln2(S(0.69314718055994530942)), to_mean2d = two * ln2, to_covariance = to_mean2d * ln2;
    const T along_u = W.uy * moments.uu + W.vy * moments.uv, along_v = W.uy * moments.uv + W.vy * moments.vv;
    dL_dprojection.mean2d = vec2<T>(to_mean2d * (W.ux * moments.u), to_mean2d * (W.uy * moments.u + W.vy * moments.v));
    dL_dprojection.covariance = {to_covariance * (W.ux * W.ux * moments.uu), to_covariance * (two * W.ux * along_u),
                                 to_covariance * (W.uy * along_u + W.vy * along_v)};
}

} // namespace gsh
