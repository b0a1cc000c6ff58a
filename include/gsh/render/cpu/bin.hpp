// SPDX-License-Identifier: Apache-2.0
/// @file  From splats to tile lists on the CPU: project, sort by depth, distribute in that order.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/cpu/radix_sort.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cpu {

namespace detail {

inline constexpr std::size_t splat_grain = 1024; // splats of one chunk of the per-splat passes

/// Tiles are chosen a little too generously, so that rounding never loses a pixel to which the blend gives a say.
[[nodiscard]] constexpr double generous(double cut) { return cut * 1.0001 + 1e-3; }

template <std::floating_point T>
[[nodiscard]] Ellipse<double> ellipse_of(const ScreenSplat<T>& s) {
    return {s.center.x, s.center.y, s.w, generous(s.cut)};
}

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
        tile_columns(ellipse, y, grid, first, end);
        for (int x = first; x < end; ++x) visit(tile(x, y));
    }
}

/// The tiles that the ellipse touches of the rectangle that holds it; returns their number.
template <std::floating_point T>
[[nodiscard]] std::uint32_t cover_tiles(const ScreenSplat<T>& splat, const TileRect& rect, const TileGrid& grid,
                                        TileCover& cover) {
    const int columns = rect.x1 - rect.x0, rows = rect.y1 - rect.y0;
    cover = {0, static_cast<std::uint16_t>(rect.x0), static_cast<std::uint16_t>(rect.y0),
             static_cast<std::uint16_t>(columns), static_cast<std::uint16_t>(rows)};
    const bool small = columns <= 8 && rows <= 8;
    if (small && (columns == 1 || rows == 1)) { // the bounding box touches the ellipse on every side: nothing to spare
        constexpr std::uint64_t first_column = 0x0101010101010101ull;
        cover.mask = ((1ull << columns) - 1) * (first_column >> (64 - 8 * rows));
        return static_cast<std::uint32_t>(columns * rows);
    }
    const Ellipse<double> ellipse = ellipse_of(splat);
    std::uint32_t count = 0;
    for (int y = rect.y0; y < rect.y1; ++y) {
        int first, end;
        tile_columns(ellipse, y, grid, first, end);
        if (first >= end) continue;
        count += static_cast<std::uint32_t>(end - first);
        if (small) cover.mask |= ((1ull << (end - first)) - 1) << (8 * (y - rect.y0) + first - rect.x0);
    }
    return count;
}

/// Projects one splat; returns the rectangle of its tiles, empty if it is culled.
template <std::floating_point T>
[[nodiscard]] TileRect project_splat(const Camera<double>& camera, const SplatView<const T>& splats, std::size_t i,
                                     const RasterParams<T>& params, const ProjectionParams<double>& projection_params,
                                     const TileGrid& grid, ScreenSplat<T>& out) {
    const sym3<T>& s = splats.covariances[i];
    const sym3<double> covariance{s.xx, s.xy, s.xz, s.yy, s.yz, s.zz};
    const Projection<double> p = project(camera, vec3<double>(splats.means[i]), covariance, projection_params);
    const T opacity = static_cast<T>(splats.opacities[i] * p.opacity_factor);
    const double det = determinant(p.covariance);
    const double largest = std::numeric_limits<double>::max();
    const bool kept = p.in_front && opacity >= params.alpha_min && p.covariance.xx > 0 && p.covariance.yy > 0 &&
                      det > 0 && det <= largest && std::abs(p.center.x) <= largest && std::abs(p.center.y) <= largest;
    if (!kept) return {};
    constexpr T far = sizeof(T) == 4 ? T(120) : T(1000); // where exp2_minus ends; an opacity up to 1 does not get there
    out = {p.center, whiten(p.covariance), opacity, static_cast<T>(p.depth), splats.colors[i],
           std::min(far, std::log2(opacity / params.alpha_min))};
    return tile_rect(ellipse_of(out), p.covariance, grid);
}

/// NaN if x is NaN or infinite, else 0.
template <std::floating_point T>
[[nodiscard]] T nonfinite(T x) {
    return x * T(0);
}

template <std::floating_point T>
[[nodiscard]] bool is_finite(const SplatView<const T>& splats, std::size_t i) {
    const vec3<T>&m = splats.means[i], &c = splats.colors[i];
    const sym3<T>& s = splats.covariances[i];
    const T sum = nonfinite(m.x) + nonfinite(m.y) + nonfinite(m.z) + nonfinite(c.x) + nonfinite(c.y) +
                  nonfinite(c.z) + nonfinite(s.xx) + nonfinite(s.xy) + nonfinite(s.xz) + nonfinite(s.yy) +
                  nonfinite(s.yz) + nonfinite(s.zz) + nonfinite(splats.opacities[i]);
    return sum == T(0);
}

} // namespace detail

/// First stage: screen splats, their tiles, their gradient slots, and the visible ones as sort items.
/// Returns false, having reported why in cache.status, if there is something to refuse.
template <CpuBackend B, std::floating_point T>
[[nodiscard]] bool project_splats(B& backend, const Camera<T>& camera, const SplatView<const T>& splats,
                                  const RasterParams<T>& params, RasterCache<B, T>& cache) {
    using Key = typename RasterCache<B, T>::Key;
    const std::size_t n = splats.size(), chunks = chunk_count(n, detail::splat_grain);
    cache.splat_count = n;
    cache.grid = {camera.width, camera.height};
    cache.status.resize(1);
    cache.visible.resize(n);
    cache.splats.resize(n);
    cache.covers.resize(n);
    cache.slot_begin.resize(n + 1);
    cache.items.resize(n);
    cache.items_scratch.resize(n);
    cache.chunk_status.resize(chunks);

    const Camera<double> wide_camera = camera.template cast<double>();
    const ProjectionParams<double> projection_params = params.template cast<double>();
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        RasterStatus status;
        // First the arithmetic for some splats, then what forks on its results: a wrong guess does not wait for it.
        constexpr std::size_t stage = 64;
        TileRect rects[stage];
        for (std::size_t first = begin; first < end; first += stage) {
            const std::size_t count = std::min(stage, end - first);
            for (std::size_t k = 0; k < count; ++k)
                rects[k] = detail::is_finite(splats, first + k)
                               ? detail::project_splat(wide_camera, splats, first + k, params, projection_params,
                                                       cache.grid, cache.splats[first + k])
                               : TileRect{-1, 0, -1, 0};
            for (std::size_t k = 0; k < count; ++k) {
                const std::size_t i = first + k;
                const TileRect& rect = rects[k];
                std::uint32_t tiles = 0;
                if (!rect.empty())
                    tiles = detail::cover_tiles(cache.splats[i], rect, cache.grid, cache.covers[i]);
                else if (rect.x0 < 0 && status.nonfinite++ == 0)
                    status.first_nonfinite = static_cast<std::uint32_t>(i);
                cache.visible[i] = tiles != 0;
                cache.slot_begin[i] = static_cast<std::uint32_t>(status.pairs);
                status.pairs += tiles;
                if (tiles == 0) continue;
                const Key key = std::bit_cast<Key>(cache.splats[i].depth); // positive floats sort like their bits
                cache.items_scratch[begin + status.visible++] = {key, static_cast<std::uint32_t>(i)};
            }
        }
        cache.chunk_status[chunk] = status;
    });

    RasterStatus total;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
        RasterStatus& status = cache.chunk_status[chunk];
        if (total.nonfinite == 0) total.first_nonfinite = status.first_nonfinite;
        total.nonfinite += status.nonfinite;
        const RasterStatus here = status;
        status.pairs = total.pairs, status.visible = total.visible; // now: what came before
        total.pairs += here.pairs, total.visible += here.visible;
    }
    cache.status[0] = total;
    if (total.nonfinite != 0 || total.pairs > params.max_pairs) {
        cache.splat_count = 0, cache.grid = {}; // so that backward does not mistake it for a forward pass
        return false;
    }

    cache.slot_begin[n] = static_cast<std::uint32_t>(total.pairs);
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const RasterStatus& before = cache.chunk_status[chunk];
        const auto base = static_cast<std::uint32_t>(before.pairs);
        for (std::size_t i = begin; i < end; ++i) cache.slot_begin[i] += base;
        const std::size_t next = chunk + 1 < chunks ? cache.chunk_status[chunk + 1].visible : total.visible;
        std::copy_n(cache.items_scratch.data() + begin, next - before.visible, cache.items.data() + before.visible);
    });
    return true;
}

/// Second stage: front to back, ties by index.
template <CpuBackend B, std::floating_point T>
[[nodiscard]] auto sort_by_depth(B& backend, RasterCache<B, T>& cache) {
    using Item = SortItem<typename RasterCache<B, T>::Key>;
    const std::size_t visible = cache.status[0].visible;
    return radix_sort(backend, Span<Item>(cache.items.data(), visible),
                      Span<Item>(cache.items_scratch.data(), visible), cache.histograms);
}

/// Third stage: a stable counting sort of (splat, tile) pairs by tile, and the order in which to work on the tiles.
template <CpuBackend B, std::floating_point T, class Item>
void bin_splats(B& backend, Span<Item> order, RasterCache<B, T>& cache) {
    const std::size_t n = order.size(), tiles = cache.grid.size();
    const std::size_t grain = std::max<std::size_t>(4096, (n + 31) / 32), chunks = chunk_count(n, grain);
    cache.instances.resize(cache.status[0].pairs);
    cache.tile_begin.resize(tiles + 1);
    cache.tile_order.resize(tiles);
    cache.tile_used.resize(tiles);
    cache.histograms.resize(chunks * tiles);
    const Span<std::uint32_t> counts = cache.histograms;

    // Covers lie all over memory in this order. Fetched some at a time by a loop without branches, the waits overlap.
    const auto for_each_pair = [&](std::size_t begin, std::size_t end, const auto& visit) {
        constexpr std::size_t stage = 64;
        TileCover covers[stage];
        std::uint32_t slots[stage];
        for (std::size_t first = begin; first < end; first += stage) {
            const std::size_t count = std::min(stage, end - first);
            for (std::size_t i = 0; i < count; ++i) {
                const std::uint32_t splat = order[first + i].splat;
                covers[i] = cache.covers[splat];
                slots[i] = cache.slot_begin[splat];
            }
            for (std::size_t i = 0; i < count; ++i) {
                const std::uint32_t splat = order[first + i].splat;
                std::uint32_t slot = slots[i];
                detail::for_each_tile(cache.splats[splat], covers[i], cache.grid,
                                      [&](std::uint32_t tile) { visit(tile, TileInstance{splat, slot++}); });
            }
        }
    };
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        std::uint32_t* const count = counts.data() + chunk * tiles;
        std::fill(count, count + tiles, 0u);
        for_each_pair(begin, end, [&](std::uint32_t tile, TileInstance) { ++count[tile]; });
    });
    std::uint32_t sum = 0; // counts become places: by tile, then by chunk
    for (std::size_t tile = 0; tile < tiles; ++tile) {
        cache.tile_begin[tile] = sum;
        for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
            std::uint32_t& place = counts[chunk * tiles + tile];
            const std::uint32_t count = place;
            place = sum;
            sum += count;
        }
    }
    cache.tile_begin[tiles] = sum;
    backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        std::uint32_t* const place = counts.data() + chunk * tiles;
        for_each_pair(begin, end,
                      [&](std::uint32_t tile, TileInstance instance) { cache.instances[place[tile]++] = instance; });
    });

    // Long lists first, in classes of powers of two: what is left for the end is small, and the threads finish together.
    constexpr int classes = 33;
    std::uint32_t start[classes + 1] = {};
    const auto class_of = [&](std::size_t tile) {
        return classes - 1 - std::bit_width(cache.tile_begin[tile + 1] - cache.tile_begin[tile]);
    };
    for (std::size_t tile = 0; tile < tiles; ++tile) ++start[class_of(tile) + 1];
    for (int c = 0; c < classes; ++c) start[c + 1] += start[c];
    cache.active_tiles = start[classes - 1];
    for (std::size_t tile = 0; tile < tiles; ++tile)
        cache.tile_order[start[class_of(tile)]++] = static_cast<std::uint32_t>(tile);
}

} // namespace gsh::cpu
