// SPDX-License-Identifier: Apache-2.0
/// @file  First stage of the rasterizer on a GPU: projected splats, and how many of them each tile has.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>
#include <gsh/render/cuda/float_pair.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
#include <gsh/render/projection.hpp>
#include <gsh/render/tiles.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cuda::detail {

using gsh::detail::cover_columns;
using gsh::detail::cover_of;
using gsh::detail::fits_mask;
using gsh::detail::largest_cut;
using gsh::detail::set_mask;

inline constexpr std::uint32_t no_tile = ~0u;

/// Adds 1 to counts[tile] for each lane, and returns the count that the lane found. Lanes with the same tile share one
/// atomic operation: neighbours on a surface lie in the same tile, and thousands of operations on one number would wait
/// for each other. All lanes take part; for no_tile nothing is added.
[[nodiscard]] __device__ inline std::uint32_t add_one(Span<std::uint32_t> counts, std::uint32_t tile) {
    const unsigned lane = threadIdx.x % warp_size, same = __match_any_sync(all_lanes, tile);
    const int first = __ffs(static_cast<int>(same)) - 1;
    std::uint32_t found = 0;
    if (tile != no_tile && static_cast<int>(lane) == first)
        found = atomicAdd(&counts[tile], static_cast<std::uint32_t>(__popc(same)));
    const auto before = static_cast<std::uint32_t>(__popc(same & ((1u << lane) - 1)));
    return __shfl_sync(all_lanes, found, first) + before;
}

/// Calls visit.together(tile, k) on all lanes at once, for the k-th tile of each lane's cover with a mask, by rows. The
/// tile is no_tile on lanes that have no more. Returns the number of tiles of this lane's cover.
template <class Visit>
__device__ std::uint32_t visit_mask(const TileCover& cover, const TileGrid& grid, const Visit& visit) {
    std::uint32_t k = 0;
    for (std::uint64_t bits = cover.mask; __any_sync(all_lanes, bits != 0) != 0;) {
        std::uint32_t tile = no_tile;
        const std::uint32_t of_lane = k;
        if (bits != 0) {
            const int bit = __ffsll(static_cast<long long>(bits)) - 1;
            tile = static_cast<std::uint32_t>((cover.y0 + (bit >> 3)) * grid.columns() + cover.x0 + (bit & 7));
            bits &= bits - 1, ++k;
        }
        visit.together(tile, of_lane);
    }
    return k;
}

/// Calls visit(tile, k) for the k-th tile of a cover without a mask, by all lanes of a warp: each takes rows, one after
/// the other. All lanes give the same arguments. Returns the number of tiles.
template <class T, class Visit>
__device__ std::uint32_t visit_rows(const Ellipse<T>& ellipse, const TileCover& cover, const TileGrid& grid,
                                    const Visit& visit) {
    std::uint32_t total = 0;
    for (unsigned done = 0; done < cover.rows; done += warp_size) {
        const unsigned row = done + threadIdx.x % warp_size;
        int first = 0, end = 0;
        if (row < cover.rows) cover_columns(ellipse, cover, cover.y0 + static_cast<int>(row), grid, first, end);
        const auto width = static_cast<std::uint32_t>(end - first);
        const std::uint32_t upto = warp_scan(width);
        std::uint32_t k = total + upto - width;
        const std::uint32_t line = (cover.y0 + row) * static_cast<std::uint32_t>(grid.columns());
        for (int x = first; x < end; ++x) visit(line + static_cast<std::uint32_t>(x), k++);
        total += __shfl_sync(all_lanes, upto, int(warp_size) - 1);
    }
    return total;
}

template <class T>
[[nodiscard]] __device__ Ellipse<T> of_lane(const Ellipse<T>& e, int lane) {
    const auto get = [lane](auto x) { return __shfl_sync(all_lanes, x, lane); };
    return {
        get(e.x), get(e.y), {get(e.w.ux), get(e.w.uy), get(e.w.vy)}, get(e.reach), {get(e.origin.x), get(e.origin.y)}};
}
/// Without the mask.
[[nodiscard]] __device__ inline TileCover of_lane(const TileCover& c, int lane) {
    const auto get = [lane](std::uint16_t x) {
        return static_cast<std::uint16_t>(__shfl_sync(all_lanes, static_cast<unsigned>(x), lane));
    };
    return {0, get(c.x0), get(c.y0), get(c.columns), get(c.rows)};
}

/// Calls visit(tile, k) for the k-th tile of each lane's cover; returns the number of tiles of this lane's. All lanes
/// take part. Small covers are the work of their own lane; a large one would keep the others waiting, so the whole warp
/// does it, with what visit.of_lane(lane) returns.
template <class T, class Visit>
__device__ std::uint32_t visit_tiles(const Ellipse<T>& ellipse, const TileCover& cover, const TileGrid& grid,
                                     const Visit& visit) {
    const bool large = !fits_mask(cover);
    std::uint32_t count = visit_mask(cover, grid, visit); // a large cover has no mask
    for (unsigned waiting = __ballot_sync(all_lanes, large); waiting != 0; waiting &= waiting - 1) {
        const int lane = __ffs(static_cast<int>(waiting)) - 1;
        const std::uint32_t tiles = visit_rows(of_lane(ellipse, lane), of_lane(cover, lane), grid, visit.of_lane(lane));
        if (lane == static_cast<int>(threadIdx.x % warp_size)) count = tiles;
    }
    return count;
}

struct CountTile {
    Span<std::uint32_t> counts;
    __device__ void operator()(std::uint32_t tile, std::uint32_t) const { atomicAdd(&counts[tile], 1u); }
    __device__ void together(std::uint32_t tile, std::uint32_t) const { (void)add_one(counts, tile); }
    [[nodiscard]] __device__ CountTile of_lane(int) const { return *this; }
};

/// A splat's covariance, or a factor of it, in another type of numbers.
template <class W, class T>
[[nodiscard]] __device__ sym3<W> widened(const sym3<T>& s) {
    return {W(s.xx), W(s.xy), W(s.xz), W(s.yy), W(s.yz), W(s.zz)};
}
template <class W, class T>
[[nodiscard]] __device__ mat3<W> widened(const mat3<T>& F) {
    const auto column = [](const vec3<T>& v) { return vec3<W>(W(v.x), W(v.y), W(v.z)); };
    return mat3<W>(column(F[0]), column(F[1]), column(F[2]));
}
/// 0, or NaN if a number is not finite.
template <class T>
[[nodiscard]] __device__ T times_zero(const sym3<T>& s) {
    return s.xx * T(0) + s.xy * T(0) + s.xz * T(0) + s.yy * T(0) + s.yz * T(0) + s.zz * T(0);
}
template <class T>
[[nodiscard]] __device__ T times_zero(const mat3<T>& F) {
    T sum = T(0);
    for (int c = 0; c < 3; ++c) sum += F[c].x * T(0) + F[c].y * T(0) + F[c].z * T(0);
    return sum;
}

/// One thread per splat. The projection is computed in FloatPair where T is float. In plain float, images of small
/// splats would still agree with cpu::Serial to 3e-5 in an image 1920 pixels wide, but those of needles only to 1.4e-3.
/// With pairs, both agree to 7e-6. Splats with factors have a kernel of their own, because they take more registers.
template <std::floating_point T, bool Factored>
struct ProjectSplats {
    static constexpr unsigned block_size = splats_of_block;
    static constexpr unsigned least_blocks = Factored ? 2 : 4;
    static constexpr unsigned warps = block_size / warp_size;
    static constexpr T largest = std::numeric_limits<T>::max();
    struct Shared {
        SharedArray<std::uint64_t, warps> pairs;
        SharedArray<std::uint32_t, warps> first_nonfinite;
    };

    SplatView<const T> splats;
    ProjectionParams<T> params;
    T alpha_min;
    TileGrid grid;
    Span<ScreenSplat<T>> screen;
    Span<TileCover> covers;
    Span<std::uint32_t> slot_begin; // counted from the first slot of the thread block
    Span<std::uint8_t> visible;
    Span<std::uint32_t> tile_counts;
    Span<BlockCount> block_counts;
    Deferred<Camera<T>> camera;

    __device__ void operator()(Shared& shared) const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        const bool inside = i < splats.size();
        ScreenSplat<T> splat{};
        TileCover cover;
        bool nonfinite = false;
        if (inside) project_splat(i, splat, cover, nonfinite);

        const Ellipse<T> ellipse = ellipse_of(splat);
        if (cover.rows != 0 && fits_mask(cover)) (void)set_mask(ellipse, grid, cover);
        const std::uint32_t tiles = visit_tiles(ellipse, cover, grid, CountTile{tile_counts});

        std::uint64_t pairs;
        const std::uint64_t before = block_scan<block_size>(shared.pairs, std::uint64_t(tiles), pairs);
        if (inside) {
            // The rectangle of a splat may meet tiles of which its ellipse meets none.
            if (tiles != 0) screen[i] = splat;
            covers[i] = tiles != 0 ? cover : TileCover{};
            slot_begin[i] = static_cast<std::uint32_t>(before);
            visible[i] = tiles != 0;
        }
        BlockCount count{pairs, static_cast<std::uint32_t>(__syncthreads_count(tiles != 0)),
                         static_cast<std::uint32_t>(__syncthreads_count(nonfinite)), ~0u};
        if (count.nonfinite != 0) count.first_nonfinite = first(shared, nonfinite);
        if (threadIdx.x == 0) block_counts[blockIdx.x] = count;
    }

private:
    /// The first index of the thread block at which `found` is true.
    __device__ std::uint32_t first(Shared& shared, bool found) const {
        const unsigned lanes = __ballot_sync(all_lanes, found), warp = threadIdx.x / warp_size;
        if (threadIdx.x % warp_size == 0)
            shared.first_nonfinite[warp] = lanes == 0 ? ~0u
                                                      : blockIdx.x * block_size + warp * warp_size +
                                                            static_cast<unsigned>(__ffs(static_cast<int>(lanes)) - 1);
        __syncthreads();
        std::uint32_t least = ~0u;
        for (unsigned w = 0; w < warps; ++w) {
            const std::uint32_t of_warp = shared.first_nonfinite[w];
            least = of_warp < least ? of_warp : least;
        }
        return least;
    }

    [[nodiscard]] __device__ auto shape_at(std::size_t i) const {
        if constexpr (Factored)
            return splats.factors[i];
        else
            return splats.covariances[i];
    }

    /// Leaves the cover empty if the splat is culled.
    __device__ void project_splat(std::size_t i, ScreenSplat<T>& splat, TileCover& cover, bool& nonfinite) const {
        using W = Wider<T>;
        const vec3<T> mean = splats.means[i], color = splats.colors[i];
        const auto shape = shape_at(i);
        T opacity = splats.opacities[i];
        const T zero = mean.x * T(0) + mean.y * T(0) + mean.z * T(0) + times_zero(shape) + color.x * T(0) +
                       color.y * T(0) + color.z * T(0) + opacity * T(0);
        nonfinite = !(zero == T(0));
        if (nonfinite) return;

        const vec3<W> wide_mean(W(mean.x), W(mean.y), W(mean.z));
        const Projection<W> p = project(camera().template cast<W>(), wide_mean, widened<W>(shape), params);
        if (params.compensate_opacity) opacity = rounded(W(opacity) * p.opacity_factor);
        const T det = rounded(p.determinant);
        const T xx = rounded(p.covariance.xx), yy = rounded(p.covariance.yy);
        splat.x = rounded(p.mean2d.x), splat.y = rounded(p.mean2d.y);
        const bool kept = p.in_front && opacity >= alpha_min && xx > T(0) && yy > T(0) && det > T(0) &&
                          det <= largest && abs(splat.x) <= largest && abs(splat.y) <= largest;
        if (!kept) return;

        splat.set_low(rest_of(p.mean2d.x), rest_of(p.mean2d.y));
        const Whitening<T> w = whiten(sym2<T>{xx, rounded(p.covariance.xy), yy}, T(1) / sqrt(yy), T(1) / sqrt(det));
        splat.ux = w.ux, splat.uy = w.uy, splat.vy = w.vy;
        const T cut = std::log2(opacity / alpha_min);
        splat.opacity = opacity;
        splat.cut = cut < largest_cut<T> ? cut : largest_cut<T>;
        splat.red = color.x, splat.green = color.y, splat.blue = color.z;
        splat.depth = rounded(p.depth);

        const Ellipse<T> e = ellipse_of(splat);
        const TileRect rect =
            tile_rect(e.x, e.y, sqrt(squared_extent(e.reach, xx)), sqrt(squared_extent(e.reach, yy)), grid, e.origin);
        if (!rect.empty()) cover = cover_of(rect);
    }
};

} // namespace gsh::cuda::detail
