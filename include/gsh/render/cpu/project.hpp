// SPDX-License-Identifier: Apache-2.0
/// @file  First stage of the rasterizer on the CPU: projected splats, and the tiles that they touch.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cpu/arithmetic.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

inline constexpr std::size_t splat_grain = 1024; // number of splats in one chunk of the per-splat passes

using gsh::detail::cover_columns;
using gsh::detail::generous;

template <std::floating_point T>
[[nodiscard]] Ellipse<double> ellipse_of(const ScreenSplat<T>& s) {
    return {s.mean2d.x, s.mean2d.y, s.w, generous(static_cast<double>(s.cut))};
}

/// The tiles of a rectangle that the ellipse inside it touches; returns their number.
template <std::floating_point T>
[[nodiscard]] std::uint32_t cover_tiles(const ScreenSplat<T>& splat, const TileRect& rect, const TileGrid& grid,
                                        TileCover& cover) {
    cover = gsh::detail::cover_of(rect);
    const Ellipse<double> ellipse = ellipse_of(splat);
    if (gsh::detail::fits_mask(cover)) return gsh::detail::set_mask(ellipse, grid, cover);
    std::uint32_t count = 0;
    for (int y = rect.y0; y < rect.y1; ++y) {
        int first, end;
        cover_columns(ellipse, cover, y, grid, first, end);
        count += static_cast<std::uint32_t>(end - first);
    }
    return count;
}

/// A batch of splats, member by member and in double, so that their projection is a loop over plain arrays.
struct ProjectionBatch {
    static constexpr std::size_t size = 64;
    alignas(64) double mean_x[size], mean_y[size], mean_z[size];
    alignas(64) double xx[size], xy[size], xz[size], yy[size], yz[size], zz[size];
    alignas(64) double opacity[size], cut[size]; // input; the opacity that is output is compensated
    alignas(64) double nonfinite[size];          // 0, or NaN
    alignas(64) double x[size], y[size], depth[size], ux[size], uy[size], vy[size]; // out
    alignas(64) double half_width[size], half_height[size]; // of the bounding box; negative if the splat is culled
    alignas(64) int x0[size], y0[size], x1[size], y1[size]; // out: rectangle of tiles, empty if the splat is culled

    template <std::floating_point T>
    void load(const SplatView<const T>& splats, std::size_t first, std::size_t count, T alpha_min) {
        for (std::size_t k = 0; k < count; ++k) {
            const vec3<T>&m = splats.means[first + k], &c = splats.colors[first + k];
            const sym3<T>& s = splats.covariances[first + k];
            const T alpha = splats.opacities[first + k];
            mean_x[k] = m.x, mean_y[k] = m.y, mean_z[k] = m.z;
            xx[k] = s.xx, xy[k] = s.xy, xz[k] = s.xz, yy[k] = s.yy, yz[k] = s.yz, zz[k] = s.zz;
            opacity[k] = alpha;
            cut[k] = std::log2(alpha / alpha_min);
            nonfinite[k] = static_cast<double>(c.x * T(0) + c.y * T(0) + c.z * T(0)); // finite: 0, else NaN
        }
    }

    /// Compensate is known at compile time, since the square root that it needs keeps the loop from being vectorised.
    template <bool Compensate>
    void project(const Camera<double>& camera, ProjectionParams<double> params, const TileGrid& grid,
                 double alpha_min, double largest_cut, std::size_t count) {
        params.compensate_opacity = Compensate;
        for (std::size_t k = 0; k < count; ++k) {
            const vec3<double> mean(mean_x[k], mean_y[k], mean_z[k]);
            const sym3<double> covariance{xx[k], xy[k], xz[k], yy[k], yz[k], zz[k]};
            const Projection<double> p = gsh::project(camera, mean, covariance, params);
            nonfinite[k] += mean.x * 0.0 + mean.y * 0.0 + mean.z * 0.0 + covariance.xx * 0.0 + covariance.xy * 0.0 +
                            covariance.xz * 0.0 + covariance.yy * 0.0 + covariance.yz * 0.0 + covariance.zz * 0.0 +
                            opacity[k] * 0.0;
            if constexpr (Compensate) {
                opacity[k] *= p.opacity_factor;
                cut[k] = std::log2(opacity[k] / alpha_min);
            }
            cut[k] = cut[k] < largest_cut ? cut[k] : largest_cut;

            constexpr double largest = std::numeric_limits<double>::max();
            const double det = determinant(p.covariance);
            const bool kept = p.in_front & (opacity[k] >= alpha_min) & (p.covariance.xx > 0) & (p.covariance.yy > 0) &
                              (det > 0) & (det <= largest) & (std::fabs(p.mean2d.x) <= largest) &
                              (std::fabs(p.mean2d.y) <= largest);
            const Whitening<double> w =
                whiten(p.covariance, inverse_sqrt(p.covariance.yy), inverse_sqrt(det));
            x[k] = p.mean2d.x, y[k] = p.mean2d.y, depth[k] = p.depth;
            ux[k] = w.ux, uy[k] = w.uy, vy[k] = w.vy;

            const double reach = generous(cut[k]);
            const double width = squared_extent(reach, p.covariance.xx);
            const double height = squared_extent(reach, p.covariance.yy);
            const double box_width = width * inverse_sqrt(width), box_height = height * inverse_sqrt(height);
            half_width[k] = kept ? box_width : -1.0;
            half_height[k] = kept ? box_height : -1.0;
        }
        for (std::size_t k = 0; k < count; ++k) {
            const TileRect rect = tile_rect(x[k], y[k], half_width[k], half_height[k], grid);
            x0[k] = rect.x0, y0[k] = rect.y0, x1[k] = rect.x1, y1[k] = rect.y1;
        }
    }

    template <std::floating_point T>
    [[nodiscard]] ScreenSplat<T> splat(std::size_t k, const vec3<T>& color) const {
        return {{x[k], y[k]}, {ux[k], uy[k], vy[k]}, static_cast<T>(opacity[k]), static_cast<T>(depth[k]), color,
                static_cast<T>(cut[k])};
    }
};

} // namespace detail

/// First stage: screen splats, their tiles, their gradient slots, and sort items of the visible ones. Returns false if
/// cache.status reports an error.
template <CpuBackend B, std::floating_point T>
[[nodiscard]] bool project_splats(B& backend, const Camera<T>& camera, const SplatView<const T>& splats,
                                  const RasterParams<T>& params, RasterCache<B, T>& cache) {
    using Key = typename RasterScratch<B, T>::Key;
    RasterScratch<B, T>& scratch = cache.scratch;
    const std::size_t n = splats.size(), chunks = chunk_count(n, detail::splat_grain);
    scratch.grid = {camera.width, camera.height};
    cache.status.resize(1);
    cache.visible.resize(n);
    scratch.splats.resize(n);
    scratch.covers.resize(n);
    scratch.slot_begin.resize(n + 1);
    scratch.items.resize(n);
    scratch.items_scratch.resize(n);
    scratch.chunk_status.resize(chunks);

    const Camera<double> wide_camera = camera.template cast<double>();
    const ProjectionParams<double> projection_params = params.template cast<double>();
    const double alpha_min = params.alpha_min;
    constexpr double largest_cut = gsh::detail::largest_cut<T>;
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        RasterStatus status;
        // Arithmetic first, branches second, so that a misprediction does not stall it.
        detail::ProjectionBatch batch;
        for (std::size_t first = begin; first < end; first += batch.size) {
            const std::size_t count = std::min(batch.size, end - first);
            batch.load(splats, first, count, params.alpha_min);
            if (params.compensate_opacity)
                batch.project<true>(wide_camera, projection_params, scratch.grid, alpha_min, largest_cut, count);
            else
                batch.project<false>(wide_camera, projection_params, scratch.grid, alpha_min, largest_cut, count);
            for (std::size_t k = 0; k < count; ++k) {
                const std::size_t i = first + k;
                const TileRect rect{batch.x0[k], batch.y0[k], batch.x1[k], batch.y1[k]};
                std::uint32_t tiles = 0;
                if (!(batch.nonfinite[k] == 0)) {
                    if (status.nonfinite++ == 0) status.first_nonfinite = static_cast<std::uint32_t>(i);
                } else if (!rect.empty()) {
                    scratch.splats[i] = batch.splat(k, splats.colors[i]);
                    tiles = detail::cover_tiles(scratch.splats[i], rect, scratch.grid, scratch.covers[i]);
                }
                cache.visible[i] = tiles != 0;
                scratch.slot_begin[i] = static_cast<std::uint32_t>(status.pairs);
                status.pairs += tiles;
                if (tiles == 0) continue;
                const Key key = std::bit_cast<Key>(scratch.splats[i].depth); // positive floats sort like their bits
                scratch.items_scratch[begin + status.visible++] = {key, static_cast<std::uint32_t>(i)};
            }
        }
        scratch.chunk_status[chunk] = status;
    });

    RasterStatus total;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
        RasterStatus& status = scratch.chunk_status[chunk];
        if (total.nonfinite == 0) total.first_nonfinite = status.first_nonfinite;
        total.nonfinite += status.nonfinite;
        const RasterStatus here = status;
        status.pairs = total.pairs, status.visible = total.visible; // from here on: sums over the chunks before
        total.pairs += here.pairs, total.visible += here.visible;
    }
    cache.status[0] = total;
    if (total.nonfinite != 0 || total.pairs > params.max_pairs) return false;

    scratch.slot_begin[n] = static_cast<std::uint32_t>(total.pairs);
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const RasterStatus& before = scratch.chunk_status[chunk];
        const auto base = static_cast<std::uint32_t>(before.pairs);
        for (std::size_t i = begin; i < end; ++i) scratch.slot_begin[i] += base;
        const std::size_t next = chunk + 1 < chunks ? scratch.chunk_status[chunk + 1].visible : total.visible;
        std::copy_n(scratch.items_scratch.data() + begin, next - before.visible, scratch.items.data() + before.visible);
    });
    return true;
}

} // namespace gsh::cpu
