// SPDX-License-Identifier: Apache-2.0
/// @file  The hash grid on the CPU: level by level, so that one level's entries stay in the cache.
///
/// Corner indices and weights are recomputed for a block of points at a time in vector registers: that costs less
/// than reading them back from memory would, and nothing is stored. The table's gradient is scattered by one thread
/// per level in the order of the points: no atomics, the same sums at any thread count.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace gsh::cpu {

namespace detail {

/// Corners of up to `capacity` points on one level.
template <class T>
struct HashBlock {
    static constexpr std::size_t capacity = 128;
    alignas(64) std::uint32_t index[8][capacity];
    alignas(64) T weight[8][capacity];

    void fill(const HashLevel& level, const T* x, const T* y, const T* z, std::size_t count) {
        level.hashed ? fill<true>(level, x, y, z, count) : fill<false>(level, x, y, z, count);
    }

    /// Asks for the entries of a point some way ahead of point i: on the fine levels each lies on a line of its own.
    template <std::size_t Features>
    void prefetch_ahead(const T* entries, std::size_t i, std::size_t count) const {
        constexpr std::size_t distance = 32; // points; covers the third-level cache's latency
        if (i + distance >= count) return;
        for (int corner = 0; corner < 8; ++corner) prefetch(entries + index[corner][i + distance] * Features);
    }

private:
    template <bool Hashed>
    void fill(const HashLevel& level, const T* x, const T* y, const T* z, std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            const HashCell<T> cell = level.cell<Hashed>(vec3<T>(x[i], y[i], z[i]));
            for (int corner = 0; corner < 8; ++corner) {
                index[corner][i] = level.index<Hashed>(cell, corner);
                weight[corner][i] = cell.weight(corner);
            }
        }
    }
};

/// Calls body(block, first, count) for blocks of the query's points in [begin, end), corners filled in.
template <class T, class Query, class Body>
void for_hash_blocks(const HashLevel& level, const Query& query, std::size_t begin, std::size_t end, const Body& body) {
    HashBlock<T> block;
    for (std::size_t first = begin; first < end; first += block.capacity) {
        const std::size_t count = std::min(block.capacity, end - first);
        block.fill(level, query.x.data() + first, query.y.data() + first, query.z.data() + first, count);
        body(block, first, count);
    }
}

} // namespace detail

template <CpuBackend B, class Grid, class T, class Query>
void hash_prepare(B& backend, const Grid& grid, Span<const vec3<T>> points, Query& query) {
    constexpr std::size_t levels = Grid::level_count;
    backend.for_chunks(points.size(), 4096, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i)
            query.x[i] = points[i].x, query.y[i] = points[i].y, query.z[i] = points[i].z;
    });

    typename B::template Buffer<std::uint8_t> marks(grid.entry_count());
    std::array<std::size_t, levels> counts{};
    backend.for_chunks(levels, 1, [&](std::size_t l, std::size_t, std::size_t) {
        const HashLevel& level = grid.level(static_cast<int>(l));
        std::uint8_t* mark = marks.data();
        std::fill_n(mark + level.offset, level.size, std::uint8_t(0));
        detail::for_hash_blocks<T>(level, query, 0, points.size(),
                                   [&](const detail::HashBlock<T>& block, std::size_t, std::size_t count) {
                                       for (int corner = 0; corner < 8; ++corner)
                                           for (std::size_t i = 0; i < count; ++i) mark[block.index[corner][i]] = 1;
                                   });
        for (std::size_t e = 0; e < level.size; ++e) counts[l] += mark[level.offset + e];
    });
    query.touched_begin[0] = 0;
    for (std::size_t l = 0; l < levels; ++l) query.touched_begin[l + 1] = query.touched_begin[l] + counts[l];
    query.touched.resize(query.touched_begin[levels]);
    backend.for_chunks(levels, 1, [&](std::size_t l, std::size_t, std::size_t) {
        const HashLevel& level = grid.level(static_cast<int>(l));
        std::uint32_t* to = query.touched.data() + query.touched_begin[l];
        for (std::uint32_t e = level.offset; e < level.offset + level.size; ++e)
            if (marks[e]) *to++ = e;
    });
}

template <CpuBackend B, class Grid, class T, class Query>
void hash_forward(B& backend, const Grid& grid, Span<const T> table, const Query& query, FeatureView<T> features) {
    using Row = Eigen::Array<T, Grid::feature_count, 1>; // one register for the usual four features
    constexpr std::size_t levels = Grid::level_count, width = Grid::feature_count, grain = 4096;
    const std::size_t chunks = chunk_count(query.size(), grain);
    const bool level_outermost = features.block == width;
    backend.for_chunks(levels * chunks, 1, [&](std::size_t task, std::size_t, std::size_t) {
        // Whole levels one after the other keep a table in the cache; where a row of features interleaves the
        // levels, the rows' lines matter more.
        const std::size_t l = level_outermost ? task / chunks : task % levels;
        const std::size_t begin = (level_outermost ? task % chunks : task / levels) * grain;
        const T* entries = table.data();
        T* out = features.column(l * width);
        detail::for_hash_blocks<T>(
            grid.level(static_cast<int>(l)), query, begin, std::min(begin + grain, query.size()),
            [&](const detail::HashBlock<T>& block, std::size_t first, std::size_t count) {
                for (std::size_t i = 0; i < count; ++i) {
                    block.template prefetch_ahead<width>(entries, i, count);
                    Row sum = Row::Zero();
                    for (int corner = 0; corner < 8; ++corner)
                        sum += block.weight[corner][i] * Eigen::Map<const Row>(entries + block.index[corner][i] * width);
                    Eigen::Map<Row>(out + (first + i) * features.block) = sum;
                }
            });
    });
}

template <CpuBackend B, class Grid, class T, class Query>
void hash_backward(B& backend, const Grid& grid, FeatureView<const T> dL_dfeatures, const Query& query,
                   Span<T> dL_dtable) {
    using Row = Eigen::Array<T, Grid::feature_count, 1>;
    constexpr std::size_t levels = Grid::level_count, width = Grid::feature_count;
    backend.for_chunks(levels, 1, [&](std::size_t task, std::size_t, std::size_t) {
        const std::size_t l = levels - 1 - task; // the finest levels take longest, so they go first
        T* entries = dL_dtable.data();
        const T* in = dL_dfeatures.column(l * width);
        detail::for_hash_blocks<T>(
            grid.level(static_cast<int>(l)), query, 0, query.size(),
            [&](const detail::HashBlock<T>& block, std::size_t first, std::size_t count) {
                for (std::size_t i = 0; i < count; ++i) {
                    block.template prefetch_ahead<width>(entries, i, count);
                    const Row gradient = Eigen::Map<const Row>(in + (first + i) * dL_dfeatures.block);
                    for (int corner = 0; corner < 8; ++corner)
                        Eigen::Map<Row>(entries + block.index[corner][i] * width) += block.weight[corner][i] * gradient;
                }
            });
    });
}

} // namespace gsh::cpu
