// SPDX-License-Identifier: Apache-2.0
/// @file  The hash grid on a GPU: one thread per point and level forward, one group of threads per entry backward.
///
/// In mixed precision, forward reads a copy of the table in fp16. It makes the copy itself, of the entries that the
/// points use: so the copy is never older than the table, whatever has changed it. In training it is made once a step.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/divisor.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/half_row.cuh>
#include <gsh/field/cuda/hash_rows.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/field/hash_lists.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace gsh {

/// The lists of hash_lists.hpp on the device, and working storage of backward: with 16 levels 300 to 600 bytes per
/// point.
template <std::floating_point T>
struct HashScratch<cuda::Device, T> {
    template <class V>
    using Buffer = cuda::Device::Buffer<V>;
    Buffer<std::uint32_t> points, segments, entries, item_begin;
    Buffer<detail::HashItem<T>> items;
    Buffer<detail::HashTask> sum_tasks, gather_tasks;
    // Passes of one device follow each other, so they may share these:
    mutable Buffer<T> sums;              ///< [S, 8, Features]
    mutable Buffer<std::uint32_t> table; ///< mixed precision: [entry_count, Features / 2], of touched entries alone
};

namespace cuda {

namespace detail {

using gsh::detail::HashItem, gsh::detail::HashLists, gsh::detail::HashTask;

template <class T>
struct SplitPoint {
    Span<const vec3<T>> points;
    Span<T> x, y, z;
    __device__ void operator()(std::size_t i) const {
        const vec3<T> p = points[i];
        x[i] = p.x, y[i] = p.y, z[i] = p.z;
    }
};

/// The touched entries of a table, rounded.
template <std::size_t F>
struct HashRound {
    static constexpr unsigned block_size = 256;
    Span<const std::uint32_t> touched;
    Span<const Row<float, F>> table;
    Span<Fp16Row<F>> rounded;

    __device__ void operator()() const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        if (i >= touched.size()) return;
        const std::uint32_t entry = touched[i];
        rounded[entry] = Fp16Row<F>::rounded(table[entry]);
    }
};

/// Level after level, so that the entries of one level are in the caches; neighbouring threads have neighbouring points
/// and read the same entries. Entries and features are rows of T or of 16 bits.
template <class Grid, class T, class Entry, class Feature>
struct HashEncode {
    static constexpr unsigned block_size = 256;
    using R = Row<T, Grid::feature_count>;
    Grid grid;
    Span<const T> x, y, z;
    Span<const Entry> table;
    HashWeights<T> weights;
    HashRows<Feature> features;
    Write mode;
    Divisor chunks; ///< blocks per level

    __device__ void operator()() const {
        const unsigned l = chunks.quotient(blockIdx.x);
        const unsigned i = chunks.remainder(blockIdx.x, l) * block_size + threadIdx.x;
        if (i >= x.size()) return;
        const vec3<T> point(x[i], y[i], z[i]); // on its way while the weight is
        const T level_weight = weights(l, i);
        if (level_weight == T(0) && mode == Write::add) return;
        R sum{};
        if (level_weight != T(0)) {
            const HashLevel& level = grid.level(static_cast<int>(l));
            sum = level.hashed ? interpolated<true>(level, point) : interpolated<false>(level, point);
            for (int f = 0; f < Grid::feature_count; ++f) sum[f] *= level_weight;
        }
        Feature& to = features.rows[features.begin(l) + i * features.stride()];
        if (mode == Write::add) {
            const R before = wide(to);
            for (int f = 0; f < Grid::feature_count; ++f) sum[f] += before[f];
        }
        to = stored<Feature>(sum);
    }

private:
    template <bool Hashed>
    [[nodiscard]] __device__ R interpolated(const HashLevel& level, const vec3<T>& point) const {
        const HashCell<T> cell = level.template cell<Hashed>(point);
        Entry entries[8]; // all eight reads are under way before the first is used
        for (int c = 0; c < 8; ++c) entries[c] = table[level.template index<Hashed>(cell, c)];
        R sum{};
        for (int c = 0; c < 8; ++c) {
            const T weight = cell.weight(c);
            const R entry = wide(entries[c]);
            for (int f = 0; f < Grid::feature_count; ++f) sum[f] += weight * entry[f];
        }
        return sum;
    }
};

/// Sums of the corners of each segment, by eight threads. Gradients are rows of T or of 16 bits.
template <class Grid, class T, class Gradient>
struct HashSumCells {
    static constexpr unsigned block_size = 256;
    using R = Row<T, Grid::feature_count>;
    Grid grid;
    Span<const T> x, y, z;
    HashWeights<T> weights;
    HashRows<const Gradient> gradients;
    Span<const HashTask> tasks;
    Span<const std::uint32_t> points, segments;
    Span<R> sums;

    __device__ void operator()() const {
        const HashTask task = tasks[blockIdx.x];
        const unsigned group = threadIdx.x / 8, lane = threadIdx.x % 8;
        const HashLevel& level = grid.level(task.level);
        const std::uint32_t first_row = gradients.begin(task.level), segment = task.first + group;
        R corners[8] = {};
        if (group < task.count) {
            const std::uint32_t end = segments[segment + 1];
            std::uint32_t k = segments[segment] + lane, next = k < end ? points[k] : 0;
            for (; k < end; k += 8) {
                const std::uint32_t i = next;
                if (k + 8 < end) next = points[k + 8]; // while this point is read
                const R gradient = wide(gradients.rows[first_row + i * gradients.stride()]);
                const HashCell<T> cell = level.cell(vec3<T>(x[i], y[i], z[i]));
                const T level_weight = weights(task.level, i);
                for (int c = 0; c < 8; ++c) {
                    const T weight = cell.weight(c) * level_weight;
                    for (int f = 0; f < Grid::feature_count; ++f) corners[c][f] += weight * gradient[f];
                }
            }
        }
        // Each exchange leaves a thread half the corners, summed over twice the threads; at the end it has one.
        exchange<4>(corners, lane);
        exchange<2>(corners, lane);
        exchange<1>(corners, lane);
        if (group < task.count) sums[8 * segment + lane] = corners[0];
    }

private:
    template <int Half>
    __device__ static void exchange(R (&corners)[8], unsigned lane) {
        const bool upper = (lane & unsigned(Half)) != 0;
        for (int c = 0; c < Half; ++c) {
            for (int f = 0; f < Grid::feature_count; ++f) {
                const T low = corners[c][f], high = corners[c + Half][f];
                corners[c][f] = (upper ? high : low) + __shfl_xor_sync(all_lanes, upper ? low : high, Half);
            }
        }
    }
};

/// Adds its list to each entry, by the threads of its task. Gradients are rows of T or of 16 bits.
template <class T, std::size_t F, class Gradient>
struct HashGather {
    static constexpr unsigned block_size = 128;
    static constexpr unsigned ahead = 4; ///< items that a thread reads at a time: a usual list takes one turn
    using R = Row<T, F>;
    HashRows<const Gradient> gradients;
    Span<const R> sums;
    Span<const HashTask> tasks;
    Span<const std::uint32_t> entries, item_begin;
    Span<const HashItem<T>> items;
    Span<R> dL_dtable;

    __device__ void operator()() const {
        const HashTask task = tasks[blockIdx.x];
        const unsigned group = threadIdx.x >> task.lane_bits, lanes = 1u << task.lane_bits;
        const unsigned lane = threadIdx.x & (lanes - 1);
        const bool active = group < task.count;
        const std::uint32_t e = task.first + group;
        const std::uint32_t first_row = gradients.begin(task.level);
        R sum{}, before{};
        std::uint32_t entry = 0;
        if (active && lane == 0) before = dL_dtable[entry = entries[e]]; // while the items are read
        if (active) {
            const std::uint32_t end = item_begin[e + 1];
            for (std::uint32_t first = item_begin[e] + lane; first < end; first += ahead * lanes) {
                HashItem<T> some[ahead]{};
                R row[ahead]{};
                for (unsigned n = 0; n < ahead; ++n)
                    if (first + n * lanes < end) some[n] = items[first + n * lanes];
                for (unsigned n = 0; n < ahead; ++n)
                    if (first + n * lanes < end)
                        row[n] = task.summed ? sums[some[n].row]
                                             : wide(gradients.rows[first_row + some[n].row * gradients.stride()]);
                for (unsigned n = 0; n < ahead; ++n)
                    for (std::size_t f = 0; f < F; ++f) sum[f] += some[n].weight * row[n][f];
            }
        }
        for (int distance = static_cast<int>(lanes / 2); distance > 0; distance /= 2)
            for (std::size_t f = 0; f < F; ++f) sum[f] += __shfl_xor_sync(all_lanes, sum[f], distance);
        if (!active || lane != 0) return;
        for (std::size_t f = 0; f < F; ++f) sum[f] += before[f];
        dL_dtable[entry] = sum;
    }
};

} // namespace detail

/// The lists are made on the host: this is set-up, and waits. 170,000 points take about half a second.
template <class Grid, class T, class Query>
void hash_prepare(Device& device, const Grid& grid, Span<const vec3<T>> points, const LevelWeights<T>& weights,
                  Query& query) {
    device.for_each(points.size(), detail::SplitPoint<T>{points, query.x, query.y, query.z});
    device.copy(weights.coarse, query.coarse);
    device.copy(weights.fine, query.fine);

    const auto fetch = [&](const auto& from, auto host) {
        host.resize(from.size());
        device.download(from, Span(host.data(), host.size()));
        return host;
    };
    const std::vector<vec3<T>> positions = fetch(points, std::vector<vec3<T>>());
    const std::vector<T> coarse = fetch(weights.coarse, std::vector<T>()), fine = fetch(weights.fine, std::vector<T>());
    const detail::HashLists<T, Grid::level_count> lists(grid, positions, {weights.split, coarse, fine});

    query.touched_begin = lists.touched_begin;
    query.lookups = lists.lookups;
    assign(device, lists.touched, query.touched);
    HashScratch<Device, T>& scratch = query.scratch;
    assign(device, lists.points, scratch.points);
    assign(device, lists.segments, scratch.segments);
    assign(device, lists.sum_tasks, scratch.sum_tasks);
    assign(device, lists.entries, scratch.entries);
    assign(device, lists.item_begin, scratch.item_begin);
    assign(device, lists.items, scratch.items);
    assign(device, lists.gather_tasks, scratch.gather_tasks);
    scratch.sums.resize((lists.segments.size() - 1) * 8 * Grid::feature_count);
}

namespace detail {

/// Whether a grid's table is read in fp16.
template <class Grid, class T>
inline constexpr bool hash_has_half = std::same_as<T, float> && Grid::feature_count % 2 == 0;

template <class Grid, class T, class Query, class Entry, class Feature>
void hash_encode(Device& device, const Grid& grid, Span<const Entry> table, const Query& query,
                 const HashRows<Feature>& features, Write mode) {
    using Kernel = HashEncode<Grid, T, Entry, Feature>;
    const std::size_t chunks = chunk_count(query.size(), Kernel::block_size);
    device.launch(Grid::level_count * chunks,
                  Kernel{grid, query.x, query.y, query.z, table, HashWeights<T>(query.weights()), features, mode,
                         Divisor(static_cast<std::uint32_t>(chunks))});
}

/// In mixed precision, from the table in fp16.
template <class Grid, class Query, class Feature>
void hash_encode_half(Device& device, const Grid& grid, Span<const float> table, const Query& query,
                      const HashRows<Feature>& features, Write mode) {
    constexpr std::size_t F = Grid::feature_count;
    const HashScratch<Device, float>& scratch = query.scratch;
    scratch.table.resize(table.size() / 2);
    const Span<Fp16Row<F>> rounded = as_half_rows<Fp16Row<F>>(scratch.table);
    device.launch(chunk_count(query.touched.size(), HashRound<F>::block_size),
                  HashRound<F>{query.touched, as_rows<F>("HashGrid::forward", table), rounded});
    hash_encode<Grid, float>(device, grid, Span<const Fp16Row<F>>(rounded), query, features, mode);
}

template <class T, class Grid, class Gradient, class Query>
void hash_add_gradients(Device& device, const Grid& grid, const HashRows<const Gradient>& gradients, const Query& query,
                        Span<T> dL_dtable) {
    constexpr std::size_t F = Grid::feature_count;
    constexpr std::string_view where = "HashGrid::backward";
    const HashScratch<Device, T>& scratch = query.scratch;
    const Span<Row<T, F>> sums = as_rows<F>(where, Span<T>(scratch.sums));
    device.launch(scratch.sum_tasks.size(), HashSumCells<Grid, T, Gradient>{
                                                grid, query.x, query.y, query.z, HashWeights<T>(query.weights()),
                                                gradients, scratch.sum_tasks, scratch.points, scratch.segments, sums});
    device.launch(scratch.gather_tasks.size(),
                  HashGather<T, F, Gradient>{gradients, sums, scratch.gather_tasks, scratch.entries, scratch.item_begin,
                                             scratch.items, as_rows<F>(where, dL_dtable)});
}

} // namespace detail

template <class Grid, class T, class Query>
void hash_forward(Device& device, const Grid& grid, Span<const T> table, const Query& query, FeatureView<T> features,
                  Write mode) {
    constexpr std::size_t F = Grid::feature_count;
    constexpr std::string_view where = "HashGrid::forward";
    const auto rows = detail::HashRows<detail::Row<T, F>>::template of<T, F>(where, features);
    if constexpr (detail::hash_has_half<Grid, T>)
        if (device.precision() == Precision::mixed)
            return detail::hash_encode_half(device, grid, table, query, rows, mode);
    detail::hash_encode<Grid, T>(device, grid, detail::as_rows<F>(where, table), query, rows, mode);
}

template <class Grid, class T, class Query>
void hash_backward(Device& device, const Grid& grid, FeatureView<const T> dL_dfeatures, const Query& query,
                   Span<T> dL_dtable) {
    constexpr std::size_t F = Grid::feature_count;
    detail::hash_add_gradients<T>(
        device, grid,
        detail::HashRows<const detail::Row<T, F>>::template of<const T, F>("HashGrid::backward", dL_dfeatures), query,
        dL_dtable);
}

} // namespace cuda

} // namespace gsh
