// SPDX-License-Identifier: Apache-2.0
/// @file  What the rasterizer's passes on the CPU keep: splats on the screen, tile lists, sort buffers, partial sums.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

namespace cpu::inline GSH_ISA {

/// A splat as the tiles see it. Position and shape are double even for float splats, since a pixel's distance to a
/// splat is a small difference of large numbers; taken relative to a tile it fits a float again.
template <std::floating_point T>
struct ScreenSplat {
    vec2<double> mean2d;      ///< pixels
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

} // namespace cpu

template <CpuBackend B, std::floating_point T>
struct RasterScratch<B, T> {
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    using Key = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;

    // Between the passes.
    TileGrid grid;
    Buffer<cpu::ScreenSplat<T>> splats;        // [N]
    Buffer<cpu::TileCover> covers;             // [N]
    Buffer<std::uint32_t> slot_begin;          // [N + 1] slots of a splat, in the order of its tiles
    Buffer<std::uint32_t> tile_begin;          // [tiles + 1]
    Buffer<cpu::TileInstance> instances;       // [pairs] by tile, front to back
    Buffer<std::uint32_t> tile_order;          // [tiles] long lists first, empty tiles last
    Buffer<std::uint32_t> tile_used;           // [tiles] length of the list that some pixel still looked at
    std::uint32_t active_tiles = 0;            // tiles with a list
    Buffer<T> pixels; // [active tiles, 5, 256] red, green, blue, depth sums; final transmittance

    // Within a pass.
    Buffer<cpu::SortItem<Key>> items, items_scratch; // [N]
    Buffer<std::uint32_t> histograms;
    Buffer<RasterStatus> chunk_status;
    Buffer<T> slots; // [pairs, slot_size]
    std::size_t slot_size = 0;
    Buffer<vec3<double>> tile_background;
    Buffer<CameraGradient<double>> chunk_camera;
};

} // namespace gsh
