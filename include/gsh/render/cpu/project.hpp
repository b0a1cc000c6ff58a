// SPDX-License-Identifier: Apache-2.0
/// @file  First stage of the rasterizer on the CPU: projected splats, and the tiles that they touch.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cpu/arithmetic.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/projection.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/render/tiles.hpp>

#include <algorithm>
#include <bit>
#include <concepts>
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

/// A camera with each number in all lanes of W, which is Wide<double>.
template <class W>
[[nodiscard]] GSH_INLINE Camera<W> in_all_lanes(const Camera<double>& camera) {
    const auto wide = [](const vec3<double>& v) { return vec3<W>(W(v.x), W(v.y), W(v.z)); };
    return {mat3<W>(wide(camera.R[0]), wide(camera.R[1]), wide(camera.R[2])),
            wide(camera.t),
            W(camera.fx),
            W(camera.fy),
            W(camera.cx),
            W(camera.cy),
            camera.width,
            camera.height};
}

/// As many numbers as a register of double holds, in double; and back.
template <std::floating_point T>
[[nodiscard]] GSH_INLINE Wide<double> widened(const T* numbers) {
    return Wide<double>(Wide<T, Wide<double>::width>::load(numbers));
}
template <class T> // a floating-point type, or int for whole numbers
GSH_INLINE void store_narrowed(Wide<double> numbers, T* to) {
    Wide<T, Wide<double>::width>(numbers).store(to);
}

/// Projects splats in batches: arithmetic in registers first, branches second, so that a misprediction does not stall
/// it. All is in double.
template <std::floating_point T, class W = Wide<double>>
class ProjectionBatch {
public:
    static constexpr std::size_t size = 64;

    ProjectionBatch(const Camera<double>& camera, const RasterParams<T>& params, const TileGrid& grid, bool factored)
        : factored_(factored), camera_(camera), params_(params.template cast<double>()), alpha_min_(params.alpha_min),
          columns_(grid.width), rows_(grid.height) {}

    // Of the batch, after project.
    alignas(64) double x[size], y[size], depth[size], ux[size], uy[size], vy[size];
    alignas(64) double opacity[size], cut[size];     // compensated; see ScreenSplat
    alignas(64) double nonfinite[size];              // 0, or NaN
    alignas(64) int x0[size], y0[size], x1[size], y1[size]; // rectangle of tiles, empty if the splat is culled

    void project(const SplatView<const T>& splats, std::size_t first, std::size_t count) {
        load(splats, first, count);
        for (std::size_t k = 0; k < count; k += W::width) project(k);
    }

    [[nodiscard]] TileRect rect(std::size_t k) const { return {x0[k], y0[k], x1[k], y1[k]}; }
    /// Sets the tiles of a rectangle that is not empty; returns their number.
    [[nodiscard]] std::uint32_t cover(std::size_t k, const TileGrid& grid, TileCover& cover) const {
        cover = gsh::detail::cover_of(rect(k));
        if (gsh::detail::fits_mask(cover)) { // as gsh::detail::set_mask
            if (cover.columns == 1 || cover.rows == 1) cover.mask = gsh::detail::whole_mask(cover);
            else
                for (int row = 0; row < cover.rows; ++row)
                    cover.mask |= gsh::detail::row_mask(cover, row, row_first_[row][k], row_end_[row][k]);
            return static_cast<std::uint32_t>(std::popcount(cover.mask));
        }
        // As ellipse_of the splat.
        const Ellipse<double> ellipse{
            x[k], y[k], {ux[k], uy[k], vy[k]}, generous(static_cast<double>(static_cast<T>(cut[k])))};
        std::uint32_t count = 0;
        for (int row = y0[k]; row < y1[k]; ++row) {
            int first, end;
            cover_columns(ellipse, cover, row, grid, first, end);
            count += static_cast<std::uint32_t>(end - first);
        }
        return count;
    }
    /// Member by member: GCC 12 would copy a whole splat through a register, which waits for the stores of its members.
    void put_splat(std::size_t k, const vec3<T>& color, ScreenSplat<T>& to) const {
        to.mean2d.x = x[k], to.mean2d.y = y[k];
        to.w.ux = ux[k], to.w.uy = uy[k], to.w.vy = vy[k];
        to.opacity = static_cast<T>(opacity[k]), to.depth = static_cast<T>(depth[k]);
        to.color.x = color.x, to.color.y = color.y, to.color.z = color.z;
        to.cut = static_cast<T>(cut[k]);
    }

private:
    bool factored_;
    // Input, member by member: a register is loaded long after its numbers were stored one by one.
    alignas(64) T mean_x_[size] = {}, mean_y_[size] = {}, mean_z_[size] = {};
    alignas(64) T xx_[size] = {}, xy_[size] = {}, xz_[size] = {}, yy_[size] = {}, yz_[size] = {}, zz_[size] = {};
    alignas(64) T factor_[9][size] = {};                  // by columns; in place of the covariance
    alignas(64) T opacity_[size] = {}, color_[size] = {}; // color_: 0 if it is finite, else NaN
    Camera<double> camera_;
    ProjectionParams<double> params_;
    double alpha_min_;
    int columns_, rows_; // of pixels
    // Columns of tiles that the ellipse meets in each row of its rectangle, if that has several columns and rows, and
    // at most eight.
    alignas(64) int row_first_[8][size], row_end_[8][size];

    void load(const SplatView<const T>& splats, std::size_t first, std::size_t count) {
        for (std::size_t k = 0; k < count; ++k) {
            const vec3<T>&m = splats.means[first + k], &c = splats.colors[first + k];
            mean_x_[k] = m.x, mean_y_[k] = m.y, mean_z_[k] = m.z;
            if (factored_) {
                const mat3<T>& F = splats.factors[first + k];
                for (int n = 0; n < 9; ++n) factor_[n][k] = F[n / 3][n % 3];
            } else {
                const sym3<T>& s = splats.covariances[first + k];
                xx_[k] = s.xx, xy_[k] = s.xy, xz_[k] = s.xz, yy_[k] = s.yy, yz_[k] = s.yz, zz_[k] = s.zz;
            }
            opacity_[k] = splats.opacities[first + k];
            color_[k] = c.x * T(0) + c.y * T(0) + c.z * T(0);
        }
    }

    void project([[maybe_unused]] std::size_t k) {
#if !defined(__CUDA_ARCH__) // in its pass for the device, nvcc parses host code, too, and refuses vectors of registers
        const Camera<W> camera = in_all_lanes<W>(camera_);
        const vec3<W> mean(widened(mean_x_ + k), widened(mean_y_ + k), widened(mean_z_ + k));
        const W zero(0.0), other = widened(color_ + k) + mean.x * zero + mean.y * zero + mean.z * zero;
        if (factored_) {
            const auto column = [&](int c) {
                return vec3<W>(widened(factor_[3 * c] + k), widened(factor_[3 * c + 1] + k),
                               widened(factor_[3 * c + 2] + k));
            };
            const mat3<W> F(column(0), column(1), column(2));
            W sum = other;
            for (int c = 0; c < 3; ++c) sum += F[c].x * zero + F[c].y * zero + F[c].z * zero;
            (sum + widened(opacity_ + k) * zero).store(nonfinite + k);
            finish(k, gsh::project(camera, mean, F, params_));
        } else {
            const sym3<W> covariance{widened(xx_ + k), widened(xy_ + k), widened(xz_ + k),
                                     widened(yy_ + k), widened(yz_ + k), widened(zz_ + k)};
            (other + covariance.xx * zero + covariance.xy * zero + covariance.xz * zero + covariance.yy * zero +
             covariance.yz * zero + covariance.zz * zero + widened(opacity_ + k) * zero)
                .store(nonfinite + k);
            finish(k, gsh::project(camera, mean, covariance, params_));
        }
#endif
    }

    GSH_INLINE void finish([[maybe_unused]] std::size_t k, [[maybe_unused]] const Projection<W>& p) {
#if !defined(__CUDA_ARCH__)
        const W zero(0.0), alpha = widened(opacity_ + k) * p.opacity_factor;
        const W largest(std::numeric_limits<double>::max());
        const W det = p.determinant;
        const auto kept = p.in_front & (alpha >= W(alpha_min_)) & (p.covariance.xx > zero) & (p.covariance.yy > zero) &
                          (det > zero) & (det <= largest) & (abs(p.mean2d.x) <= largest) & (abs(p.mean2d.y) <= largest);
        const Whitening<W> w = whiten(p.covariance, inverse_sqrt(p.covariance.yy), inverse_sqrt(det));
        const W log2_of_ratio = log_normal(alpha * W(1 / alpha_min_)) * W(1.44269504088896340736);
        const W limit = min(log2_of_ratio, W(gsh::detail::largest_cut<T>));
        p.mean2d.x.store(x + k), p.mean2d.y.store(y + k), p.depth.store(depth + k);
        w.ux.store(ux + k), w.uy.store(uy + k), w.vy.store(vy + k);
        alpha.store(opacity + k), limit.store(cut + k);

        const W reach = generous(limit);
        const W width = squared_extent(reach, p.covariance.xx), height = squared_extent(reach, p.covariance.yy);
        const W half_width = select(kept, width * inverse_sqrt(width), W(-1.0));
        const W half_height = select(kept, height * inverse_sqrt(height), W(-1.0));
        const Tiles across = tiles_between(p.mean2d.x - half_width, p.mean2d.x + half_width, columns_, kept);
        const Tiles down = tiles_between(p.mean2d.y - half_height, p.mean2d.y + half_height, rows_, kept);
        store_narrowed(across.first, x0 + k), store_narrowed(across.end, x1 + k);
        store_narrowed(down.first, y0 + k), store_narrowed(down.end, y1 + k);
        find_columns(k, p.mean2d, w, reach, across, down);
#endif
    }

    /// A half-open range of tiles along one axis.
    struct Tiles {
        W first, end;
    };
    using Mask = MaskOf<W>;
    /// The tiles with a pixel centre in [low, high], as in tile_rect; none where not `kept`.
    [[nodiscard]] static Tiles tiles_between(W low, W high, int pixels, Mask kept) {
        const W zero(0.0), last(static_cast<double>(pixels)), tile(1.0 / TileGrid::tile_size);
        const auto cut_to_image = [&](W edge) { // 0 for NaN
            const W above = select(edge > zero, edge, zero);
            return select(above < last, above, last);
        };
        const W from = ceil_positive(cut_to_image(low - W(0.5))), to = floor_positive(cut_to_image(high + W(0.5)));
        const W first = floor_positive(from * tile), end = ceil_positive(to * tile);
        return {first, select((from < to) & kept, end, first)};
    }

    /// Sets row_first_ and row_end_; as tile_columns.
    GSH_INLINE void find_columns([[maybe_unused]] std::size_t k, [[maybe_unused]] const vec2<W>& mean2d,
                                 [[maybe_unused]] const Whitening<W>& w, [[maybe_unused]] W reach,
                                 [[maybe_unused]] const Tiles& across, [[maybe_unused]] const Tiles& down) {
#if !defined(__CUDA_ARCH__)
        const W zero(0.0), one(1.0), most(8.0), side(TileGrid::tile_size);
        const W columns = across.end - across.first, rows = down.end - down.first;
        const Mask wanted = (columns > one) & (rows > one) & (columns <= most) & (rows <= most);
        const W radius = sqrt(reach), shear = w.uy / w.vy, inverse_ux = one / w.ux;
        const W tip = radius * shear * inverse_sqrt(one + shear * shear);
        const W last = W(static_cast<double>(rows_) - 0.5) - mean2d.y;
        for (int row = 0; row < 8; ++row) {
            const Mask has_row = wanted & (rows > W(static_cast<double>(row)));
            if (!any(has_row)) break;
            const W top = (down.first + W(static_cast<double>(row))) * side + W(0.5) - mean2d.y;
            const W v0 = w.vy * top, v1 = w.vy * min(top + (side - one), last);
            const W right = clamp(-tip, v0, v1), left = clamp(tip, v0, v1);
            const W to_right = sqrt(max(reach - right * right, zero)) - shear * right;
            const W to_left = sqrt(max(reach - left * left, zero)) + shear * left;
            const Tiles met = tiles_between(mean2d.x - to_left * inverse_ux, mean2d.x + to_right * inverse_ux, columns_,
                                            has_row & (v0 <= radius) & (v1 >= -radius));
            const W first = max(met.first, across.first); // the rectangle was rounded differently
            store_narrowed(first, row_first_[row] + k);
            store_narrowed(max(min(met.end, across.end), first), row_end_[row] + k);
        }
#endif
    }
    [[nodiscard]] static W floor_positive(W number) { // below 2³¹: the integer part, by a sum that rounds
        const W shift(6755399441055744.0), rounded = (number + shift) - shift;
        return select(rounded > number, rounded - W(1.0), rounded);
    }
    [[nodiscard]] static W ceil_positive(W number) {
        const W whole = floor_positive(number);
        return select(whole < number, whole + W(1.0), whole);
    }
};

} // namespace detail

/// First stage: screen splats, their tiles, and sort items of the visible ones. Returns false if cache.status reports
/// an error.
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
    scratch.pair_begin.resize(n + 1);
    scratch.items.resize(n);
    scratch.items_scratch.resize(n);
    scratch.chunk_status.resize(chunks);

    const Camera<double> camera_in_double = camera.template cast<double>();
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        RasterStatus status;
        detail::ProjectionBatch<T> batch(camera_in_double, params, scratch.grid, splats.is_factored());
        for (std::size_t first = begin; first < end; first += batch.size) {
            const std::size_t count = std::min(batch.size, end - first);
            batch.project(splats, first, count);
            for (std::size_t k = 0; k < count; ++k) {
                const std::size_t i = first + k;
                const TileRect rect = batch.rect(k);
                std::uint32_t tiles = 0;
                if (!(batch.nonfinite[k] == 0)) {
                    if (status.nonfinite++ == 0) status.first_nonfinite = static_cast<std::uint32_t>(i);
                } else if (!rect.empty()) {
                    batch.put_splat(k, splats.colors[i], scratch.splats[i]);
                    tiles = batch.cover(k, scratch.grid, scratch.covers[i]);
                }
                cache.visible[i] = tiles != 0;
                scratch.pair_begin[i] = static_cast<std::uint32_t>(status.pairs);
                status.pairs += tiles;
                if (tiles == 0) continue;
                const Key key = std::bit_cast<Key>(static_cast<T>(batch.depth[k])); // positive: sorts like its bits
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

    scratch.pair_begin[n] = static_cast<std::uint32_t>(total.pairs);
    backend.for_chunks(n, detail::splat_grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const RasterStatus& before = scratch.chunk_status[chunk];
        const auto base = static_cast<std::uint32_t>(before.pairs);
        for (std::size_t i = begin; i < end; ++i) scratch.pair_begin[i] += base;
        const std::size_t next = chunk + 1 < chunks ? scratch.chunk_status[chunk + 1].visible : total.visible;
        std::copy_n(scratch.items_scratch.data() + begin, next - before.visible, scratch.items.data() + before.visible);
    });
    return true;
}

} // namespace gsh::cpu
