// SPDX-License-Identifier: Apache-2.0
/// @file  What both passes over a tile share: its 4x4 pixel blocks, splats staged in its own frame, the blend's
///        arithmetic, and the queue of tiles.
///
/// A block is 16 pixels in arrays of 16 numbers, and each loop over them is straight arithmetic, so that the compiler
/// turns it into one register's work (two or four on narrower machines). Small splats touch few pixels of a 16x16
/// tile; blocks keep the pixels that are computed in vain down to about four of five.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/render/cpu/arithmetic.hpp>
#include <gsh/render/raster_cache.hpp>

#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cpu::detail {

inline constexpr int block_lanes = 16;      // pixels of a 4x4 block
inline constexpr int blocks_of_tile = 16;   // blocks of a 16x16 tile
inline constexpr int tile_pixels = block_lanes * blocks_of_tile;
inline constexpr int pixel_channels = 5;    // red, green, blue, depth, final transmittance
inline constexpr std::size_t batch_size = 64;

template <class T>
using Lanes = std::array<T, block_lanes>;

/// Column and row of each pixel in its block.
template <class T>
alignas(64) inline constexpr T lane_x[block_lanes] = {0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3};
template <class T>
alignas(64) inline constexpr T lane_y[block_lanes] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};

/// A pixel's place in block order.
[[nodiscard]] constexpr int block_order(int x, int y) {
    return ((y >> 2) * 4 + (x >> 2)) * block_lanes + (y & 3) * 4 + (x & 3);
}

/// A tile's place in the image.
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

/// Up to batch_size splats of a tile, front to back. u, v are measured from the centre of the tile's first pixel.
template <class T>
struct Batch {
    alignas(64) T u[batch_size], v[batch_size], ux[batch_size], uy[batch_size], vy[batch_size];
    alignas(64) T opacity[batch_size], red[batch_size], green[batch_size], blue[batch_size], depth[batch_size];
    alignas(64) float reach[batch_size];
    alignas(64) std::uint32_t mask[batch_size]; // blocks that the splat may touch
    std::size_t size = 0;

    void load(Span<const ScreenSplat<T>> splats, Span<const TileInstance> instances, const TilePlace& tile) {
        size = instances.size();
        const double x = tile.x + 0.5, y = tile.y + 0.5;
        for (std::size_t j = 0; j < size; ++j) {
            const ScreenSplat<T>& s = splats[instances[j].splat];
            const double dx = x - s.center.x, dy = y - s.center.y;
            u[j] = static_cast<T>(s.w.ux * dx + s.w.uy * dy);
            v[j] = static_cast<T>(s.w.vy * dy);
            ux[j] = static_cast<T>(s.w.ux), uy[j] = static_cast<T>(s.w.uy), vy[j] = static_cast<T>(s.w.vy);
            opacity[j] = s.opacity, depth[j] = s.depth;
            red[j] = s.color.x, green[j] = s.color.y, blue[j] = s.color.z;
            reach[j] = static_cast<float>(s.reach);
        }
        find_blocks();
    }

private:
    /// The blocks of each row of blocks that the ellipse's extent between its first and last line of pixels meets: as
    /// horizontal_extent (tiles.hpp), in single precision with a margin, without branches.
    void find_blocks() {
        const std::size_t padded = (size + 15) / 16 * 16; // whole registers; what lies beyond size is not read
        for (std::size_t j = size; j < padded; ++j) u[j] = v[j] = T(0), ux[j] = uy[j] = vy[j] = T(1), reach[j] = 0;
        for (std::size_t first = 0; first < padded; first += 16)
            for (std::size_t j = first; j < first + 16; ++j) {
                const float u0 = static_cast<float>(u[j]), v0 = static_cast<float>(v[j]);
                const float step = static_cast<float>(vy[j]), inverse_ux = 1.0f / static_cast<float>(ux[j]);
                const float shear = static_cast<float>(uy[j]) / step;
                const float radius = rough_sqrt(reach[j]) * 1.0001f;
                const float tip = radius * shear / rough_sqrt(1.0f + shear * shear);
                const float margin = 2e-3f + 4e-6f * std::fabs(shear);
                const float base = shear * v0 - u0;
                std::uint32_t found = 0;
                for (int row = 0; row < 4; ++row) {
                    const float low = v0 + static_cast<float>(4 * row) * step, high = low + 3.0f * step;
                    const float at_right = -tip < low ? low : (-tip > high ? high : -tip);
                    const float at_left = tip < low ? low : (tip > high ? high : tip);
                    const float right_square = reach[j] - at_right * at_right;
                    const float left_square = reach[j] - at_left * at_left;
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
                mask[j] = found;
            }
    }
};

/// One splat as one block sees it.
template <class T>
struct BlockSplat {
    T u, v, ux, uy, vy, opacity, red, green, blue, depth;

    BlockSplat(const Batch<T>& batch, std::size_t j, int block)
        : ux(batch.ux[j]), uy(batch.uy[j]), vy(batch.vy[j]), opacity(batch.opacity[j]), red(batch.red[j]),
          green(batch.green[j]), blue(batch.blue[j]), depth(batch.depth[j]) {
        const T x = static_cast<T>(4 * (block & 3)), y = static_cast<T>(4 * (block >> 2));
        u = multiply_add(ux, x, multiply_add(uy, y, batch.u[j]));
        v = multiply_add(vy, y, batch.v[j]);
    }
};

/// The scalar limits of RasterParams, by value.
template <class T>
struct BlendLimits {
    T alpha_min, alpha_max, transmittance_min;
    explicit BlendLimits(const RasterParams<T>& p)
        : alpha_min(p.alpha_min), alpha_max(p.alpha_max), transmittance_min(p.transmittance_min) {}
};

/// opacity * 2^-(u² + v²) at the block's pixel (x, y).
template <class T>
[[nodiscard]] inline T splat_alpha(const BlockSplat<T>& s, T x, T y, T& u, T& v) {
    constexpr T lowest = sizeof(T) == 4 ? T(-120) : T(-1000); // beyond, the value is 0 for every alpha_min
    u = multiply_add(s.ux, x, multiply_add(s.uy, y, s.u));
    v = multiply_add(s.vy, y, s.v);
    const T exponent = -multiply_add(u, u, v * v);
    return s.opacity * exp2_in_range(exponent > lowest ? exponent : lowest);
}

/// alpha at which a pixel takes a splat: alpha_min; infinity outside the image, and once the pixel has stopped.
template <class T>
[[nodiscard]] Lanes<T> initial_cut(const TilePlace& tile, int block, T alpha_min) {
    Lanes<T> cut;
    for (int lane = 0; lane < block_lanes; ++lane) {
        const int x = 4 * (block & 3) + (lane & 3), y = 4 * (block >> 2) + (lane >> 2);
        cut[static_cast<std::size_t>(lane)] =
            x < tile.width && y < tile.height ? alpha_min : std::numeric_limits<T>::infinity();
    }
    return cut;
}

/// Runs work(rank) for rank in [0, count): each thread takes the next one when it is done with the last. Results
/// must not depend on who does what.
template <CpuBackend B, class Work>
void run_queue(B& backend, std::size_t count, const Work& work) {
    std::atomic<std::size_t> next{0};
    backend.for_chunks(backend.thread_count(), 1, [&](std::size_t, std::size_t, std::size_t) {
        for (std::size_t rank; (rank = next.fetch_add(1, std::memory_order_relaxed)) < count;) work(rank);
    });
}

} // namespace gsh::cpu::detail
