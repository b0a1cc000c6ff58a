// SPDX-License-Identifier: Apache-2.0
/// @file  Scratch memory of the CUDA rasterizer: projected splats, tile lists, states of the pixels, slots of sums.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/arithmetic.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cuda/segments.cuh>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

namespace cuda {

inline constexpr unsigned splats_of_block = 128; // of the kernels with one thread per splat
inline constexpr unsigned tile_pixels = 256;     // threads of the kernels with one thread per pixel of a tile
inline constexpr unsigned blocks_of_tile = 16;   // blocks of 4x4 pixels, each the work of half a warp
inline constexpr unsigned sorted_at_once = 2304; // entries that one thread block sorts: nine for each of its threads
inline constexpr unsigned blended_at_once = 1024; // entries that one thread block blends
inline constexpr unsigned tile_classes = 128;    // lengths of lists in steps of a quarter of an octave

/// A projected splat, three loads of 16 bytes. The distance of a pixel from a splat is a small difference of large
/// numbers. The centre therefore has more digits than T = float: `low` holds what the rounded x and y leave, each as
/// the upper half of a float.
template <std::floating_point T>
struct alignas(16) ScreenSplat {
    using Low = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
    T x, y; ///< mean2d, pixels
    T vy;   ///< of the Whitening
    Low low;
    T ux, uy;  ///< of the Whitening
    T opacity; ///< after compensation
    T cut;     ///< log2(opacity / alpha_min): alpha < alpha_min where u² + v² exceeds it
    T red, green, blue;
    T depth; ///< camera z, metres

    GSH_HD void set_low(T of_x, T of_y) {
        if constexpr (sizeof(T) == 4)
            low = upper_half(of_x) | upper_half(of_y) >> 16;
        else
            low = 0;
    }
    [[nodiscard]] GSH_HD T x_low() const {
        if constexpr (sizeof(T) == 4) return bits_as<T>(low & 0xFFFF0000u);
        return T(0);
    }
    [[nodiscard]] GSH_HD T y_low() const {
        if constexpr (sizeof(T) == 4) return bits_as<T>(low << 16);
        return T(0);
    }

private:
    [[nodiscard]] GSH_HD static std::uint32_t upper_half(float x) {
        return (bits_as<std::uint32_t>(x) + 0x8000u) & 0xFFFF0000u;
    }
};

/// The ellipse that a splat may draw in, around its pixel.
template <std::floating_point T>
[[nodiscard]] GSH_HD Ellipse<T> ellipse_of(const ScreenSplat<T>& s) {
    constexpr T limit = T(1 << 22); // centres farther away belong to splats that need no digits below a pixel
    Ellipse<T> e{s.x, s.y, {s.ux, s.uy, s.vy}, gsh::detail::generous(s.cut)};
    if constexpr (sizeof(T) == 4) {
        e.origin = {static_cast<int>(clamp(s.x, -limit, limit)), static_cast<int>(clamp(s.y, -limit, limit))};
        e.x = (s.x - static_cast<T>(e.origin.x)) + s.x_low();
        e.y = (s.y - static_cast<T>(e.origin.y)) + s.y_low();
    }
    return e;
}

/// Sorts a tile's list front to back, ties by index: slots ascend with the index of their splat. No two keys are equal.
template <std::floating_point T>
struct SortKey {
    std::uint64_t depth; // bits of a positive number, which sort like the number
    std::uint32_t slot;
    [[nodiscard]] GSH_HD bool operator<(const SortKey& o) const {
        return depth < o.depth || (depth == o.depth && slot < o.slot);
    }
    [[nodiscard]] GSH_HD static SortKey of(T depth, std::uint32_t slot) {
        return {bits_as<std::uint64_t>(depth), slot};
    }
    [[nodiscard]] GSH_HD static SortKey last() { return {~std::uint64_t(0), ~0u}; }
};
template <>
struct SortKey<float> {
    std::uint64_t depth_and_slot;
    [[nodiscard]] GSH_HD bool operator<(const SortKey& o) const { return depth_and_slot < o.depth_and_slot; }
    [[nodiscard]] GSH_HD static SortKey of(float depth, std::uint32_t slot) {
        return {static_cast<std::uint64_t>(bits_as<std::uint32_t>(depth)) << 32 | slot};
    }
    [[nodiscard]] GSH_HD static SortKey last() { return {~std::uint64_t(0)}; }
};
[[nodiscard]] GSH_HD inline std::uint32_t slot_of(const SortKey<float>& key) {
    return static_cast<std::uint32_t>(key.depth_and_slot);
}
[[nodiscard]] GSH_HD inline std::uint32_t slot_of(const SortKey<double>& key) {
    return key.slot;
}

/// One splat in one tile; the tile writes its share of the gradient of the splat to `slot`.
struct alignas(8) TileInstance {
    std::uint32_t splat, slot;
};

/// Sums over a tile's pixels of one splat (SlotEntry in blend_tiles_backward.cuh), three stores of 16 bytes.
template <std::floating_point T>
struct alignas(16) Slot {
    T entries[12];
};

/// What the splats of one thread block add to RasterStatus.
struct BlockCount {
    std::uint64_t pairs;
    std::uint32_t visible, nonfinite, first_nonfinite;
};

} // namespace cuda

template <std::floating_point T>
struct RasterScratch<cuda::Device, T> {
    template <class U>
    using Buffer = cuda::Buffer<U>;

    // Kept from forward to backward.
    TileGrid grid;
    Buffer<cuda::ScreenSplat<T>> splats;  // [N]
    Buffer<std::uint32_t> slot_begin;     // [N + 1] slots of a splat, in the order of its tiles
    Buffer<std::uint32_t> tile_begin;     // [tiles + 1]
    Buffer<std::uint32_t> tile_order;     // [tiles] long lists first, empty tiles last
    Buffer<std::uint32_t> blend_begin;    // [tiles + 1] further segments to blend, of the lists before
    Buffer<std::uint32_t> segment_used;   // [segments to blend] length of the part of the segment that was read
    Buffer<cuda::TileInstance> instances; // [capacity] by tile, front to back
    Buffer<std::uint32_t> used;           // [instances / 32, 16] by block: bit i is set where the splat came to it
    Buffer<T> pixels;                     // [segments to blend, channels, 256] PixelSums
    Buffer<std::uint32_t> refused;        // [1] not 0: this forward pass has no result

    // Used within one pass.
    Buffer<TileCover> covers;               // [N]
    Buffer<cuda::BlockCount> block_counts;  // [ceil(N / 128)]
    Buffer<std::uint32_t> block_begin;      // likewise: slots of the blocks before
    Buffer<std::uint32_t> counters;         // [tiles + classes] splats of a tile, tiles of a class
    Buffer<std::uint32_t> tile_end;         // [tiles] where the next entry of a list goes
    Buffer<std::uint32_t> sort_begin;       // [tiles + 1] further segments to sort, of the lists before
    Buffer<cuda::SortKey<T>> keys;          // [capacity]
    Buffer<std::uint32_t> owners;           // [capacity] splat of a slot
    Buffer<T> products;                     // [further segments to blend, 256] of (1 - alpha) of the segment before
    Buffer<cuda::Slot<T>> slots;            // [capacity]
    Buffer<vec3<T>> tile_background;        // [tiles]
    Buffer<CameraGradient<T>> block_camera; // [ceil(N / 128)]

    /// Pairs that all buffers hold, also after too little memory for one of them.
    [[nodiscard]] std::size_t capacity() const { return std::min({keys.size(), owners.size(), instances.size()}); }
    /// Makes room for `pairs`, with a quarter to spare: in training the number changes from step to step.
    void reserve(std::size_t pairs) {
        if (pairs <= capacity()) return;
        const std::size_t wanted = pairs + pairs / 4;
        keys.resize(wanted), owners.resize(wanted), instances.resize(wanted);
    }
    [[nodiscard]] cuda::detail::Segments segments_to_sort() const { return segments(sort_begin, cuda::sorted_at_once); }
    [[nodiscard]] cuda::detail::Segments segments_to_blend() const {
        return segments(blend_begin, cuda::blended_at_once);
    }
    /// First group of 32 instances of a tile in `used`: groups of different tiles never overlap.
    [[nodiscard]] GSH_HD static std::size_t group_begin(std::uint32_t tile, std::uint32_t tile_begin) {
        return tile_begin / 32 + std::size_t(tile);
    }

private:
    [[nodiscard]] cuda::detail::Segments segments(const Buffer<std::uint32_t>& begin, std::size_t size) const {
        return {tile_order, tile_begin, begin, static_cast<std::uint32_t>(size),
                static_cast<std::uint32_t>(capacity() / size)};
    }
};

} // namespace gsh
