// SPDX-License-Identifier: Apache-2.0
/// @file  Common parts of both passes over a tile: 4x4 pixel blocks, splats in tile coordinates, and the blend.
///
/// A block is 16 pixels in arrays of 16 numbers. Loops over a block are straight arithmetic, which the compiler turns
/// into operations on one register (two or four on narrower machines). Small splats touch few pixels of a 16x16 tile.
/// With blocks, about four of five computed pixels have no effect; with whole tiles it would be more.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
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
            shapes.vy[j] = static_cast<float>(to.vy), shapes.reach[j] = static_cast<float>(generous(s.cut));
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

    /// Finds, in each row of blocks, the blocks that the ellipse meets between the first and the last line of pixels.
    /// It works as horizontal_extent (tiles.hpp), in single precision with a margin and without branches.
    void find_blocks(Shapes& s) {
        const std::size_t padded = (size + 15) / 16 * 16; // whole registers, padded with ellipses out of reach
        for (std::size_t j = size; j < padded; ++j)
            s.u[j] = s.v[j] = 1e6f, s.ux[j] = s.uy[j] = s.vy[j] = 1, s.reach[j] = 0;
        for (std::size_t first = 0; first < padded; first += 16) {
            for (std::size_t l = 0; l < 16; ++l) {
                const std::size_t j = first + l;
                const float u = s.u[j], v = s.v[j], vy = s.vy[j], reach = s.reach[j];
                const float inverse_ux = 1.0f / s.ux[j], shear = s.uy[j] / vy;
                const float radius = rough_sqrt(reach) * 1.0001f;
                const float tip = radius * shear / rough_sqrt(1.0f + shear * shear);
                const float margin = 2e-3f + 4e-6f * std::fabs(shear);
                const float base = shear * v - u;
                std::uint32_t found = 0;
                for (int row = 0; row < 4; ++row) {
                    const float low = v + static_cast<float>(4 * row) * vy, high = low + 3.0f * vy;
                    const float at_right = -tip < low ? low : (-tip > high ? high : -tip);
                    const float at_left = tip < low ? low : (tip > high ? high : tip);
                    const float right_square = reach - at_right * at_right, left_square = reach - at_left * at_left;
                    const float right_u = rough_sqrt(right_square > 0.0f ? right_square : 0.0f) + margin;
                    const float left_u = rough_sqrt(left_square > 0.0f ? left_square : 0.0f) + margin;
                    const float right = (base - shear * at_right + right_u) * inverse_ux;
                    const float left = (base - shear * at_left - left_u) * inverse_ux;
                    const bool inside = (low <= radius + margin) & (high >= -radius - margin);
                    for (int column = 0; column < 4; ++column) {
                        const bool touched = inside & (right >= static_cast<float>(4 * column)) &
                                             (left <= static_cast<float>(4 * column + 3));
                        found |= touched ? 1u << (4 * row + column) : 0u;
                    }
                }
                blocks[j] = found;
            }
        }
    }
};

/// The scalar limits of RasterParams, by value.
template <class T>
struct BlendLimits {
    T alpha_min, alpha_max, transmittance_min;
    explicit BlendLimits(const RasterParams<T>& p)
        : alpha_min(p.alpha_min), alpha_max(p.alpha_max), transmittance_min(p.transmittance_min) {}
};

/// The effect of a splat on a pixel; bit-identical in both passes.
///
/// The product of (1 - alpha) continues after a pixel has stopped. It only falls, so a splat is blended exactly if the
/// product after it is not below the limit. No pixel needs a branch.
template <class T>
struct BlendStep {
    T u, v, raw, alpha, keep, after, weight;
    bool live; ///< the pixel has not stopped: the splat is blended, or has no effect

    BlendStep(const TileSplat<T>& s, const BlendLimits<T>& limits, T x, T y, T before) {
        constexpr T least = sizeof(T) == 4 ? T(1e-36) : T(1e-300); // so that the product never becomes denormal
        u = multiply_add(s.ux, x, multiply_add(s.uy, y, s.u));
        v = multiply_add(s.vy, y, s.v);
        const T square = multiply_add(u, u, v * v);
        raw = s.opacity * exp2_minus(square);
        alpha = square <= s.cut ? min_positive(raw, limits.alpha_max) : T(0);
        keep = T(1) - alpha;
        after = max_positive(before * keep, least);
        live = after >= limits.transmittance_min;
        weight = live ? alpha * before : T(0);
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
