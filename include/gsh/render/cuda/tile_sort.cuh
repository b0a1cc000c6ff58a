// SPDX-License-Identifier: Apache-2.0
/// @file  Third stage of the rasterizer on a GPU: each tile's list is sorted front to back.
///
/// One thread block sorts a list in shared memory. A list of a person has a thousand entries, so this takes one launch
/// and reads and writes each entry once. A radix sort of all splats by depth, followed by a stable distribution to
/// tiles, takes at least six passes over global memory. Keys are unique, so no sort has to be stable, and the result
/// depends on nothing but the keys.
///
/// A list that does not fit is sorted in segments. A second kernel then finds the place of each entry by searching the
/// other segments. Its work grows with the square of a list's length, but slowly: 20,000 entries of one tile take eight
/// searches each.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/cuda/segments.cuh>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// Merge sort of one segment of a list: nine entries per thread, then pairs of runs, of which each thread merges the
/// part that it writes. Nine is odd, so the lanes of a warp read different banks.
template <std::floating_point T>
struct SortTiles {
    static constexpr unsigned block_size = 256;
    static constexpr unsigned items = sorted_at_once / block_size;
    static_assert(items % 2 == 1 && items * block_size == sorted_at_once);
    using Key = SortKey<T>;
    struct Shared {
        SharedArray<Key, sorted_at_once> keys;
    };

    Span<const std::uint32_t> refused;
    Segments segments;
    Span<Key> keys;
    Span<const std::uint32_t> owners;
    Span<TileInstance> instances;

    __device__ void operator()(Shared& shared) const {
        Segment segment;
        if (refused[0] != 0 || !segments.find(blockIdx.x, segment)) return;
        const std::uint32_t begin = segment.list + segment.from, n = segment.to - segment.from;
        for (std::uint32_t i = threadIdx.x; i < n; i += block_size) shared.keys[i] = keys[begin + i];
        __syncthreads();
        sort(shared, n);
        const bool alone = segment.length <= sorted_at_once;
        for (std::uint32_t i = threadIdx.x; i < n; i += block_size) {
            const Key key = shared.keys[i];
            if (alone) {
                const std::uint32_t slot = slot_of(key);
                instances[begin + i] = {owners[slot], slot};
            } else {
                keys[begin + i] = key;
            }
        }
    }

private:
    __device__ static void sort(Shared& shared, std::uint32_t n) {
        const std::uint32_t first = threadIdx.x * items;
        Key mine[items];
        for (unsigned k = 0; k < items; ++k) mine[k] = at(shared, first + k, n);
        for (unsigned round = 0; round < items; ++round)
            for (unsigned k = round % 2; k + 1 < items; k += 2) {
                const Key a = mine[k], b = mine[k + 1];
                const bool swap = b < a;
                mine[k] = swap ? b : a, mine[k + 1] = swap ? a : b;
            }
        store(shared, mine, first, n);
        __syncthreads();
        for (std::uint32_t width = items; width < n; width *= 2) {
            if (first < n) merge(shared, mine, first, width, n);
            __syncthreads();
            store(shared, mine, first, n);
            __syncthreads();
        }
    }

    /// Of the two runs of `width` keys around `first`, the keys that come first, first + 1, … when they are merged.
    __device__ static void merge(Shared& shared, Key (&mine)[items], std::uint32_t first, std::uint32_t width,
                                 std::uint32_t n) {
        const std::uint32_t start = first / (2 * width) * (2 * width);
        const std::uint32_t middle = start + width < n ? start + width : n;
        const std::uint32_t end = start + 2 * width < n ? start + 2 * width : n;
        const std::uint32_t before = first - start, in_b = end - middle; // `before` keys are written by threads before
        std::uint32_t low = before < in_b ? 0 : before - in_b;           // so many of them are from the first run
        std::uint32_t high = before < middle - start ? before : middle - start;
        while (low < high) {
            const std::uint32_t half = (low + high) / 2;
            const Key a = shared.keys[start + half], b = shared.keys[middle + before - 1 - half];
            if (b < a)
                high = half;
            else
                low = half + 1;
        }
        std::uint32_t i = start + low, j = middle + before - low;
        Key a = at(shared, i, middle), b = at(shared, j, end);
        for (unsigned k = 0; k < items; ++k) {
            const bool second = b < a;
            mine[k] = second ? b : a;
            if (second)
                b = at(shared, ++j, end);
            else
                a = at(shared, ++i, middle);
        }
    }

    [[nodiscard]] __device__ static Key at(Shared& shared, std::uint32_t i, std::uint32_t end) {
        if (i >= end) return Key::last();
        return shared.keys[i];
    }
    __device__ static void store(Shared& shared, const Key (&mine)[items], std::uint32_t first, std::uint32_t n) {
        for (unsigned k = 0; k < items; ++k)
            if (first + k < n) shared.keys[first + k] = mine[k];
    }
};

/// Joins the sorted segments of long lists: each thread finds the place of one entry. The thread blocks of a list's
/// second segment take its first, too.
template <std::floating_point T>
struct MergeTiles {
    static constexpr unsigned block_size = 256;
    static constexpr unsigned blocks_of_segment = sorted_at_once / block_size;

    Span<const std::uint32_t> refused;
    Segments segments;
    Span<const SortKey<T>> keys;
    Span<const std::uint32_t> owners;
    Span<TileInstance> instances;

    __device__ void operator()() const {
        Segment segment;
        if (refused[0] != 0 || !segments.find(blockIdx.x / blocks_of_segment, segment)) return;
        const std::uint32_t from = segment.number == 1 ? 0 : segment.from;
        const std::uint32_t list_end = segment.list + segment.length;
        for (std::uint32_t i = from + blockIdx.x % blocks_of_segment * block_size + threadIdx.x; i < segment.to;
             i += sorted_at_once) {
            const SortKey<T> key = keys[segment.list + i];
            const std::uint32_t own = i / sorted_at_once * sorted_at_once;
            std::uint32_t rank = i - own;
            for (std::uint32_t other = 0; other < segment.length; other += sorted_at_once)
                if (other != own) rank += smaller(key, segment.list + other, list_end);
            const std::uint32_t slot = slot_of(key);
            instances[segment.list + rank] = {owners[slot], slot};
        }
    }

private:
    /// The number of keys below `key` in the segment that begins at `first`.
    [[nodiscard]] __device__ std::uint32_t smaller(const SortKey<T>& key, std::uint32_t first,
                                                   std::uint32_t list_end) const {
        std::uint32_t low = first;
        std::uint32_t high = list_end - first < sorted_at_once ? list_end : first + sorted_at_once;
        while (low < high) {
            const std::uint32_t middle = low + (high - low) / 2;
            const SortKey<T> other = keys[middle];
            if (other < key)
                low = middle + 1;
            else
                high = middle;
        }
        return low - first;
    }
};

} // namespace gsh::cuda::detail
