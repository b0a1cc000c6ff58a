// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of the rasterizer, and what its forward pass leaves for the backward pass.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/render/projection.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

template <std::floating_point T>
struct RasterParams : ProjectionParams<T> {
    T alpha_min = T(1) / 255;         ///< below one 8-bit step a splat is skipped
    T alpha_max = T(0.99);            ///< no splat hides all behind it; nothing passes back through this cap
    T transmittance_min = T(1e-4);    ///< the splat that would take a pixel below this is not blended, nor any behind
    std::uint64_t max_pairs = 1u << 26; ///< (splat, tile) pairs; more are refused, not allocated. At most 2³² - 1
};

/// What the backend reports of a forward pass; the rasterizer turns the bad cases into exceptions.
struct RasterStatus {
    std::uint64_t pairs = 0;           ///< (splat, tile) pairs
    std::uint32_t visible = 0;         ///< splats that reach a tile
    std::uint32_t nonfinite = 0;       ///< splats with a NaN or infinite number
    std::uint32_t first_nonfinite = 0; ///< the first of them
};

/// What a backend keeps between its passes and for itself: tile lists, sort buffers, partial sums. Each backend
/// specialises it beside its overloads of composite_forward and composite_backward.
template <Backend B, std::floating_point T>
struct RasterScratch {
    static_assert(detail::overload_is_included<B>,
                  "Rasterizer: include its backend's overloads, <gsh/render/cpu/rasterizer.hpp> or <gsh/cpu.hpp>");
};

/// What a forward pass reports and its backward pass needs, kept by the caller, so that steps of equal size allocate
/// nothing.
template <Backend B, std::floating_point T>
struct RasterCache {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    // Of forward.
    Buffer<RasterStatus> status;     // [1]
    Buffer<std::uint8_t> visible;    // [N] 1: in front of the camera and reaching the image with alpha >= alpha_min
    std::size_t splat_count = 0;     // N; 0 if the splats were refused
    int width = 0, height = 0;       // of the image, pixels; 0 if the splats were refused

    // Of backward; both are 0 where a splat is not visible.
    Buffer<T> screen_gradient_norms; // [N] |dL_dmean2d|, 1/pixel
    Buffer<T> screen_radii;          // [N] three standard deviations along the splat's longer axis, pixels

    RasterScratch<B, T> scratch;     // the backend's own
};

} // namespace gsh
