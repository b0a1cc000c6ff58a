// SPDX-License-Identifier: Apache-2.0
/// @file  Tile lists on the CPU: splats are sorted by depth, then distributed to their tiles in that order.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/cpu/radix_sort.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Calls visit(tile) for each tile of a splat, by rows.
template <std::floating_point T, class Visit>
void for_each_tile(const ScreenSplat<T>& splat, const TileCover& cover, const TileGrid& grid, const Visit& visit) {
    const auto tile = [columns = static_cast<std::uint32_t>(grid.columns())](int x, int y) {
        return static_cast<std::uint32_t>(y) * columns + static_cast<std::uint32_t>(x);
    };
    if (cover.mask != 0) {
        std::uint64_t bits = cover.mask;
        do {
            const int bit = std::countr_zero(bits);
            visit(tile(cover.x0 + (bit & 7), cover.y0 + (bit >> 3)));
            bits &= bits - 1;
        } while (bits != 0);
        return;
    }
    const Ellipse<double> ellipse = ellipse_of(splat);
    for (int y = cover.y0; y < cover.y0 + cover.rows; ++y) {
        int first, end;
        cover_columns(ellipse, cover, y, grid, first, end);
        for (int x = first; x < end; ++x) visit(tile(x, y));
    }
}

/// Writes the records of the pairs of the splats [begin, end) of the order; returns the end of them.
///
/// Most covers have few tiles, of unpredictable number. So four are decoded at a time, whether there are so many or
/// not; the next splat's records overwrite those that are too many.
template <CpuBackend B, std::floating_point T, class Item>
[[nodiscard]] PairRecord* decode_covers(const RasterScratch<B, T>& scratch, Span<const Item> order, std::size_t begin,
                                        std::size_t end, PairRecord* record) {
    constexpr std::size_t ahead = 32; // in depth order, the covers are scattered in memory
    constexpr int at_a_time = 4;
    const auto columns = static_cast<std::uint32_t>(scratch.grid.columns());
    for (std::size_t i = begin; i < end; ++i) {
        if (i + ahead < end) {
            const std::uint32_t later = order[i + ahead].splat;
            prefetch(&scratch.covers[later]), prefetch(&scratch.pair_begin[later]);
        }
        const std::uint32_t splat = order[i].splat;
        const TileCover& cover = scratch.covers[splat];
        std::uint32_t pair = scratch.pair_begin[splat];
        if (cover.mask == 0 || end - i < at_a_time) {
            for_each_tile(scratch.splats[splat], cover, scratch.grid,
                          [&](std::uint32_t tile) { *record++ = {tile, splat, pair++}; });
            continue;
        }
        const std::uint32_t corner = cover.y0 * columns + cover.x0;
        std::uint64_t bits = cover.mask;
        PairRecord* const after = record + std::popcount(bits);
        while (bits != 0)
            for (int k = 0; k < at_a_time; ++k) {
                const auto bit = static_cast<std::uint32_t>(std::countr_zero(bits)); // 64 if there is none left
                record->tile = corner + (bit >> 3) * columns + (bit & 7), record->splat = splat, record->pair = pair++;
                ++record;
                bits &= bits - 1;
            }
        record = after;
    }
    return record;
}

} // namespace detail

/// Second stage: sorts front to back, ties by index.
template <CpuBackend B, std::floating_point T>
[[nodiscard]] auto sort_by_depth(B& backend, RasterCache<B, T>& cache) {
    using Item = SortItem<typename RasterScratch<B, T>::Key>;
    RasterScratch<B, T>& scratch = cache.scratch;
    const std::size_t visible = cache.status[0].visible;
    return radix_sort(backend, Span<Item>(scratch.items.data(), visible),
                      Span<Item>(scratch.items_scratch.data(), visible), scratch.histograms);
}

/// Third stage: a stable counting sort of (splat, tile) pairs by tile, and the order in which the tiles are processed.
template <CpuBackend B, std::floating_point T, class Item>
void bin_splats(B& backend, Span<Item> order, RasterCache<B, T>& cache) {
    RasterScratch<B, T>& scratch = cache.scratch;
    const std::size_t n = order.size(), tiles = scratch.grid.size();
    const std::size_t grain = std::max<std::size_t>(4096, (n + 31) / 32), chunks = chunk_count(n, grain);
    scratch.instances.resize(cache.status[0].pairs);
    scratch.pair_places.resize(cache.status[0].pairs);
    scratch.tile_begin.resize(tiles + 1);
    scratch.tile_order.resize(tiles);
    scratch.tile_used.resize(tiles);
    scratch.histograms.resize(chunks * tiles);
    const Span<std::uint32_t> counts = scratch.histograms;

    // Each splat's cover is decoded once, into records of its pairs in depth order.
    scratch.chunk_pairs.resize(chunks);
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        std::uint32_t pairs = 0;
        for (std::size_t i = begin; i < end; ++i)
            pairs += scratch.pair_begin[order[i].splat + 1] - scratch.pair_begin[order[i].splat];
        scratch.chunk_pairs[chunk] = pairs;
    });
    std::uint32_t sum = 0;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) sum += std::exchange(scratch.chunk_pairs[chunk], sum);
    scratch.records.resize(sum);
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        detail::PairRecord* const first = scratch.records.data() + scratch.chunk_pairs[chunk];
        detail::PairRecord* const last = detail::decode_covers(scratch, Span<const Item>(order), begin, end, first);
        std::uint32_t* const count = counts.data() + chunk * tiles;
        std::fill(count, count + tiles, 0u);
        for (const detail::PairRecord* record = first; record != last; ++record) ++count[record->tile];
    });
    // Counts become start positions: by tile, then by chunk. All loops go over contiguous numbers.
    std::uint32_t* const next = scratch.tile_order.data(); // used for this before it gets its own numbers
    std::fill(next, next + tiles, 0u);
    for (std::size_t chunk = 0; chunk < chunks; ++chunk)
        for (std::size_t tile = 0; tile < tiles; ++tile) next[tile] += counts[chunk * tiles + tile];
    sum = 0;
    for (std::size_t tile = 0; tile < tiles; ++tile) {
        scratch.tile_begin[tile] = sum;
        sum += std::exchange(next[tile], sum);
    }
    for (std::size_t chunk = 0; chunk < chunks; ++chunk)
        for (std::size_t tile = 0; tile < tiles; ++tile) {
            std::uint32_t& place = counts[chunk * tiles + tile];
            const std::uint32_t count = place;
            place = next[tile];
            next[tile] += count;
        }
    scratch.tile_begin[tiles] = sum;
    backend.for_chunks(chunks, 1, [&](std::size_t chunk, std::size_t, std::size_t) {
        std::uint32_t* const place = counts.data() + chunk * tiles;
        const std::size_t end = chunk + 1 < chunks ? scratch.chunk_pairs[chunk + 1] : sum;
        for (std::size_t i = scratch.chunk_pairs[chunk]; i < end; ++i) {
            constexpr std::size_t ahead = 16;
            if (i + ahead < end) prefetch_for_write(&scratch.pair_places[scratch.records[i + ahead].pair]);
            const detail::PairRecord& record = scratch.records[i];
            const std::uint32_t to = place[record.tile]++;
            scratch.instances[to] = record.splat;
            scratch.pair_places[record.pair] = to;
        }
    });

    // Long lists come first, in classes of powers of two. The last tasks are then small, and all threads finish at
    // about the same time.
    constexpr int classes = 33;
    std::uint32_t start[classes + 1] = {};
    const auto class_of = [&](std::size_t tile) {
        return classes - 1 - std::bit_width(scratch.tile_begin[tile + 1] - scratch.tile_begin[tile]);
    };
    for (std::size_t tile = 0; tile < tiles; ++tile) ++start[class_of(tile) + 1];
    for (int c = 0; c < classes; ++c) start[c + 1] += start[c];
    scratch.active_tiles = start[classes - 1];
    for (std::size_t tile = 0; tile < tiles; ++tile)
        scratch.tile_order[start[class_of(tile)]++] = static_cast<std::uint32_t>(tile);
}

} // namespace gsh::cpu
