// SPDX-License-Identifier: Apache-2.0
/// @file  Common parts of both passes over a tile: 4x4 pixel blocks, splats in tile coordinates, and the blend.
///
/// A block's 16 pixels are the lanes of one register of floats, or of several on narrower machines. Small splats touch
/// few pixels of a 16x16 tile. With blocks, about four of five computed pixels have no effect; with whole tiles it
/// would be more.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_shuffle.hpp>
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

namespace gsh::cpu::inline GSH_ISA::detail {

using gsh::detail::BlendLimits;
using gsh::detail::BlendShape;
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
    [[nodiscard]] bool is_whole() const { return width == TileGrid::tile_size && height == TileGrid::tile_size; }
};

/// True if some pixel of a block has at least this product of (1 - alpha).
template <class T>
[[nodiscard]] bool any_reaches([[maybe_unused]] const Lanes<T>& product, [[maybe_unused]] T least) {
    bool reaches = false;
#if !defined(__CUDA_ARCH__) // in its pass for the device, nvcc parses host code, too, and refuses vectors of registers
    using W = Wide<T>;
    for (std::size_t l = 0; l < block_lanes; l += W::width) reaches |= any(W::load(&product[l]) >= W(least));
#endif
    return reaches;
}

/// A splat in tile coordinates: u, v are those of the centre of the first pixel.
template <class T>
struct TileSplat {
    T u, v, ux, uy, vy, opacity, cut, red, green, blue, depth;
};

/// As many numbers of a batch as a register of floats holds, as floats.
[[nodiscard]] GSH_INLINE Wide<float> load_as_float(const float* numbers) { return Wide<float>::load(numbers); }
[[nodiscard]] GSH_INLINE Wide<float> load_as_float(const double* numbers) {
    alignas(64) float narrow[Wide<float>::width];
    for (std::size_t l = 0; l < Wide<float>::width; ++l) narrow[l] = static_cast<float>(numbers[l]);
    return Wide<float>::load(narrow);
}

/// Up to batch_size splats of a tile, front to back.
template <class T>
struct Batch {
    std::size_t size = 0;

    /// Copies the list's splats from `begin` on, and prefetches those of the next batch.
    void load(Span<const ScreenSplat<T>> from, Span<const std::uint32_t> list, std::size_t begin,
              const TilePlace& tile) {
        size = std::min(batch_size, list.size() - begin);
        const std::uint32_t* const instances = list.data() + begin;
        const std::size_t ahead = std::min(batch_size, list.size() - begin - size);
        for (std::size_t j = 0; j < ahead; ++j) prefetch(&from[instances[size + j]]);
        // Padding repeats the last splat, so that loops go over whole registers.
        const auto splat = [&](std::size_t j) -> const ScreenSplat<T>& {
            return from[instances[j < size ? j : size - 1]];
        };
        const double x = tile.x + 0.5, y = tile.y + 0.5;
        if constexpr (sizeof(T) == 4)
            for (std::size_t j = 0; j < size; j += Wide<T>::width) load_register(j, splat, x, y);
        else
            for (std::size_t j = 0; j < size + Wide<float>::width && j < batch_size; ++j) load_one(j, splat(j), x, y);
    }

    [[nodiscard]] GSH_INLINE TileSplat<T> operator[](std::size_t j) const {
        return {u_[j], v_[j], ux_[j], uy_[j], vy_[j], opacity_[j], cut_[j], red_[j], green_[j], blue_[j], depth_[j]};
    }

    /// The blocks that each splat may touch: bit b of touched[j] [size] and bit j of splats_of[b] are set for splat j
    /// and block b.
    void find_blocks([[maybe_unused]] std::uint16_t* touched, std::uint64_t (&splats_of)[blocks_of_tile]) const {
        std::fill_n(splats_of, blocks_of_tile, 0u);
#if !defined(__CUDA_ARCH__) // in its pass for the device, nvcc parses host code, too, and refuses vectors of registers
        using Bits = Wide<std::uint32_t>;
        for (std::size_t j = 0; j < size; j += Bits::width) {
            const Whitening<Wide<float>> w{load_as_float(ux_ + j), load_as_float(uy_ + j), load_as_float(vy_ + j)};
            const Bits blocks = gsh::detail::touched_blocks(load_as_float(u_ + j), load_as_float(v_ + j), w,
                                                            generous(load_as_float(cut_ + j)));
            const std::size_t count = std::min(Bits::width, size - j);
            for (std::size_t b = 0; b < blocks_of_tile; ++b) {
                const std::uint32_t bits = lane_bits((blocks & Bits(1u << b)) != Bits(0u)) & ((1u << count) - 1);
                splats_of[b] |= std::uint64_t(bits) << j;
            }
            alignas(64) std::uint32_t numbers[Bits::width];
            blocks.store(numbers);
            for (std::size_t l = 0; l < count; ++l) touched[j + l] = static_cast<std::uint16_t>(numbers[l]);
        }
#endif
    }

private:
    // Member by member, as TileSplat.
    alignas(64) T u_[batch_size], v_[batch_size], ux_[batch_size], uy_[batch_size], vy_[batch_size];
    alignas(64) T opacity_[batch_size], cut_[batch_size];
    alignas(64) T red_[batch_size], green_[batch_size], blue_[batch_size], depth_[batch_size];

    void load_one(std::size_t j, const ScreenSplat<T>& s, double x, double y) {
        const double dx = x - s.mean2d.x, dy = y - s.mean2d.y;
        u_[j] = static_cast<T>(s.w.ux * dx + s.w.uy * dy), v_[j] = static_cast<T>(s.w.vy * dy);
        ux_[j] = static_cast<T>(s.w.ux), uy_[j] = static_cast<T>(s.w.uy), vy_[j] = static_cast<T>(s.w.vy);
        opacity_[j] = s.opacity, cut_[j] = s.cut, depth_[j] = s.depth;
        red_[j] = s.color.x, green_[j] = s.color.y, blue_[j] = s.color.z;
    }

    /// The splats from j on, one in each lane: their records are transposed.
    template <class Splat>
    GSH_INLINE void load_register([[maybe_unused]] std::size_t j, [[maybe_unused]] const Splat& splat,
                                  [[maybe_unused]] double x_of_tile, [[maybe_unused]] double y_of_tile) {
#if !defined(__CUDA_ARCH__)
        using W = Wide<float>;
        using D = Wide<double>;
        constexpr std::size_t words = sizeof(ScreenSplat<float>) / sizeof(float);
        static_assert(words == 16 && words % W::width == 0);
        W word[words];
        for (std::size_t part = 0; part < words; part += W::width) {
            W rows[W::width];
            for (std::size_t l = 0; l < W::width; ++l)
                rows[l] = W::load(reinterpret_cast<const float*>(&splat(j + l)) + part);
            transpose(rows);
            for (std::size_t w = 0; w < W::width; ++w) word[part + w] = rows[w];
        }
        const auto number = [&](std::size_t w, std::size_t half) { // the double of words w and w + 1, lower one first
            const WidePair<float> halves = zip(word[w], word[w + 1]);
            return bits_as<D>(half == 0 ? halves.first : halves.second);
        };
        for (std::size_t half = 0; half < 2; ++half) {
            const std::size_t k = j + half * D::width;
            const D dx = D(x_of_tile) - number(0, half), dy = D(y_of_tile) - number(2, half);
            const D ux = number(4, half), uy = number(6, half), vy = number(8, half);
            store_narrowed(ux * dx + uy * dy, u_ + k), store_narrowed(vy * dy, v_ + k);
            store_narrowed(ux, ux_ + k), store_narrowed(uy, uy_ + k), store_narrowed(vy, vy_ + k);
        }
        word[10].store(opacity_ + j), word[11].store(depth_ + j);
        word[12].store(red_ + j), word[13].store(green_ + j), word[14].store(blue_ + j);
        word[15].store(cut_ + j);
#endif
    }
};

/// 1 inside the image, 0 outside.
template <class T>
[[nodiscard]] Lanes<T> initial_transmittance(const TilePlace& tile, std::size_t block) {
    Lanes<T> transmittance;
    if (tile.is_whole()) {
        transmittance.fill(T(1));
        return transmittance;
    }
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
