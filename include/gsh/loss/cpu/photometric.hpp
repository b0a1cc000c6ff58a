// SPDX-License-Identifier: Apache-2.0
/// @file  The photometric loss on the CPU: tiles that fit the first-level cache, and vectorised loops.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/photometric_cache.hpp>
#include <gsh/loss/ssim.hpp>
#include <gsh/math/wide.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct PhotometricScratch<B, T> {
    typename B::template Buffer<T> partials;          ///< [tiles, 3, tile rows, tile columns] of the SSIM term;
                                                      ///< unspecified in tiles that are not active
    typename B::template Buffer<std::uint8_t> active; ///< [tiles] 1 where some window of the tile contains a difference
    typename B::template Buffer<double> sums;         ///< [tiles, 3] sums of |render - truth|, of 1 - SSIM and of
                                                      ///< (render - truth)²
};

namespace cpu::inline GSH_ISA {

namespace detail {

/// The tiles that cover an image, and the positions of their pixels.
struct PhotometricTiles {
    static constexpr int rows = 32, columns = 64;
    static constexpr int radius = SsimWindow<float>::radius;
    static constexpr int halo_rows = rows + 2 * radius, halo_columns = columns + 2 * radius;
    static constexpr int row_start = 16;                          ///< place of a row's first column, after its halo
    static constexpr int row_length = columns + 2 * row_start;    ///< of a row with its halo and padding
    static constexpr std::size_t area = std::size_t(rows) * columns;

    int channels, height, width;
    int across = (width + columns - 1) / columns, down = (height + rows - 1) / rows;

    struct Tile {
        int channel, j, i;      ///< channel, tile row, tile column
        int y, x;               ///< first pixel
        int height, width;      ///< size of the part inside the image
    };

    [[nodiscard]] std::size_t count() const { return std::size_t(channels) * std::size_t(down) * std::size_t(across); }
    [[nodiscard]] std::size_t index(int channel, int j, int i) const {
        return (std::size_t(channel) * std::size_t(down) + std::size_t(j)) * std::size_t(across) + std::size_t(i);
    }
    [[nodiscard]] Tile operator[](std::size_t index) const {
        const int i = int(index % std::size_t(across)), rest = int(index / std::size_t(across));
        const int j = rest % down, y = j * rows, x = i * columns;
        return {rest / down, j, i, y, x, std::min(rows, height - y), std::min(columns, width - x)};
    }
    /// True if the tile exists and one of its windows contains a difference.
    [[nodiscard]] bool active(Span<const std::uint8_t> flags, int channel, int j, int i) const {
        return j >= 0 && j < down && i >= 0 && i < across && flags[index(channel, j, i)] != 0;
    }
};

/// The pixels whose windows count for SSIM.
struct WindowRegion {
    int y0, y1, x0, x1;

    WindowRegion(int height, int width, bool whole_windows) {
        const int margin = whole_windows ? PhotometricTiles::radius : 0;
        y0 = x0 = margin, y1 = height - margin, x1 = width - margin;
    }
    [[nodiscard]] std::size_t area() const { return std::size_t(y1 - y0) * std::size_t(x1 - x0); }
};

/// True if some window of the tile contains a pixel in which the images differ.
template <class T>
bool windows_differ(const ImageView<const T>& a, const ImageView<const T>& b, const PhotometricTiles::Tile& tile) {
    constexpr int radius = PhotometricTiles::radius;
    const int x0 = std::max(tile.x - radius, 0), x1 = std::min(tile.x + tile.width + radius, a.width);
    const int y0 = std::max(tile.y - radius, 0), y1 = std::min(tile.y + tile.height + radius, a.height);
    for (int y = y0; y < y1; ++y) {
        const T *p = a.row(tile.channel, y), *q = b.row(tile.channel, y);
        int differences = 0;
        for (int x = x0; x < x1; ++x) differences += p[x] - q[x] != T(0); // NaN differs
        if (differences) return true;
    }
    return false;
}

/// out[x] = sum_k taps[k] in[k * stride + x]. Stride 1 filters along a row, the length of a row across rows.
template <int Columns, int Stride, class T>
void correlate(const T (&taps)[SsimWindow<T>::size], const T* __restrict in, T* __restrict out) {
    for (int x = 0; x < Columns; ++x) {
        T sum = taps[5] * in[5 * Stride + x];
        sum += taps[4] * (in[4 * Stride + x] + in[6 * Stride + x]);
        sum += taps[3] * (in[3 * Stride + x] + in[7 * Stride + x]);
        sum += taps[2] * (in[2 * Stride + x] + in[8 * Stride + x]);
        sum += taps[1] * (in[1 * Stride + x] + in[9 * Stride + x]);
        sum += taps[0] * (in[0 * Stride + x] + in[10 * Stride + x]);
        out[x] = sum;
    }
}

/// Loss and partial derivatives of one tile. The moments are filtered along rows, then down columns.
template <class T>
struct PhotometricForwardTile {
    using Tiles = PhotometricTiles;
    static constexpr int moments = 4; // s, d, s², d²

    alignas(64) T in[2][moments][Tiles::row_length];                // two rows
    alignas(64) T along[moments][Tiles::halo_rows][Tiles::columns]; // filtered along rows
    alignas(64) T across[moments][Tiles::columns];                  // and down columns, one row
    alignas(64) T l1[Tiles::columns], dssim[Tiles::columns], squares[Tiles::columns]; // sums down each column
    alignas(64) T loss[Tiles::columns];

    void run(const SsimWindow<T>& window, const ImageView<const T>& a, const ImageView<const T>& b,
             const Tiles::Tile& tile, bool with_ssim, const WindowRegion& region, T* partials, double* sums) {
        std::fill(l1, l1 + Tiles::columns, T(0));
        std::fill(dssim, dssim + Tiles::columns, T(0));
        std::fill(squares, squares + Tiles::columns, T(0));
        for (int y = 0; y < tile.height; ++y) {
            const T* __restrict p = a.row(tile.channel, tile.y + y) + tile.x;
            const T* __restrict q = b.row(tile.channel, tile.y + y) + tile.x;
            for (int x = 0; x < tile.width; ++x) {
                const T d = p[x] - q[x];
                l1[x] += std::fabs(d), squares[x] += d * d;
            }
        }
        if (with_ssim) {
            filter_rows(window, a, b, tile);
            for (int y = 0; y < Tiles::rows; ++y) finish_row(window, tile, region, y, partials);
        }
        for (int x = 0; x < tile.width; ++x) {
            sums[0] += double(l1[x]), sums[1] += double(dssim[x]), sums[2] += double(squares[x]);
        }
    }

private:
    void filter_rows(const SsimWindow<T>& window, const ImageView<const T>& a, const ImageView<const T>& b,
                     const Tiles::Tile& tile) {
        constexpr int radius = Tiles::radius;
        const int x0 = std::max(tile.x - radius, 0), x1 = std::min(tile.x + Tiles::columns + radius, a.width);
        const int shift = Tiles::row_start - tile.x; // image column + shift = column of `in`
        for (auto& rows : in)
            for (auto& row : rows) std::fill(std::begin(row), std::end(row), T(0));
        const auto inside = [&](int r) {
            return r < Tiles::halo_rows && tile.y + r >= radius && tile.y + r - radius < a.height;
        };
        const auto read = [&](int r) {
            const T* __restrict p = a.row(tile.channel, tile.y + r - radius) + x0;
            const T* __restrict q = b.row(tile.channel, tile.y + r - radius) + x0;
            auto& row = in[r % 2];
            T* __restrict s = row[0] + (shift + x0);
            T* __restrict d = row[1] + (shift + x0);
            T* __restrict ss = row[2] + (shift + x0);
            T* __restrict dd = row[3] + (shift + x0);
            for (int x = 0; x < x1 - x0; ++x) {
                const T sum = p[x] + q[x], difference = p[x] - q[x];
                s[x] = sum, d[x] = difference, ss[x] = sum * sum, dd[x] = difference * difference;
            }
        };
        // A row is read one round before it is filtered: loads that overlap several recent stores wait for them.
        if (inside(0)) read(0);
        for (int r = 0; r < Tiles::halo_rows; ++r) {
            if (inside(r + 1)) read(r + 1);
            for (int m = 0; m < moments; ++m) {
                T* const out = along[m][r];
                if (inside(r)) correlate<Tiles::columns, 1>(window.taps, in[r % 2][m] + Tiles::row_start - radius, out);
                else std::fill(out, out + Tiles::columns, T(0));
            }
        }
    }

    /// Filters down columns and evaluates SSIM; pixels outside the region get partials of zero.
    void finish_row(const SsimWindow<T>& window, const Tiles::Tile& tile, const WindowRegion& region, int y,
                    T* partials) {
        T* __restrict mean = partials + y * Tiles::columns;
        T* __restrict ss = mean + Tiles::area;
        T* __restrict dd = ss + Tiles::area;
        const bool row_counts = tile.y + y >= region.y0 && tile.y + y < region.y1;
        const int valid = row_counts ? std::clamp(region.x1 - tile.x, 0, Tiles::columns) : 0;
        const int first = std::clamp(region.x0 - tile.x, 0, valid);
        if (valid) {
            for (int m = 0; m < moments; ++m)
                correlate<Tiles::columns, Tiles::columns>(window.taps, along[m][y], across[m]);
            for (int x = 0; x < Tiles::columns; ++x) {
                SsimPartials<T> partial;
                loss[x] = ssim_loss<T>({across[0][x], across[1][x], across[2][x], across[3][x]}, partial);
                mean[x] = partial.mean, ss[x] = partial.ss, dd[x] = partial.dd;
            }
            for (int x = first; x < valid; ++x) dssim[x] += loss[x];
        }
        for (int x = 0; x < first; ++x) mean[x] = ss[x] = dd[x] = T(0);
        for (int x = valid; x < Tiles::columns; ++x) mean[x] = ss[x] = dd[x] = T(0);
    }
};

/// Gradient of one tile: the partials around it, filtered by the same (symmetric) window.
template <class T>
struct PhotometricBackwardTile {
    using Tiles = PhotometricTiles;
    static constexpr int maps = 3; // dL_dmean, dL_dss, dL_ddd

    alignas(64) T in[2][Tiles::row_length];
    alignas(64) T along[maps][Tiles::halo_rows][Tiles::columns];
    alignas(64) T across[maps][Tiles::columns];

    void run(const SsimWindow<T>& window, const ImageView<const T>& a, const ImageView<const T>& b, const Tiles& tiles,
             const Tiles::Tile& tile, Span<const T> partials, Span<const std::uint8_t> active, T ssim_scale,
             T l1_scale, const ImageView<T>& dL_da) {
        const bool with_ssim = ssim_scale != T(0);
        if (with_ssim) filter_rows(window, tiles, tile, partials, active);
        for (int y = 0; y < tile.height; ++y) {
            const T* __restrict p = a.row(tile.channel, tile.y + y) + tile.x;
            const T* __restrict q = b.row(tile.channel, tile.y + y) + tile.x;
            T* __restrict out = dL_da.row(tile.channel, tile.y + y) + tile.x;
            const auto slope = [l1_scale](T d) { return d > T(0) ? l1_scale : d < T(0) ? -l1_scale : T(0); };
            if (!with_ssim) {
                for (int x = 0; x < tile.width; ++x) out[x] += slope(p[x] - q[x]);
                continue;
            }
            for (int m = 0; m < maps; ++m)
                correlate<Tiles::columns, Tiles::columns>(window.taps, along[m][y], across[m]);
            for (int x = 0; x < tile.width; ++x) {
                const T s = p[x] + q[x], d = p[x] - q[x];
                out[x] += ssim_scale * (across[0][x] + T(2) * (s * across[1][x] + d * across[2][x])) + slope(d);
            }
        }
    }

private:
    void filter_rows(const SsimWindow<T>& window, const Tiles& tiles, const Tiles::Tile& tile, Span<const T> partials,
                     Span<const std::uint8_t> active) {
        using W = Wide<T>;
        constexpr int radius = Tiles::radius;
        const auto read = [&](int line) { // of all halo rows of all maps
            const int m = line / Tiles::halo_rows, r = line % Tiles::halo_rows;
            const int y = tile.y + r - radius, j = y < 0 ? -1 : y / Tiles::rows, row = y - j * Tiles::rows;
            const auto source = [&](int i) -> const T* { // this row of a tile beside, or null where it is 0
                if (!tiles.active(active, tile.channel, j, i)) return nullptr;
                return partials.data() + (tiles.index(tile.channel, j, i) * maps + std::size_t(m)) * Tiles::area +
                       row * Tiles::columns;
            };
            T* const to = in[line % 2] + Tiles::row_start;
            const T *const left = source(tile.i - 1), *const middle = source(tile.i), *const right = source(tile.i + 1);
            for (int x = 0; x < radius; ++x) to[x - radius] = left ? left[Tiles::columns - radius + x] : T(0);
            for (int x = 0; x < Tiles::columns; x += int(W::width))
                (middle ? W::load(middle + x) : W(T(0))).store(to + x);
            constexpr int ahead = 8 * Tiles::columns; // rows of a tile follow each other in memory
            for (int x = 0; middle && x < Tiles::columns; x += int(64 / sizeof(T))) prefetch(middle + ahead + x);
            if (left) prefetch(left + ahead + Tiles::columns - radius);
            if (right) prefetch(right + ahead);
            for (int x = 0; x < radius; ++x) to[Tiles::columns + x] = right ? right[x] : T(0);
        };
        // As in forward, a row is read one round before it is filtered.
        constexpr int lines = maps * Tiles::halo_rows;
        read(0);
        for (int line = 0; line < lines; ++line) {
            if (line + 1 < lines) read(line + 1);
            correlate<Tiles::columns, 1>(window.taps, in[line % 2] + Tiles::row_start - radius,
                                         along[line / Tiles::halo_rows][line % Tiles::halo_rows]);
        }
    }
};

} // namespace detail

/// Fills the cache with values and partial derivatives. One chunk is one tile of one channel.
template <CpuBackend B, class T>
void photometric_forward(B& backend, const ImageView<const T>& render, const ImageView<const T>& truth,
                         const PhotometricParams<T>& params, PhotometricCache<B, T>& cache) {
    using Tiles = detail::PhotometricTiles;
    const Tiles tiles{render.channels, render.height, render.width};
    const bool with_ssim = cache.with_ssim;
    PhotometricScratch<B, T>& scratch = cache.scratch;
    scratch.active.resize(tiles.count());
    scratch.sums.resize(3 * tiles.count());
    scratch.partials.resize(with_ssim ? 3 * Tiles::area * tiles.count() : 0);

    const SsimWindow<T> window;
    const detail::WindowRegion region(render.height, render.width, params.whole_windows);
    backend.for_chunks(tiles.count(), 1, [&](std::size_t index, std::size_t, std::size_t) {
        const Tiles::Tile tile = tiles[index];
        double* sums = scratch.sums.data() + 3 * index;
        sums[0] = sums[1] = sums[2] = 0;
        scratch.active[index] = !params.skip_equal || detail::windows_differ(render, truth, tile);
        if (!scratch.active[index]) return; // 1 - SSIM is 0 in each window; the partials are 0 or multiplied by 0
        detail::PhotometricForwardTile<T> work;
        work.run(window, render, truth, tile, with_ssim, region,
                 with_ssim ? scratch.partials.data() + 3 * Tiles::area * index : nullptr, sums);
    });

    double l1 = 0, dssim = 0, squares = 0;
    for (std::size_t i = 0; i < tiles.count(); ++i)
        l1 += scratch.sums[3 * i], dssim += scratch.sums[3 * i + 1], squares += scratch.sums[3 * i + 2];
    const double count = double(std::max<std::size_t>(render.size(), 1)), weight = double(params.ssim_weight);
    const double windows = double(std::max<std::size_t>(std::size_t(render.channels) * region.area(), 1));
    l1 /= count, dssim /= windows;
    cache.values[0] = (1 - weight) * l1 + weight * dssim;
    cache.values[1] = l1;
    cache.values[2] = with_ssim ? 1 - dssim : std::numeric_limits<double>::quiet_NaN();
    cache.values[3] = squares / count;
}

template <CpuBackend B, class T>
void photometric_backward(B& backend, const ImageView<const T>& render, const ImageView<const T>& truth, T dL_dloss,
                          const PhotometricParams<T>& params, const PhotometricCache<B, T>& cache,
                          const ImageView<T>& dL_drender) {
    using Tiles = detail::PhotometricTiles;
    const PhotometricScratch<B, T>& scratch = cache.scratch;
    const Tiles tiles{render.channels, render.height, render.width};
    const T per_element = dL_dloss / T(std::max<std::size_t>(render.size(), 1));
    const detail::WindowRegion region(render.height, render.width, params.whole_windows);
    const T per_window = dL_dloss / T(std::max<std::size_t>(std::size_t(render.channels) * region.area(), 1));
    const T ssim_scale = params.ssim_weight * per_window, l1_scale = (T(1) - params.ssim_weight) * per_element;

    const SsimWindow<T> window;
    backend.for_chunks(tiles.count(), 1, [&](std::size_t index, std::size_t, std::size_t) {
        const Tiles::Tile tile = tiles[index];
        bool reached = false; // true if windows of an active tile reach this one
        for (int j = tile.j - 1; j <= tile.j + 1; ++j)
            for (int i = tile.i - 1; i <= tile.i + 1; ++i)
                reached = reached || tiles.active(scratch.active, tile.channel, j, i);
        if (!reached) return;
        detail::PhotometricBackwardTile<T> work;
        work.run(window, render, truth, tiles, tile, scratch.partials, scratch.active, ssim_scale, l1_scale,
                 dL_drender);
    });
}

} // namespace cpu

} // namespace gsh
