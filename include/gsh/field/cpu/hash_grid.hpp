// SPDX-License-Identifier: Apache-2.0
/// @file  The hash grid on the CPU, level by level, so that the entries of one level stay in the cache.
///
/// Corner indices and weights are recomputed in vector registers for a block of points at a time. This costs less than
/// reading them from memory. One thread per level scatters the gradient of the table, in the order of the points: this
/// needs no atomics and is bit-identical at any thread count.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_grid.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh {

/// Corners and weights are recomputed in every pass.
template <CpuBackend B, std::floating_point T>
struct HashScratch<B, T> {};

namespace cpu::inline GSH_ISA {

namespace detail {

/// Cells of up to `capacity` points on one level. Neighbours in a cell form a run. Points are sorted along a curve
/// through space, so a cell of a coarse level holds many in a row, and its corners are read once for all of them.
template <class T>
struct HashBlock {
    static constexpr std::size_t capacity = 256;
    alignas(64) std::uint32_t index[8][capacity];
    alignas(64) T fraction[3][capacity]; ///< position inside the cell
    std::uint32_t starts[capacity + 1];  ///< first point of each run, then the number of points
    std::size_t run_count;
    const T* level_weight; ///< weights of the block's points, or null: all 1

    void fill(const HashLevel& level, const T* x, const T* y, const T* z, std::size_t count) {
        level.hashed ? fill<true>(level, x, y, z, count) : fill<false>(level, x, y, z, count);
    }

    /// Prefetches the entries of a run some way ahead; on the fine levels each has a cache line of its own.
    template <std::size_t Features>
    void prefetch_ahead(const T* entries, std::size_t run) const {
        constexpr std::size_t distance = 24; // covers the third-level cache's latency
        if (run + distance >= run_count || !counts(starts[run + distance])) return;
        for (int corner = 0; corner < 8; ++corner)
            prefetch(entries + index[corner][starts[run + distance]] * Features);
    }

    /// True unless the level has weight 0 at point i. All points of a run agree.
    [[nodiscard]] bool counts(std::size_t i) const { return !level_weight || level_weight[i] != T(0); }

private:
    template <bool Hashed>
    void fill(const HashLevel& level, const T* x, const T* y, const T* z, std::size_t count) {
        using Number = IndexOf<T>;
        alignas(64) Number cells[3][capacity];
        for (std::size_t i = 0; i < count; ++i) {
            const HashCell<T> cell = level.cell<Hashed>(vec3<T>(x[i], y[i], z[i]));
            for (int corner = 0; corner < 8; ++corner)
                index[corner][i] = static_cast<std::uint32_t>(level.index<Hashed>(cell, corner));
            cells[0][i] = cell.x[0], cells[1][i] = cell.y[0], cells[2][i] = cell.z[0];
            for (int axis = 0; axis < 3; ++axis) fraction[axis][i] = cell.fraction[axis];
        }
        alignas(64) std::uint8_t starts_run[capacity];
        starts_run[0] = 1;
        for (std::size_t i = 1; i < count; ++i)
            starts_run[i] = (cells[0][i] != cells[0][i - 1]) | (cells[1][i] != cells[1][i - 1]) |
                            (cells[2][i] != cells[2][i - 1]);
        if (level_weight)
            for (std::size_t i = 1; i < count; ++i)
                starts_run[i] |= (level_weight[i] != T(0)) != (level_weight[i - 1] != T(0));
        run_count = 0;
        for (std::size_t i = 0; i < count; ++i) {
            starts[run_count] = static_cast<std::uint32_t>(i);
            run_count += starts_run[i];
        }
        starts[run_count] = static_cast<std::uint32_t>(count);
    }
};

/// Calls body(block, first, count) for blocks of the query's points in [begin, end), with the cells of level l filled
/// in. For a block in which every point has weight 0 on the level, it calls skipped(first, count) instead.
template <class T, class Grid, class Query, class Body, class Skipped>
void for_hash_blocks(const Grid& grid, std::size_t l, const Query& query, std::size_t begin, std::size_t end,
                     const Body& body, const Skipped& skipped) {
    const Span<const T> level_weights = query.weights().of_level(static_cast<int>(l));
    HashBlock<T> block;
    for (std::size_t first = begin; first < end; first += block.capacity) {
        const std::size_t count = std::min(block.capacity, end - first);
        block.level_weight = level_weights.empty() ? nullptr : level_weights.data() + first;
        if (block.level_weight &&
            std::all_of(block.level_weight, block.level_weight + count, [](T w) { return w == T(0); })) {
            skipped(first, count);
            continue;
        }
        block.fill(grid.level(static_cast<int>(l)), query.x.data() + first, query.y.data() + first,
                   query.z.data() + first, count);
        body(block, first, count);
    }
}

/// The features of an entry in the first lanes of a row. Sums of them do without multiply_add, so they are the same on
/// every machine.
template <class T, std::size_t Features>
using HashRow = Wide<T, std::bit_ceil(Features)>;

/// Features of points [begin, end) on level l. out is the address for point `begin`; consecutive points are `stride`
/// numbers apart.
///
/// The trilinear sum is taken axis by axis, x first. In a run, the corners and their differences along x stay in
/// registers.
template <class T, class Grid, class Query>
void hash_encode(const Grid& grid, std::size_t l, const T* entries, const Query& query, std::size_t begin,
                 std::size_t end, T* out, std::size_t stride, Write mode) {
    constexpr std::size_t width = Grid::feature_count;
    using Row = HashRow<T, width>;
    const auto encode = [&](auto adds) {
        for_hash_blocks<T>(
            grid, l, query, begin, end,
            [&](const HashBlock<T>& block, std::size_t first, std::size_t) {
                T* const to = out + (first - begin) * stride;
                const auto write = [&](std::size_t i, const Row& row) {
                    T* const at = to + i * stride;
                    (adds ? Row::template load_first<width>(at) + row : row).template store_first<width>(at);
                };
                for (std::size_t run = 0; run < block.run_count; ++run) {
                    block.template prefetch_ahead<width>(entries, run);
                    const std::size_t start = block.starts[run], after = block.starts[run + 1];
                    if (!block.counts(start)) {
                        if constexpr (!adds)
                            for (std::size_t i = start; i < after; ++i)
                                Row(T(0)).template store_first<width>(to + i * stride);
                        continue;
                    }
                    const auto entry = [&](int corner) {
                        return Row::template load_first<width>(entries + block.index[corner][start] * width);
                    };
                    Row low[4], rise[4]; // of the edges along x, in the order y, z
                    for (int edge = 0; edge < 4; ++edge)
                        low[edge] = entry(2 * edge), rise[edge] = entry(2 * edge + 1) - low[edge];
                    for (std::size_t i = start; i < after; ++i) {
                        const T x = block.fraction[0][i], y = block.fraction[1][i], z = block.fraction[2][i];
                        Row edges[4];
                        for (int edge = 0; edge < 4; ++edge) edges[edge] = low[edge] + x * rise[edge];
                        const Row near = edges[0] + y * (edges[1] - edges[0]);
                        const Row far = edges[2] + y * (edges[3] - edges[2]);
                        const Row features = near + z * (far - near);
                        write(i, block.level_weight ? block.level_weight[i] * features : features);
                    }
                }
            },
            [&](std::size_t first, std::size_t count) {
                if constexpr (!adds)
                    for (std::size_t i = 0; i < count; ++i)
                        Row(T(0)).template store_first<width>(out + (first - begin + i) * stride);
            });
    };
    mode == Write::add ? encode(std::true_type()) : encode(std::false_type());
}

/// Adds the share of points [begin, end) to the gradient of the table on level l. `in` is the address of dL_dfeatures
/// of point `begin`. A run's sums stay in registers.
template <class T, class Grid, class Query>
void hash_scatter(const Grid& grid, std::size_t l, T* dL_dentries, const Query& query, std::size_t begin,
                  std::size_t end, const T* in, std::size_t stride) {
    constexpr std::size_t width = Grid::feature_count;
    using Row = HashRow<T, width>;
    for_hash_blocks<T>(
        grid, l, query, begin, end,
        [&](const HashBlock<T>& block, std::size_t first, std::size_t) {
            const T* const from = in + (first - begin) * stride;
            for (std::size_t run = 0; run < block.run_count; ++run) {
                block.template prefetch_ahead<width>(dL_dentries, run);
                const std::size_t start = block.starts[run], after = block.starts[run + 1];
                if (!block.counts(start)) continue;
                Row sum[4] = {}, high[4] = {}; // of both ends of the edges along x, and of their upper ends
                for (std::size_t i = start; i < after; ++i) {
                    const T x = block.fraction[0][i], y = block.fraction[1][i], z = block.fraction[2][i];
                    Row gradient = Row::template load_first<width>(from + i * stride);
                    if (block.level_weight) gradient = block.level_weight[i] * gradient;
                    const Row far = z * gradient, near = gradient - far;
                    Row edges[4];
                    edges[1] = y * near, edges[0] = near - edges[1];
                    edges[3] = y * far, edges[2] = far - edges[3];
                    for (int edge = 0; edge < 4; ++edge) {
                        sum[edge] = sum[edge] + edges[edge];
                        high[edge] = high[edge] + x * edges[edge];
                    }
                }
                const auto add = [&](int corner, const Row& row) {
                    T* const to = dL_dentries + block.index[corner][start] * width;
                    (Row::template load_first<width>(to) + row).template store_first<width>(to);
                };
                for (int edge = 0; edge < 4; ++edge) {
                    add(2 * edge, sum[edge] - high[edge]);
                    add(2 * edge + 1, high[edge]);
                }
            }
        },
        [](std::size_t, std::size_t) {});
}

} // namespace detail

template <CpuBackend B, class Grid, class T, class Query>
void hash_prepare(B& backend, const Grid& grid, Span<const vec3<T>> points, const LevelWeights<T>& weights,
                  Query& query) {
    constexpr std::size_t levels = Grid::level_count;
    backend.for_chunks(points.size(), 4096, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            query.x[i] = points[i].x, query.y[i] = points[i].y, query.z[i] = points[i].z;
    });
    backend.copy(weights.coarse, query.coarse);
    backend.copy(weights.fine, query.fine);

    typename B::template Buffer<std::uint8_t> marks(grid.entry_count());
    std::array<std::size_t, levels> counts{}, lookups{};
    backend.for_chunks(levels, 1, [&](std::size_t l, std::size_t, std::size_t) {
        const HashLevel& level = grid.level(static_cast<int>(l));
        std::uint8_t* mark = marks.data();
        std::fill_n(mark + level.offset, level.size, std::uint8_t(0));
        detail::for_hash_blocks<T>(
            grid, l, query, 0, points.size(),
            [&](const detail::HashBlock<T>& block, std::size_t, std::size_t count) {
                for (std::size_t i = 0; i < count; ++i) {
                    if (!block.counts(i)) continue;
                    for (int corner = 0; corner < 8; ++corner) mark[block.index[corner][i]] = 1;
                    lookups[l] += 8;
                }
            },
            [](std::size_t, std::size_t) {});
        for (std::size_t e = 0; e < level.size; ++e) counts[l] += mark[level.offset + e];
    });
    query.lookups = 0;
    query.touched_begin[0] = 0;
    for (std::size_t l = 0; l < levels; ++l) {
        query.touched_begin[l + 1] = query.touched_begin[l] + counts[l];
        query.lookups += lookups[l];
    }
    query.touched.resize(query.touched_begin[levels]);
    backend.for_chunks(levels, 1, [&](std::size_t l, std::size_t, std::size_t) {
        const HashLevel& level = grid.level(static_cast<int>(l));
        std::uint32_t* to = query.touched.data() + query.touched_begin[l];
        for (std::uint32_t e = level.offset; e < level.offset + level.size; ++e)
            if (marks[e]) *to++ = e;
    });
}

template <CpuBackend B, class Grid, class T, class Query>
void hash_forward(B& backend, const Grid& grid, Span<const T> table, const Query& query, FeatureView<T> features,
                  Write mode) {
    constexpr std::size_t levels = Grid::level_count, width = Grid::feature_count, grain = 4096;
    const std::size_t chunks = chunk_count(query.size(), grain);
    const bool level_outermost = features.block == width;
    backend.for_chunks(levels * chunks, 1, [&](std::size_t task, std::size_t, std::size_t) {
        // Processing one level after the other keeps its table in the cache. Where a row of features interleaves the
        // levels, the cache lines of the rows matter more.
        const std::size_t l = level_outermost ? task / chunks : task % levels;
        const std::size_t begin = (level_outermost ? task % chunks : task / levels) * grain;
        const std::size_t end = std::min(begin + grain, query.size());
        detail::hash_encode(grid, l, table.data(), query, begin, end,
                            features.column(l * width) + begin * features.block, features.block, mode);
    });
}

template <CpuBackend B, class Grid, class T, class Query>
void hash_backward(B& backend, const Grid& grid, FeatureView<const T> dL_dfeatures, const Query& query,
                   Span<T> dL_dtable) {
    constexpr std::size_t levels = Grid::level_count, width = Grid::feature_count;
    backend.for_chunks(levels, 1, [&](std::size_t task, std::size_t, std::size_t) {
        const std::size_t l = levels - 1 - task; // the finest levels take longest and therefore come first
        detail::hash_scatter(grid, l, dL_dtable.data(), query, 0, query.size(), dL_dfeatures.column(l * width),
                             dL_dfeatures.block);
    });
}

} // namespace cpu

} // namespace gsh
