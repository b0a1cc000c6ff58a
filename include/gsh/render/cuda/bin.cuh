// SPDX-License-Identifier: Apache-2.0
/// @file  Second stage of the rasterizer on a GPU: where each tile's list begins, and the unsorted lists.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/render/cover.hpp>
#include <gsh/render/cuda/project.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// Class of a list by its length, in steps of a quarter of an octave.
[[nodiscard]] __device__ inline unsigned tile_class(std::uint32_t length) {
    const unsigned width = 32u - static_cast<unsigned>(__clz(static_cast<int>(length)));
    const unsigned found = 4 * width + (width < 3 ? 0 : length >> (width - 3) & 3);
    return found < tile_classes ? found : tile_classes - 1;
}

/// From counts to positions. Two thread blocks: the first sums over the splats and decides whether this forward pass is
/// refused, the second sums over the tiles and orders them by the length of their lists.
///
/// Later kernels read `refused` before anything else, and do nothing unless it is 0: the lists may then be longer than
/// the buffers.
struct ScanCounts {
    static constexpr unsigned block_size = 1024;
    static constexpr unsigned warps = block_size / warp_size;
    struct Shared {
        SharedArray<std::uint64_t, warps> pairs;
        SharedArray<std::uint32_t, warps> a, b, c, d;
    };

    Span<const BlockCount> block_counts;
    Span<std::uint32_t> block_begin;
    Span<RasterStatus> status;
    Span<std::uint32_t> refused, halted; // halted is empty where the host reads the status before it goes on
    std::uint64_t max_pairs, capacity;

    Span<const std::uint32_t> tile_counts;
    Span<std::uint32_t> classes, tile_begin, tile_end, tile_order, sort_begin, blend_begin;

    __device__ void operator()(Shared& shared) const {
        if (blockIdx.x == 0)
            scan_splats(shared);
        else
            scan_tiles(shared);
    }

private:
    __device__ void scan_splats(Shared& shared) const {
        std::uint64_t pairs = 0;
        std::uint32_t visible = 0, nonfinite = 0, first = ~0u;
        for (std::size_t base = 0; base < block_counts.size(); base += block_size) {
            const std::size_t i = base + threadIdx.x;
            BlockCount count{0, 0, 0, ~0u};
            if (i < block_counts.size()) count = block_counts[i];
            std::uint64_t here;
            const std::uint64_t before = block_scan<block_size>(shared.pairs, count.pairs, here);
            if (i < block_counts.size()) block_begin[i] = static_cast<std::uint32_t>(pairs + before);
            pairs += here;
            visible += count.visible, nonfinite += count.nonfinite;
            first = count.first_nonfinite < first ? count.first_nonfinite : first;
            __syncthreads();
        }
        std::uint32_t all_visible, all_nonfinite;
        (void)block_scan<block_size>(shared.a, visible, all_visible);
        (void)block_scan<block_size>(shared.b, nonfinite, all_nonfinite);
        for (int distance = int(warp_size) / 2; distance > 0; distance /= 2) {
            const std::uint32_t other = __shfl_xor_sync(all_lanes, first, distance);
            first = other < first ? other : first;
        }
        if (threadIdx.x % warp_size == 0) shared.c[threadIdx.x / warp_size] = first;
        __syncthreads();
        if (threadIdx.x != 0) return;
        for (unsigned w = 1; w < warps; ++w) {
            const std::uint32_t other = shared.c[w];
            first = other < first ? other : first;
        }
        if (!halted.empty() && halted[0] != 0) { // by an earlier step, whose status the host still has to read
            refused[0] = 1;
            return;
        }
        RasterStatus result;
        result.pairs = pairs;
        result.visible = all_visible;
        result.nonfinite = all_nonfinite;
        result.first_nonfinite = all_nonfinite == 0 ? 0 : first;
        result.capacity = capacity;
        status[0] = result;
        const bool refuse = all_nonfinite != 0 || pairs > max_pairs || pairs > capacity;
        refused[0] = refuse;
        if (refuse && !halted.empty()) halted[0] = 1;
    }

    __device__ void scan_tiles(Shared& shared) const {
        const std::size_t tiles = tile_order.size();
        std::uint32_t entries = 0, to_sort = 0, to_blend = 0, idle = 0; // of the tiles before
        for (std::size_t base = 0; base < tiles; base += block_size) {
            const std::size_t tile = base + threadIdx.x;
            const std::uint32_t count = tile < tiles ? tile_counts[tile] : 0;
            const std::uint32_t sorts = count == 0 ? 0 : (count - 1) / sorted_at_once; // further segments
            const std::uint32_t blends = count == 0 ? 0 : (count - 1) / blended_at_once;
            const std::uint32_t empty = tile < tiles && count == 0;
            std::uint32_t all_entries, all_sorts, all_blends, all_empty;
            const std::uint32_t begin = entries + block_scan<block_size>(shared.a, count, all_entries);
            const std::uint32_t first_sort = to_sort + block_scan<block_size>(shared.b, sorts, all_sorts);
            const std::uint32_t first_blend = to_blend + block_scan<block_size>(shared.d, blends, all_blends);
            const std::uint32_t before = idle + block_scan<block_size>(shared.c, empty, all_empty);
            if (tile < tiles) {
                tile_begin[tile] = tile_end[tile] = begin;
                sort_begin[tile] = first_sort, blend_begin[tile] = first_blend;
            }
            if (empty != 0) tile_order[tiles - 1 - before] = static_cast<std::uint32_t>(tile);
            if (count != 0) atomicAdd(&classes[tile_class(count)], 1u);
            entries += all_entries, to_sort += all_sorts, to_blend += all_blends, idle += all_empty;
            __syncthreads();
        }
        if (threadIdx.x == 0) tile_begin[tiles] = entries, sort_begin[tiles] = to_sort, blend_begin[tiles] = to_blend;

        // Where the classes begin, long lists first. Tiles of one class may come in any order.
        const bool mine = threadIdx.x < tile_classes;
        const unsigned place = tile_classes - 1 - threadIdx.x;
        std::uint32_t active;
        const std::uint32_t start = block_scan<block_size>(shared.a, mine ? classes[place] : 0u, active);
        if (mine) classes[place] = start;
        __syncthreads();
        for (std::size_t tile = threadIdx.x; tile < tiles; tile += block_size)
            if (const std::uint32_t count = tile_counts[tile]; count != 0)
                tile_order[atomicAdd(&classes[tile_class(count)], 1u)] = static_cast<std::uint32_t>(tile);
    }
};

/// Writes a splat's keys to the ends of the lists.
template <std::floating_point T>
struct AppendKey {
    Span<std::uint32_t> tile_end;
    Span<SortKey<T>> keys;
    Span<std::uint32_t> owners;
    T depth;
    std::uint32_t splat, slot_begin;

    __device__ void operator()(std::uint32_t tile, std::uint32_t k) const { put(atomicAdd(&tile_end[tile], 1u), k); }
    __device__ void together(std::uint32_t tile, std::uint32_t k) const {
        const std::uint32_t place = add_one(tile_end, tile);
        if (tile != no_tile) put(place, k);
    }
    [[nodiscard]] __device__ AppendKey of_lane(int lane) const {
        return {tile_end,
                keys,
                owners,
                __shfl_sync(all_lanes, depth, lane),
                __shfl_sync(all_lanes, splat, lane),
                __shfl_sync(all_lanes, slot_begin, lane)};
    }

private:
    __device__ void put(std::uint32_t place, std::uint32_t k) const {
        const std::uint32_t slot = slot_begin + k;
        keys[place] = SortKey<T>::of(depth, slot);
        owners[slot] = splat;
    }
};

/// One thread per splat: writes a key to the list of each of its tiles. The order within a list depends on the order of
/// the threads, but no two keys are equal, so the sorted lists do not.
template <std::floating_point T>
struct DistributeSplats {
    static constexpr unsigned block_size = splats_of_block;

    Span<const std::uint32_t> refused;
    Span<const ScreenSplat<T>> screen;
    Span<const TileCover> covers;
    TileGrid grid;
    Span<const std::uint32_t> block_begin;
    Span<const RasterStatus> status;
    Span<std::uint32_t> slot_begin, tile_end;
    Span<SortKey<T>> keys;
    Span<std::uint32_t> owners;

    __device__ void operator()() const {
        if (refused[0] != 0) return;
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        TileCover cover;
        ScreenSplat<T> splat{};
        std::uint32_t begin = 0;
        if (i < covers.size()) {
            begin = slot_begin[i] + block_begin[blockIdx.x];
            slot_begin[i] = begin;
            if (i + 1 == covers.size()) slot_begin[i + 1] = static_cast<std::uint32_t>(status[0].pairs);
            cover = covers[i];
            if (!fits_mask(cover))
                splat = screen[i];
            else if (cover.mask != 0)
                splat.depth = screen[i].depth;
        }
        const AppendKey<T> append{tile_end, keys, owners, splat.depth, static_cast<std::uint32_t>(i), begin};
        (void)visit_tiles(ellipse_of(splat), cover, grid, append);
    }
};

} // namespace gsh::cuda::detail
