// SPDX-License-Identifier: Apache-2.0
/// @file  Common parts of both passes over a tile on a GPU: splats in tile coordinates, and lists of blocks of pixels.
///
/// A thread block is a 16x16 tile with one thread per pixel. Half a warp is a block of 4x4 pixels and has its own list,
/// so both halves blend different splats at the same time. For the body of bench/render/rasterizer_bench.cpp at
/// 540x540, the warps then blend 351,000 times; with one list for both blocks of a warp it would be 454,000 times, and
/// with the tile's list 2.1 million times. The two blocks are above each other: people are upright, so their lists are
/// of similar length (side by side, it would be 410,000 times).
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

using gsh::detail::BlendLimits;
using gsh::detail::BlendStep;
using gsh::detail::product;
using gsh::multiply_add;

inline constexpr unsigned block_lanes = 16; // pixels of a 4x4 block

/// The block of pixels, numbered by rows, of half a warp.
[[nodiscard]] __device__ constexpr unsigned block_of_half(unsigned half) {
    return half / 2 % 4 + 4 * (half / 8 * 2 + half % 2);
}

/// The pixel of a thread: its place in the image and in its block.
struct TilePixel {
    std::uint32_t tile;
    int tile_x, tile_y;   // first pixel of the tile
    unsigned block, lane; // block of 4x4 pixels, and pixel in it
    int x, y;             // in the tile
    bool inside;          // of the image
    std::size_t index;    // in a plane of the image

    __device__ TilePixel(const TileGrid& grid, std::uint32_t of_tile)
        : tile(of_tile), block(block_of_half(threadIdx.x / block_lanes)), lane(threadIdx.x % block_lanes) {
        const int columns = grid.columns(), size = TileGrid::tile_size;
        tile_x = static_cast<int>(tile) % columns * size;
        tile_y = static_cast<int>(tile) / columns * size;
        x = static_cast<int>(block % 4 * 4 + lane % 4);
        y = static_cast<int>(block / 4 * 4 + lane / 4);
        inside = tile_x + x < grid.width && tile_y + y < grid.height;
        index = static_cast<std::size_t>(tile_y + y) * static_cast<std::size_t>(grid.width) +
                static_cast<std::size_t>(tile_x + x);
    }
    /// Whether a lane of this half of the warp has voted.
    [[nodiscard]] __device__ bool in_half(unsigned votes) const {
        return (votes & (threadIdx.x % warp_size < block_lanes ? 0xFFFFu : 0xFFFF0000u)) != 0;
    }
};

/// A splat in tile coordinates: u, v are those of the centre of the first pixel.
template <class T>
struct alignas(16) TileSplat {
    T u, v, ux, uy, vy, opacity, cut, depth, red, green, blue, unused;

    TileSplat() = default;
    /// One that touches nothing.
    [[nodiscard]] __device__ static TileSplat none() {
        TileSplat splat{};
        splat.cut = T(-1);
        return splat;
    }
    /// Both passes must have the same bits, so roundings are explicit.
    __device__ TileSplat(const ScreenSplat<T>& s, const TilePixel& tile)
        : ux(s.ux), uy(s.uy), vy(s.vy), opacity(s.opacity), cut(s.cut), depth(s.depth), red(s.red), green(s.green),
          blue(s.blue), unused(0) {
        const T dx = (static_cast<T>(tile.tile_x) + T(0.5) - s.x) - s.x_low();
        const T dy = (static_cast<T>(tile.tile_y) + T(0.5) - s.y) - s.y_low();
        u = multiply_add(ux, dx, product(uy, dy));
        v = product(vy, dy);
    }
    /// The blocks of pixels that it may touch.
    [[nodiscard]] __device__ std::uint32_t touched() const {
        const Whitening<float> w{static_cast<float>(ux), static_cast<float>(uy), static_cast<float>(vy)};
        return gsh::detail::touched_blocks(static_cast<float>(u), static_cast<float>(v), w,
                                           static_cast<float>(gsh::detail::generous(cut)));
    }
};

/// The lists of the 16 blocks of pixels over a batch of splats.
template <unsigned Batch, class Entry>
struct BlockLists {
    static constexpr unsigned unroll = 4; // splats that are blended between two votes on whether pixels accept more
    static_assert(Batch % warp_size == 0 && Batch / warp_size <= block_lanes);
    static constexpr unsigned stride = Batch + 1;
    SharedArray<Entry, blocks_of_tile * stride> entries;

    /// The list of a thread's block.
    struct List {
        unsigned length;    // of the list
        unsigned padded;    // of both lists of the warp, a multiple of `unroll`
        std::uint32_t word; // on lane g of a half warp: which of the splats 32 g, 32 g + 1, … are in the half's list
    };

    /// Makes the lists of this warp's two blocks: the splats j, in order, for which bit b of mask(j) is set in block b,
    /// as entry(j, b). Both are padded to the same length and one entry more, so that a loop may load ahead.
    template <class Mask, class MakeEntry>
    __device__ List make(const Mask& mask, const MakeEntry& entry, Entry padding) {
        const unsigned lane = threadIdx.x % warp_size, half = lane / block_lanes;
        unsigned length[2] = {0, 0};
        List list{0, 0, 0};
        for (unsigned group = 0; group < Batch / warp_size; ++group) {
            const unsigned j = group * warp_size + lane;
            const std::uint32_t bits = mask(j);
            for (unsigned h = 0; h < 2; ++h) {
                const unsigned block = block_of_half(threadIdx.x / warp_size * 2 + h);
                const bool touched = (bits >> block & 1u) != 0;
                const unsigned votes = __ballot_sync(all_lanes, touched);
                if (touched) entries[block * stride + length[h] + before(votes, lane)] = entry(j, block);
                if (lane == h * block_lanes + group) list.word = votes;
                length[h] += static_cast<unsigned>(__popc(votes));
            }
        }
        list.length = length[half];
        const unsigned longer = length[0] < length[1] ? length[1] : length[0];
        list.padded = (longer + unroll - 1) / unroll * unroll;
        for (unsigned k = list.length + lane % block_lanes; k <= list.padded; k += block_lanes)
            entries[block_of_half(threadIdx.x / block_lanes) * stride + k] = padding;
        __syncwarp();
        return list;
    }
    /// Removes from `word` the splats from place `end` of a block's list on; `end` is that of this thread's block.
    template <class Mask>
    __device__ void cut(const Mask& mask, unsigned end, List& list) const {
        const unsigned lane = threadIdx.x % warp_size;
        unsigned length[2] = {0, 0};
        for (unsigned group = 0; group < Batch / warp_size; ++group) {
            const std::uint32_t bits = mask(group * warp_size + lane);
            for (unsigned h = 0; h < 2; ++h) {
                const bool touched = (bits >> block_of_half(threadIdx.x / warp_size * 2 + h) & 1u) != 0;
                const unsigned votes = __ballot_sync(all_lanes, touched);
                const unsigned limit = __shfl_sync(all_lanes, end, static_cast<int>(h * block_lanes));
                const unsigned kept = __ballot_sync(all_lanes, touched && length[h] + before(votes, lane) < limit);
                if (lane == h * block_lanes + group) list.word = kept;
                length[h] += static_cast<unsigned>(__popc(votes));
            }
        }
    }
    [[nodiscard]] __device__ Entry at(unsigned block, unsigned k) { return entries[block * stride + k]; }

private:
    /// The number of votes of lanes before this one.
    [[nodiscard]] __device__ static unsigned before(unsigned votes, unsigned lane) {
        return static_cast<unsigned>(__popc(votes & ((1u << lane) - 1)));
    }
};

} // namespace gsh::cuda::detail
