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

    const auto for_each_pair = [&](std::size_t begin, std::size_t end, const auto& visit) {
        constexpr std::size_t ahead = 32; // in depth order, the covers are scattered in memory
        for (std::size_t i = begin; i < end; ++i) {
            if (i + ahead < end) {
                const std::uint32_t later = order[i + ahead].splat;
                prefetch(&scratch.covers[later]), prefetch(&scratch.pair_begin[later]);
            }
            const std::uint32_t splat = order[i].splat;
            std::uint32_t pair = scratch.pair_begin[splat];
            detail::for_each_tile(scratch.splats[splat], scratch.covers[splat], scratch.grid,
                                  [&](std::uint32_t tile) { visit(tile, splat, pair++); });
        }
    };
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        std::uint32_t* const count = counts.data() + chunk * tiles;
        std::fill(count, count + tiles, 0u);
        for_each_pair(begin, end, [&](std::uint32_t tile, std::uint32_t, std::uint32_t) { ++count[tile]; });
    });
    std::uint32_t sum = 0; // counts become start positions: by tile, then by chunk
    for (std::size_t tile = 0; tile < tiles; ++tile) {
        scratch.tile_begin[tile] = sum;
        for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
            std::uint32_t& place = counts[chunk * tiles + tile];
            const std::uint32_t count = place;
            place = sum;
            sum += count;
        }
    }
    scratch.tile_begin[tiles] = sum;
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        std::uint32_t* const place = counts.data() + chunk * tiles;
        for_each_pair(begin, end, [&](std::uint32_t tile, std::uint32_t splat, std::uint32_t pair) {
            const std::uint32_t to = place[tile]++;
            scratch.instances[to] = splat;
            scratch.pair_places[pair] = to;
        });
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
