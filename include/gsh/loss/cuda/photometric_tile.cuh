// SPDX-License-Identifier: Apache-2.0
/// @file  How a block of threads shares a tile of the photometric loss, and filters it.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/unroll.cuh>
#include <gsh/loss/ssim.hpp>

#include <cstddef>
#include <type_traits>

namespace gsh::cuda::detail {

/// The tiles that cover an image, and how a block of threads shares one.
///
/// A thread filters several outputs from one window of inputs in registers: `run` neighbours of a row, or
/// `rows_of_thread` of a column. Arithmetic then takes longer than the loads from shared memory, which are four times
/// slower than multiplications and would be eleven for each output otherwise. Rows of shared memory have an odd stride,
/// so that the threads of a warp, four in each of eight rows, access 32 different banks.
template <class T>
struct PhotometricTiles {
    static constexpr int rows = std::is_same_v<T, float> ? 32 : 16; // at most 48 KiB of shared memory
    static constexpr int columns = 32;
    static constexpr int radius = SsimWindow<T>::radius;
    static constexpr int halo_rows = rows + 2 * radius, halo_columns = columns + 2 * radius;
    static constexpr int threads = 256;
    static constexpr int run = 8, runs = columns / run;
    static constexpr int rows_of_thread = rows * columns / threads;
    static constexpr int loads_of_thread = (halo_rows * halo_columns + threads - 1) / threads;
    static constexpr int in_stride = halo_columns + 1, along_stride = columns + 1;
    static constexpr int in_size = halo_rows * in_stride, along_size = halo_rows * along_stride;
    static_assert(halo_rows * runs <= threads && in_stride % 2 == 1 && along_stride % 2 == 1);

    int channels, height, width, down, across;

    PhotometricTiles(int c, int h, int w)
        : channels(c), height(h), width(w), down((h + rows - 1) / rows), across((w + columns - 1) / columns) {}
    [[nodiscard]] std::size_t count() const { return std::size_t(channels) * std::size_t(down) * std::size_t(across); }
};

/// The tile of a block, and the pixels of the running thread: rows [y, y + rows_of_thread) of column x.
template <class T>
struct PhotometricTile {
    using Tiles = PhotometricTiles<T>;
    Tiles tiles;
    int channel, j, i;     // channel, tile row, tile column
    int first_row, column; // of the thread's pixels within the tile
    int y, x;              // and within the image
    std::size_t plane;     // index of the channel's first pixel

    __device__ explicit PhotometricTile(const Tiles& all) : tiles(all) {
        const int block = int(blockIdx.x), thread = int(threadIdx.x);
        i = block % tiles.across, j = block / tiles.across % tiles.down, channel = block / tiles.across / tiles.down;
        first_row = thread / Tiles::columns * Tiles::rows_of_thread, column = thread % Tiles::columns;
        y = j * Tiles::rows + first_row, x = i * Tiles::columns + column;
        plane = std::size_t(channel) * std::size_t(tiles.height) * std::size_t(tiles.width);
    }

    /// Index of a pixel in a planar image.
    [[nodiscard]] __device__ std::size_t pixel(int row, int col) const {
        return plane + std::size_t(row * tiles.width + col);
    }
    /// Whether pixel r of the thread lies in the image.
    [[nodiscard]] __device__ bool inside(int r) const { return y + r < tiles.height && x < tiles.width; }

    /// One of the pixels of the tile and its halo that the running thread loads.
    struct Load {
        int row, column; // within the halo
        int y, x;        // within the image
        bool exists, inside;
        [[nodiscard]] __device__ std::size_t place() const { return std::size_t(row * Tiles::in_stride + column); }
    };
    [[nodiscard]] __device__ Load load(int k) const {
        const int n = k * Tiles::threads + int(threadIdx.x);
        const int row = n / Tiles::halo_columns, col = n % Tiles::halo_columns;
        const int v = j * Tiles::rows + row - Tiles::radius, u = i * Tiles::columns + col - Tiles::radius;
        const bool exists = row < Tiles::halo_rows;
        return {row, col, v, u, exists, exists && v >= 0 && v < tiles.height && u >= 0 && u < tiles.width};
    }

    /// The row and the first column that the running thread filters along, if there is a row left for it.
    struct Run {
        int row, first;
        bool exists;
        [[nodiscard]] __device__ std::size_t in(int n) const { return std::size_t(row * Tiles::in_stride + first + n); }
        [[nodiscard]] __device__ std::size_t along(int n) const {
            return std::size_t(row * Tiles::along_stride + first + n);
        }
    };
    [[nodiscard]] __device__ static Run run() {
        const int row = int(threadIdx.x) / Tiles::runs;
        return {row, int(threadIdx.x) % Tiles::runs * Tiles::run, row < Tiles::halo_rows};
    }
};

/// Adds input n of a row or a column to the outputs whose windows contain it.
template <int n, int Outputs, class T>
__device__ void correlate(const SsimWindow<T>& window, T value, T (&out)[Outputs]) {
    unrolled<Outputs>([&]<int k>() {
        if constexpr (0 <= n - k && n - k < SsimWindow<T>::size) out[k] += window.taps[n - k] * value;
    });
}

/// Filters maps along the row of the running thread. load(place, values) fetches the maps' inputs.
template <int Maps, class T, class Along, class Load>
__device__ void filter_row(const SsimWindow<T>& window, Along& along, const Load& load) {
    using Tiles = PhotometricTiles<T>;
    const auto run = PhotometricTile<T>::run();
    if (!run.exists) return;
    T out[Maps][Tiles::run] = {};
    unrolled<Tiles::run + 2 * Tiles::radius>([&]<int n>() {
        T values[Maps];
        load(run.in(n), values);
        unrolled<Maps>([&]<int m>() { correlate<n>(window, values[m], out[m]); });
    });
    for (int m = 0; m < Maps; ++m)
        for (int k = 0; k < Tiles::run; ++k) along[std::size_t(m * Tiles::along_size) + run.along(k)] = out[m][k];
}

/// Filters maps down the column of the running thread: out[m][r] for its pixels r.
template <int Maps, class T, class Along>
__device__ void filter_column(const SsimWindow<T>& window, const PhotometricTile<T>& tile, const Along& along,
                              T (&out)[Maps][PhotometricTiles<T>::rows_of_thread]) {
    using Tiles = PhotometricTiles<T>;
    for (int m = 0; m < Maps; ++m) {
        for (int r = 0; r < Tiles::rows_of_thread; ++r) out[m][r] = T(0);
        const int first = m * Tiles::along_size + tile.first_row * Tiles::along_stride + tile.column;
        unrolled<Tiles::rows_of_thread + 2 * Tiles::radius>([&]<int n>() {
            const T value = along[std::size_t(first + n * Tiles::along_stride)];
            correlate<n>(window, value, out[m]);
        });
    }
}

} // namespace gsh::cuda::detail
