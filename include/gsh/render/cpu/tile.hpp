// SPDX-License-Identifier: Apache-2.0
/// @file  Common parts of both passes over a tile: 4x4 pixel blocks, splats in tile coordinates, and the blend.
///
/// A block is 16 pixels in arrays of 16 numbers. Loops over a block are straight arithmetic, which the compiler turns
/// into operations on one register (two or four on narrower machines). Small splats touch few pixels of a 16x16 tile.
/// With blocks, about four of five computed pixels have no effect; with whole tiles it would be more.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cpu/arithmetic.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/raster_cache.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cpu::inline GSH_ISA::detail {

using gsh::detail::BlendLimits;
using gsh::detail::BlendStep;

inline constexpr int block_lanes = 16;      // pixels of a 4x4 block
inline constexpr int blocks_of_tile = 16;   // blocks of a 16x16 tile
inline constexpr int tile_pixels = block_lanes * blocks_of_tile;
inline constexpr int pixel_channels = 5;    // red, green, blue, depth, final transmittance
inline constexpr std::size_t batch_size = 64;

template <class T>
using Lanes = std::array<T, block_lanes>;

/// The column (or, with Rows, the row) within its tile of each pixel of each block.
template <class T, bool Rows>
inline constexpr auto pixel_coordinates = [] {
    std::array<Lanes<T>, blocks_of_tile> table{};
    for (std::size_t b = 0; b < blocks_of_tile; ++b)
        for (std::size_t l = 0; l < block_lanes; ++l)
            table[b][l] = static_cast<T>(Rows ? b / 4 * 4 + l / 4 : b % 4 * 4 + l % 4);
    return table;
}();

/// Index of a pixel in block order.
[[nodiscard]] constexpr int block_order(int x, int y) {
    return ((y >> 2) * 4 + (x >> 2)) * block_lanes + (y & 3) * 4 + (x & 3);
}

/// Position and size of a tile in the image.
struct TilePlace {
    int x, y, width, height; // first pixel; pixels inside the image

    TilePlace(const TileGrid& grid, std::uint32_t tile) {
        const int columns = grid.columns(), size = TileGrid::tile_size;
        x = static_cast<int>(tile) % columns * size;
        y = static_cast<int>(tile) / columns * size;
        width = grid.width - x < size ? grid.width - x : size;
        height = grid.height - y < size ? grid.height - y : size;
    }
};

/// A splat in tile coordinates: u, v are those of the centre of the first pixel.
template <class T>
struct alignas(16 * sizeof(T)) TileSplat {
    T u, v, ux, uy, vy, opacity, cut, red, green, blue, depth;
};

/// Up to batch_size splats of a tile, front to back, and the blocks that each may touch.
template <class T>
struct Batch {
    TileSplat<T> splats[batch_size];
    alignas(64) std::uint32_t blocks[batch_size]; // bit b: the splat may touch block b
    std::size_t size = 0;

    /// Copies the list's splats from `begin` on, and prefetches those of the next batch.
    void load(Span<const ScreenSplat<T>> from, Span<const TileInstance> list, std::size_t begin,
              const TilePlace& tile) {
        size = std::min(batch_size, list.size() - begin);
        const Span<const TileInstance> instances = list.subspan(begin, size);
        const std::size_t ahead = std::min(batch_size, list.size() - begin - size);
        for (std::size_t j = 0; j < ahead; ++j) prefetch(&from[instances.data()[size + j].splat]);
        const double x = tile.x + 0.5, y = tile.y + 0.5;
        Shapes shapes;
        for (std::size_t j = 0; j < size; ++j) {
            const ScreenSplat<T>& s = from[instances[j].splat];
            const double dx = x - s.mean2d.x, dy = y - s.mean2d.y;
            TileSplat<T>& to = splats[j];
            to.u = static_cast<T>(s.w.ux * dx + s.w.uy * dy);
            to.v = static_cast<T>(s.w.vy * dy);
            to.ux = static_cast<T>(s.w.ux), to.uy = static_cast<T>(s.w.uy), to.vy = static_cast<T>(s.w.vy);
            to.opacity = s.opacity, to.cut = s.cut, to.depth = s.depth;
            to.red = s.color.x, to.green = s.color.y, to.blue = s.color.z;
            shapes.u[j] = static_cast<float>(to.u), shapes.v[j] = static_cast<float>(to.v);
            shapes.ux[j] = static_cast<float>(to.ux), shapes.uy[j] = static_cast<float>(to.uy);
            shapes.vy[j] = static_cast<float>(to.vy), shapes.reach[j] = static_cast<float>(generous(double(s.cut)));
        }
        find_blocks(shapes);
    }

    /// The same bits by block: bit j of splats_of[b] equals bit b of blocks[j].
    void by_block(std::uint64_t (&splats_of)[blocks_of_tile]) const {
        std::fill_n(splats_of, blocks_of_tile, 0u);
        for (std::size_t first = 0; first < size; first += 16) {
            alignas(64) std::uint32_t bits[blocks_of_tile] = {};
            for (std::size_t l = 0; l < 16; ++l)
                for (std::uint32_t b = 0; b < blocks_of_tile; ++b) bits[b] |= ((blocks[first + l] >> b) & 1u) << l;
            for (std::size_t b = 0; b < blocks_of_tile; ++b) splats_of[b] |= std::uint64_t(bits[b]) << first;
        }
    }

private:
    /// The ellipses of the splats, member by member, for a loop over splats.
    struct Shapes {
        alignas(64) float u[batch_size], v[batch_size], ux[batch_size], uy[batch_size], vy[batch_size];
        alignas(64) float reach[batch_size];
    };

    /// A loop over whole registers, padded with ellipses out of reach.
    void find_blocks(Shapes& s) {
        const std::size_t padded = (size + 15) / 16 * 16;
        for (std::size_t j = size; j < padded; ++j)
            s.u[j] = s.v[j] = 1e6f, s.ux[j] = s.uy[j] = s.vy[j] = 1, s.reach[j] = 0;
        for (std::size_t first = 0; first < padded; first += 16)
            for (std::size_t l = 0; l < 16; ++l) {
                const std::size_t j = first + l;
                const Whitening<float> w{s.ux[j], s.uy[j], s.vy[j]};
                blocks[j] = gsh::detail::touched_blocks(s.u[j], s.v[j], w, s.reach[j]);
            }
    }
};

/// 1 inside the image, 0 outside.
template <class T>
[[nodiscard]] Lanes<T> initial_transmittance(const TilePlace& tile, std::size_t block) {
    Lanes<T> transmittance;
    for (std::size_t l = 0; l < block_lanes; ++l) {
        const bool inside = pixel_coordinates<int, false>[block][l] < tile.width &&
                            pixel_coordinates<int, true>[block][l] < tile.height;
        transmittance[l] = inside ? T(1) : T(0);
    }
    return transmittance;
}

/// Runs work(rank) for rank in [0, count): each thread takes the next rank when it has finished its last one. Results
/// must not depend on which thread runs which rank.
template <CpuBackend B, class Work>
void run_queue(B& backend, std::size_t count, const Work& work) {
    std::atomic<std::size_t> next{0};
    backend.for_chunks(backend.thread_count(), 1, [&](std::size_t, std::size_t, std::size_t) {
        for (std::size_t rank; (rank = next.fetch_add(1, std::memory_order_relaxed)) < count;) work(rank);
    });
}

} // namespace gsh::cpu::detail
