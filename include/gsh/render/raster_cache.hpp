// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of the rasterizer, and what its forward pass leaves for the backward pass.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstdint>
#include <type_traits>

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

/// A splat as the tiles see it. Position and shape are double even for float splats, since a pixel's distance to a
/// splat is a small difference of large numbers; taken relative to a tile it fits a float again.
template <std::floating_point T>
struct ScreenSplat {
    vec2<double> center;      ///< pixels
    Whitening<double> w;
    T opacity;                ///< after compensation
    T depth;                  ///< camera z, metres
    vec3<T> color;
    T cut;                    ///< log2(opacity / alpha_min): where u² + v² exceeds it, alpha < alpha_min
};

/// The tiles of one splat. A rectangle of up to 8x8 tiles carries a bit for each, eight to a row; of a larger one the
/// splat's own shape says which tiles count.
struct TileCover {
    std::uint64_t mask = 0;
    std::uint16_t x0 = 0, y0 = 0, columns = 0, rows = 0;
};

/// Depth as an integer that sorts like it, and the splat it belongs to.
template <class Key>
struct SortItem {
    Key key;
    std::uint32_t splat;
};

/// One splat in one tile; `slot` is where the tile leaves its share of the splat's gradient.
struct TileInstance {
    std::uint32_t splat, slot;
};

/// Buffers of Rasterizer, kept by the caller so that steps of equal size allocate nothing.
template <Backend B, std::floating_point T>
struct RasterCache {
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    using Key = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;

    // For the caller.
    Buffer<RasterStatus> status;         // [1]
    Buffer<std::uint8_t> visible;        // [N] 1: in front of the camera and reaching the image with alpha >= alpha_min
    Buffer<T> screen_gradient_norms;     // [N] |dL/d center| in 1/pixel, written by backward; 0 where not visible

    // Between the passes.
    std::size_t splat_count = 0;
    TileGrid grid;
    Buffer<ScreenSplat<T>> splats;       // [N]
    Buffer<TileCover> covers;            // [N]
    Buffer<std::uint32_t> slot_begin;    // [N + 1] slots of a splat, in the order of its tiles
    Buffer<std::uint32_t> tile_begin;    // [tiles + 1]
    Buffer<TileInstance> instances;      // [pairs] by tile, front to back
    Buffer<std::uint32_t> tile_order;    // [tiles] long lists first, empty tiles last
    Buffer<std::uint32_t> tile_used;     // [tiles] length of the list that some pixel still looked at
    std::uint32_t active_tiles = 0;      // tiles with a list
    Buffer<T> pixels;                    // [active tiles, 5, 256] red, green, blue, depth sums; final transmittance

    // Scratch.
    Buffer<SortItem<Key>> items, items_scratch; // [N]
    Buffer<std::uint32_t> histograms;
    Buffer<RasterStatus> chunk_status;
    Buffer<T> slots;                     // [pairs, slot_size]
    std::size_t slot_size = 0;
    Buffer<vec3<double>> tile_background;
    Buffer<CameraGradient<double>> chunk_camera;
};

} // namespace gsh
