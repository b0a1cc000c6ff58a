// SPDX-License-Identifier: Apache-2.0
/// @file  The effect of one splat on one pixel: what every pass of every backend decides in the same way.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/render/arithmetic.hpp>
#include <gsh/render/raster_cache.hpp>

#include <concepts>

namespace gsh::detail {

/// Limit of cut, within the range of exp2_minus and far above what any opacity up to 1 needs.
template <std::floating_point T>
inline constexpr T largest_cut = sizeof(T) == 4 ? T(120) : T(1000);

/// The scalar limits of RasterParams, by value.
template <class T>
struct BlendLimits {
    T alpha_min, alpha_max, transmittance_min, gradient_transmittance_min;
    explicit BlendLimits(const RasterParams<T>& p)
        : alpha_min(p.alpha_min), alpha_max(p.alpha_max), transmittance_min(p.transmittance_min),
          gradient_transmittance_min(p.gradient_transmittance_min) {}
};

inline namespace GSH_ISA { // roundings depend on the instruction set

/// Enlarges a cut slightly, so that rounding in the choice of tiles and of blocks of pixels never loses a pixel that
/// the blend would draw.
template <Lane T>
[[nodiscard]] GSH_HD T generous(T cut) {
    using S = ScalarOf<T>;
    return multiply_add(cut, T(S(1.0001)), T(S(1e-3)));
}

/// The part of a BlendStep that does not depend on the splats in front.
///
/// A splat has the members u, v (of the centre of the tile's first pixel), ux, uy, vy (Whitening), opacity and
/// cut = log2(opacity / alpha_min); x and y count pixels within the tile.
template <Lane T>
struct BlendShape {
    T u, v, raw, alpha; ///< raw: before the limits of alpha

    template <class Splat>
    GSH_INLINE GSH_HD BlendShape(const Splat& s, const BlendLimits<ScalarOf<T>>& limits, T x, T y) {
        u = multiply_add(T(s.ux), x, multiply_add(T(s.uy), y, T(s.u)));
        v = multiply_add(T(s.vy), y, T(s.v));
        const T square = multiply_add(u, u, product(v, v));
        raw = product(T(s.opacity), exp2_minus(square));
        alpha = select(square <= T(s.cut), min_positive(raw, T(limits.alpha_max)), T(ScalarOf<T>(0)));
    }
};

/// The product of (1 - alpha) after further splats, of which `keep` is the product. It never becomes denormal.
template <Lane T>
[[nodiscard]] GSH_INLINE GSH_HD T next_product(T before, T keep) {
    using S = ScalarOf<T>;
    constexpr S least = sizeof(S) == 4 ? S(1e-36) : S(1e-300);
    return max_positive(product(before, keep), T(least));
}

/// The effect of a splat on a pixel; bit-identical in both passes.
///
/// The product of (1 - alpha) continues after a pixel has stopped. It only falls, so a splat is blended exactly if the
/// product after it is not below the limit. No pixel needs a branch.
///
/// T is one pixel's number, or a register of those of several pixels; `before` is the product before the splat.
template <Lane T>
struct BlendStep : BlendShape<T> {
    T keep, after, weight;
    MaskOf<T> live; ///< the pixel has not stopped: the splat is blended, or has no effect

    template <class Splat>
    GSH_INLINE GSH_HD BlendStep(const Splat& s, const BlendLimits<ScalarOf<T>>& limits, T x, T y, T before)
        : BlendStep(BlendShape<T>(s, limits, x, y), limits, before) {}

    GSH_INLINE GSH_HD BlendStep(const BlendShape<T>& shape, const BlendLimits<ScalarOf<T>>& limits, T before)
        : BlendShape<T>(shape) {
        using S = ScalarOf<T>;
        keep = T(S(1)) - this->alpha;
        after = next_product(before, keep);
        live = after >= T(limits.transmittance_min);
        weight = select(live, product(this->alpha, before), T(S(0)));
    }
};

} // namespace GSH_ISA

} // namespace gsh::detail
