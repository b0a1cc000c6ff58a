// SPDX-License-Identifier: Apache-2.0
/// @file  The photometric loss on the GPU: one block per tile, which filters along rows, then down columns.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/cuda/photometric_tile.cuh>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/loss/ssim.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace gsh {

template <>
inline constexpr bool photometric_composites<cuda::Device> = true;

template <std::floating_point T>
struct PhotometricScratch<cuda::Device, T> {
    cuda::Device::Buffer<T> partials;          ///< [3, channels, height, width] of the SSIM term; unspecified in tiles
                                               ///< that are not active
    cuda::Device::Buffer<std::uint8_t> active; ///< [tiles] 1 where some window of the tile contains a difference
    cuda::Device::Buffer<T> sums;              ///< [3, tiles] sums of |render - truth|, of 1 - SSIM and of
                                               ///< (render - truth)²
};

namespace cuda {

namespace detail {

/// Sums and partial derivatives of one tile. Truth: ImageView<const T>, or CompositePicture<T>.
template <class T, class Truth>
struct PhotometricForward {
    using Tiles = PhotometricTiles<T>;
    static constexpr unsigned block_size = Tiles::threads;
    static constexpr unsigned least_blocks = std::is_same_v<T, float> ? 4 : 1;
    static constexpr int moments = 4; // s, d, s², d²
    struct Shared {
        SharedArray<T, Tiles::in_size> s, d;
        SharedArray<T, moments * Tiles::along_size> along; // filtered along rows
        SharedArray<T, block_size / warp_size> l1, dssim, squares;
    };

    ImageView<const T> render;
    Truth truth;
    Tiles tiles;
    bool with_ssim, skip_equal;
    SsimWindow<T> window;
    Span<T> partials;
    Span<std::uint8_t> active;
    Span<T> sums;

    __device__ void operator()(Shared& shared) const {
        const PhotometricTile<T> tile(tiles);
        const bool is_active = __syncthreads_or(load(tile, shared)) || !skip_equal;
        T l1(0), dssim(0), squares(0);
        // Otherwise 1 - SSIM is 0 in each window, and the partials are 0 or multiplied by 0.
        if (is_active) {
            for (int r = 0; r < Tiles::rows_of_thread; ++r) {
                const T d = shared.d[std::size_t((tile.first_row + r + Tiles::radius) * Tiles::in_stride + tile.column +
                                                 Tiles::radius)];
                l1 += gsh::abs(d), squares += d * d; // 0 outside the image
            }
            if (with_ssim) {
                filter_row<moments>(window, shared.along, [&](std::size_t place, T(&values)[moments]) {
                    const T s = shared.s[place], d = shared.d[place];
                    values[0] = s, values[1] = d, values[2] = s * s, values[3] = d * d;
                });
                __syncthreads();
                dssim = evaluate(tile, shared);
            }
            l1 = block_sum<block_size>(shared.l1, l1);
            dssim = block_sum<block_size>(shared.dssim, dssim);
            squares = block_sum<block_size>(shared.squares, squares);
        }
        if (threadIdx.x != 0) return;
        active[blockIdx.x] = is_active;
        sums[blockIdx.x] = l1, sums[gridDim.x + blockIdx.x] = dssim, sums[2 * gridDim.x + blockIdx.x] = squares;
    }

private:
    /// Fills s and d; whether the images differ in a pixel of the thread.
    __device__ bool load(const PhotometricTile<T>& tile, Shared& shared) const {
        T a[Tiles::loads_of_thread], b[Tiles::loads_of_thread]; // all on their way before the first one is used
        for (int k = 0; k < Tiles::loads_of_thread; ++k) {
            const auto at = tile.load(k);
            a[k] = at.inside ? render.data[tile.pixel(at.y, at.x)] : T(0);
            b[k] = at.inside ? truth.at(tile.channel, at.y, at.x) : T(0);
        }
        bool differ = false;
        for (int k = 0; k < Tiles::loads_of_thread; ++k) {
            const auto at = tile.load(k);
            if (!at.exists) continue;
            const T d = a[k] - b[k];
            shared.s[at.place()] = a[k] + b[k], shared.d[at.place()] = d;
            differ = differ || d != T(0); // NaN differs
        }
        return differ;
    }

    /// Stores the partials of the thread's pixels; the sum of their losses.
    __device__ T evaluate(const PhotometricTile<T>& tile, const Shared& shared) const {
        T filtered[moments][Tiles::rows_of_thread];
        filter_column(window, tile, shared.along, filtered);
        T sum(0);
        for (int r = 0; r < Tiles::rows_of_thread; ++r) {
            if (!tile.inside(r)) continue;
            SsimPartials<T> partial;
            sum += ssim_loss<T>({filtered[0][r], filtered[1][r], filtered[2][r], filtered[3][r]}, partial);
            const std::size_t at = tile.pixel(tile.y + r, tile.x), map = render.data.size();
            partials[at] = partial.mean, partials[map + at] = partial.ss, partials[2 * map + at] = partial.dd;
        }
        return sum;
    }
};

/// The loss and its parts from the sums of all tiles. One block; the only arithmetic in double.
template <class T>
struct PhotometricJoin {
    static constexpr unsigned block_size = 256;
    struct Shared {
        SharedArray<double, block_size / warp_size> l1, dssim, squares;
    };
    Span<const T> sums; // [3, tiles]
    double count, ssim_weight;
    double no_ssim; // the value of SSIM if it is not computed
    bool with_ssim;
    Span<double> values;

    __device__ void operator()(Shared& shared) const {
        const std::size_t tiles = sums.size() / 3;
        double l1 = 0, dssim = 0, squares = 0;
        for (std::size_t i = threadIdx.x; i < tiles; i += block_size)
            l1 += double(sums[i]), dssim += double(sums[tiles + i]), squares += double(sums[2 * tiles + i]);
        l1 = block_sum<block_size>(shared.l1, l1) / count;
        dssim = block_sum<block_size>(shared.dssim, dssim) / count;
        squares = block_sum<block_size>(shared.squares, squares) / count;
        if (threadIdx.x != 0) return;
        values[0] = (1 - ssim_weight) * l1 + ssim_weight * dssim;
        values[1] = l1;
        values[2] = with_ssim ? 1 - dssim : no_ssim;
        values[3] = squares;
    }
};

/// Gradient of one tile: the partials around it, filtered by the same (symmetric) window.
template <class T, class Truth>
struct PhotometricBackward {
    using Tiles = PhotometricTiles<T>;
    static constexpr unsigned block_size = Tiles::threads;
    static constexpr unsigned least_blocks = std::is_same_v<T, float> ? 4 : 1;
    static constexpr int maps = 3; // dL_dmean, dL_dss, dL_ddd
    struct Shared {
        SharedArray<T, maps * Tiles::in_size> in;
        SharedArray<T, maps * Tiles::along_size> along;
    };

    ImageView<const T> render;
    Truth truth;
    ImageView<T> dL_drender;
    Tiles tiles;
    T ssim_scale, l1_scale;
    SsimWindow<T> window;
    Span<const T> partials;
    Span<const std::uint8_t> active;

    __device__ void operator()(Shared& shared) const {
        const PhotometricTile<T> tile(tiles);
        const unsigned neighbours = active_neighbours(tile);
        if (neighbours == 0) return; // for all threads of the block

        T a[Tiles::rows_of_thread], b[Tiles::rows_of_thread], gradient[Tiles::rows_of_thread];
        for (int r = 0; r < Tiles::rows_of_thread; ++r) { // early, so that they arrive while the maps are filtered
            if (!tile.inside(r)) continue;
            const std::size_t at = tile.pixel(tile.y + r, tile.x);
            a[r] = render.data[at];
            b[r] = truth.at(tile.channel, tile.y + r, tile.x);
        }
        T filtered[maps][Tiles::rows_of_thread] = {};
        if (ssim_scale != T(0)) {
            load(tile, neighbours, shared);
            __syncthreads();
            filter_row<maps>(window, shared.along, [&](std::size_t place, T(&values)[maps]) {
                for (int m = 0; m < maps; ++m) values[m] = shared.in[std::size_t(m * Tiles::in_size) + place];
            });
        }
        for (int r = 0; r < Tiles::rows_of_thread; ++r) // beside those above, they would not fit into registers
            if (tile.inside(r)) gradient[r] = dL_drender.data[tile.pixel(tile.y + r, tile.x)];
        if (ssim_scale != T(0)) {
            __syncthreads();
            filter_column(window, tile, shared.along, filtered);
        }
        for (int r = 0; r < Tiles::rows_of_thread; ++r) {
            if (!tile.inside(r)) continue;
            const T s = a[r] + b[r], d = a[r] - b[r];
            const T slope = d > T(0) ? l1_scale : d < T(0) ? -l1_scale : T(0);
            dL_drender.data[tile.pixel(tile.y + r, tile.x)] =
                gradient[r] +
                (ssim_scale * (filtered[0][r] + T(2) * (s * filtered[1][r] + d * filtered[2][r])) + slope);
        }
    }

private:
    /// Bit 3 (J + 1) + (I + 1) is set if the tile J rows and I columns away exists and is active. The same for all
    /// threads of a block: each warp finds it for itself, which takes no barrier.
    __device__ unsigned active_neighbours(const PhotometricTile<T>& tile) const {
        const int lane = int(threadIdx.x % warp_size), j = tile.j + lane / 3 - 1, i = tile.i + lane % 3 - 1;
        const bool exists = lane < 9 && j >= 0 && j < tiles.down && i >= 0 && i < tiles.across;
        return __ballot_sync(all_lanes,
                             exists && active[std::size_t((tile.channel * tiles.down + j) * tiles.across + i)]);
    }
    /// -1, 0 or 1 if a pixel of the halo lies in the tile before, in this one or in the next.
    [[nodiscard]] static __device__ int side(int place, int size) {
        return (place >= Tiles::radius + size) - (place < Tiles::radius);
    }

    __device__ void load(const PhotometricTile<T>& tile, unsigned neighbours, Shared& shared) const {
        T values[maps][Tiles::loads_of_thread];
        const std::size_t map = render.data.size();
        for (int k = 0; k < Tiles::loads_of_thread; ++k) {
            const auto at = tile.load(k);
            const int neighbour = 3 * (side(at.row, Tiles::rows) + 1) + side(at.column, Tiles::columns) + 1;
            const bool is_active = at.inside && (neighbours >> neighbour & 1u) != 0;
            for (int m = 0; m < maps; ++m)
                values[m][k] = is_active ? partials[std::size_t(m) * map + tile.pixel(at.y, at.x)] : T(0);
        }
        for (int k = 0; k < Tiles::loads_of_thread; ++k) {
            const auto at = tile.load(k);
            if (!at.exists) continue;
            for (int m = 0; m < maps; ++m) shared.in[std::size_t(m * Tiles::in_size) + at.place()] = values[m][k];
        }
    }
};

} // namespace detail

/// Fills the cache with values and partial derivatives.
template <std::floating_point T, class Truth>
void photometric_forward(Device& device, const ImageView<const T>& render, const Truth& truth,
                         const PhotometricParams<T>& params, PhotometricCache<Device, T>& cache) {
    check_value(!params.whole_windows, "PhotometricLoss::forward", "whole_windows is for the CPU backends");
    const detail::PhotometricTiles<T> tiles(render.channels, render.height, render.width);
    PhotometricScratch<Device, T>& scratch = cache.scratch;
    scratch.active.resize(tiles.count());
    scratch.sums.resize(3 * tiles.count());
    scratch.partials.resize(cache.with_ssim ? 3 * render.size() : 0);
    device.launch(tiles.count(), detail::PhotometricForward<T, Truth>{render, truth, tiles, cache.with_ssim,
                                                                      params.skip_equal, {}, scratch.partials,
                                                                      scratch.active, scratch.sums});
    device.launch(1, detail::PhotometricJoin<T>{scratch.sums, double(std::max<std::size_t>(render.size(), 1)),
                                                double(params.ssim_weight), std::numeric_limits<double>::quiet_NaN(),
                                                cache.with_ssim, cache.values});
}

template <std::floating_point T, class Truth>
void photometric_backward(Device& device, const ImageView<const T>& render, const Truth& truth, T dL_dloss,
                          const PhotometricParams<T>& params, const PhotometricCache<Device, T>& cache,
                          const ImageView<T>& dL_drender) {
    const detail::PhotometricTiles<T> tiles(render.channels, render.height, render.width);
    const T per_element = dL_dloss / T(std::max<std::size_t>(render.size(), 1));
    device.launch(tiles.count(), detail::PhotometricBackward<T, Truth>{
                                     render, truth, dL_drender, tiles, params.ssim_weight * per_element,
                                     (T(1) - params.ssim_weight) * per_element, {}, cache.scratch.partials,
                                     cache.scratch.active});
}

} // namespace cuda

} // namespace gsh
