// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of the rasterizer, and the cache between its forward and backward passes.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/render/projection.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh {

template <std::floating_point T>
struct RasterParams : ProjectionParams<T> {
    T alpha_min = T(1) / 255;         ///< a splat is skipped where its alpha is below one 8-bit step
    T alpha_max = T(0.99);            ///< upper limit of a splat's alpha; the limit passes no gradient
    T transmittance_min = T(1e-4);    ///< a pixel stops before the splat that would take it below this
    /// Backward: a pixel passes no gradient to a splat where less than this share of the light reaches it. 0 gives the
    /// exact adjoint. More makes gradients of hidden splats exactly zero, so that later adjoints can skip them.
    T gradient_transmittance_min = T(0);
    std::uint64_t max_pairs = 1u << 26; ///< limit of (splat, tile) pairs, itself at most 2³² - 1; more are refused
};

/// Report of a forward pass; the rasterizer turns its errors into exceptions.
struct RasterStatus {
    std::uint64_t pairs = 0;           ///< (splat, tile) pairs
    std::uint32_t visible = 0;         ///< splats that reach a tile
    std::uint32_t nonfinite = 0;       ///< splats with a NaN or infinite number
    std::uint32_t first_nonfinite = 0; ///< the first of them
    /// Pairs that the buffers of a recorded step hold, in which the backend cannot enlarge them; more are refused.
    std::uint64_t capacity = std::numeric_limits<std::uint64_t>::max();
};

/// Private storage of a backend, between and within its passes: tile lists, sort buffers, partial sums. Each backend
/// specialises it beside its overloads of composite_forward and composite_backward.
template <Backend B, std::floating_point T>
struct RasterScratch {
    static_assert(detail::overload_is_included<B>,
                  "Rasterizer: include its backend's overloads, <gsh/render/cpu/rasterizer.hpp> or <gsh/cpu.hpp>");
};

/// Results of a forward pass, which its backward pass needs. The caller keeps the cache, so that steps of equal size
/// allocate nothing.
template <Backend B, std::floating_point T>
struct RasterCache {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    // Written by forward.
    Buffer<RasterStatus> status;     // [1]
    Buffer<std::uint8_t> visible;    // [N] 1: in front of the camera and reaching the image with alpha >= alpha_min
    std::size_t splat_count = 0;     // N; 0 if the splats were refused
    int width = 0, height = 0;       // of the image, pixels; 0 if the splats were refused
    bool has_depth = false;          // the target had an image of depths

    // Written by backward; 0 where a splat is not visible.
    Buffer<T> screen_gradient_norms; // [N] |dL_dmean2d|, 1/pixel
    Buffer<T> screen_radii;          // [N] three standard deviations along the splat's longer axis, pixels

    RasterScratch<B, T> scratch;     // the backend's own
};

} // namespace gsh
