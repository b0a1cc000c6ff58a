// SPDX-License-Identifier: Apache-2.0
/// @file  Lists of tiles in segments: one thread block's share of a list, to sort or to blend.
///
/// Lists differ in length by a factor of hundreds. At the start of a training, a tile on a hand of a person at 540x540
/// has 19,000 of 250,000 entries, and the median tile 600. If a thread block took a whole list, the GPU would wait for
/// that of the longest one.
#pragma once

#include <gsh/backend/cuda/device.cuh>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// A segment of a tile's list.
struct Segment {
    std::uint32_t tile;
    std::uint32_t number;   // among those of its list
    std::uint32_t place;    // among all: that of a list's first segment is the tile, further ones follow
    std::uint32_t list;     // where its list begins
    std::uint32_t length;   // of the list
    std::uint32_t from, to; // its entries, counted from the beginning of the list
};

/// The segments of all lists, each the work of one thread block: further segments of long lists, then the first segment
/// of each list, long lists first.
struct Segments {
    Span<const std::uint32_t> tile_order, tile_begin;
    Span<const std::uint32_t> further_begin; // [tiles + 1] further segments of the lists before
    std::uint32_t size;                      // entries of a segment, but for the last of a list
    std::uint32_t further;                   // thread blocks for further segments, at least as many as there are

    [[nodiscard]] std::size_t blocks() const { return further + tile_order.size(); }

    /// The segment of a thread block, or false if there is none.
    [[nodiscard]] __device__ bool find(std::uint32_t block, Segment& segment) const {
        const auto tiles = static_cast<std::uint32_t>(tile_order.size());
        if (block < further) {
            if (block >= further_begin[tiles]) return false;
            segment.tile = tile_of(block);
            segment.number = block - further_begin[segment.tile] + 1;
            segment.place = tiles + block;
        } else {
            segment.tile = segment.place = tile_order[block - further];
            segment.number = 0;
        }
        segment.list = tile_begin[segment.tile];
        segment.length = tile_begin[segment.tile + 1] - segment.list;
        segment.from = segment.number * size;
        segment.to = segment.length - segment.from < size ? segment.length : segment.from + size;
        return true;
    }

private:
    /// The tile of a further segment: the last one of which further segments begin there or before.
    [[nodiscard]] __device__ std::uint32_t tile_of(std::uint32_t block) const {
        std::size_t low = 0, high = further_begin.size() - 1; // further_begin[low] <= block < further_begin[high]
        while (high - low > 1) {
            const std::size_t middle = (low + high) / 2;
            if (further_begin[middle] <= block)
                low = middle;
            else
                high = middle;
        }
        return static_cast<std::uint32_t>(low);
    }
};

} // namespace gsh::cuda::detail
