// SPDX-License-Identifier: Apache-2.0
/// @file  Scratch memory of the CPU rasterizer: projected splats, tile lists, sort buffers, partial sums.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

namespace cpu::inline GSH_ISA {

/// A projected splat. Position and shape are double even for float splats, since the distance of a pixel from a splat
/// is a small difference of large numbers. Relative to a tile, float is precise enough. In float, it is a cache line.
template <std::floating_point T>
struct alignas(sizeof(T) == 4 ? 64 : 8) ScreenSplat {
    vec2<double> mean2d;      ///< pixels
    Whitening<double> w;
    T opacity;                ///< after compensation
    T depth;                  ///< camera z, metres
    vec3<T> color;
    T cut;                    ///< log2(opacity / alpha_min): alpha < alpha_min where u² + v² exceeds it
};

/// Depth as an integer with the same order, and the index of the splat.
template <class Key>
struct SortItem {
    Key key;
    std::uint32_t splat;
};

namespace detail {
/// A pair of a tile and a splat, and its number.
struct PairRecord {
    std::uint32_t tile, splat, pair;
};
} // namespace detail

} // namespace cpu

template <CpuBackend B, std::floating_point T>
struct RasterScratch<B, T> {
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    using Key = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;

    // Kept from forward to backward.
    TileGrid grid;
    Buffer<cpu::ScreenSplat<T>> splats;        // [N]
    Buffer<TileCover> covers;                  // [N]
    Buffer<std::uint32_t> pair_begin;          // [N + 1] pairs of a splat and a tile, in the order of its tiles
    Buffer<std::uint32_t> pair_places;         // [pairs] places in `instances`
    Buffer<std::uint32_t> tile_begin;          // [tiles + 1]
    Buffer<std::uint32_t> instances;           // [pairs] splats by tile, front to back
    Buffer<std::uint32_t> tile_order;          // [tiles] long lists first, empty tiles last
    Buffer<std::uint32_t> tile_used;           // [tiles] length of the part of the list that had an effect
    Buffer<std::uint16_t> touched;             // [pairs] bit b: the splat may touch block b of the tile
    Buffer<std::uint32_t> block_used;          // [active tiles, 16] the same for each block of pixels
    std::uint32_t active_tiles = 0;            // tiles with a non-empty list
    Buffer<T> pixels; // [active tiles, 5, 256] red, green, blue, depth sums; final transmittance

    // Used within one pass.
    Buffer<cpu::SortItem<Key>> items, items_scratch; // [N]
    Buffer<std::uint32_t> histograms;
    Buffer<cpu::detail::PairRecord> records;         // [pairs] in depth order of the splats
    Buffer<std::uint32_t> chunk_pairs;               // where the records of each chunk begin
    Buffer<RasterStatus> chunk_status;
    Buffer<T> slots; // [pairs, slot_size] share of each tile in the gradient of each of its splats, as in `instances`
    std::size_t slot_size = 0;
    Buffer<vec3<double>> tile_background;
    Buffer<CameraGradient<double>> chunk_camera;
};

} // namespace gsh
