// SPDX-License-Identifier: Apache-2.0
/// @file  Rows of feature matrices as tiles: copied, written back, and collected where they have a gradient.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/prefetch.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/features.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// Rows first, first + 1, … of a batch.
struct RowsFrom {
    std::size_t first;
    [[nodiscard]] std::size_t operator()(std::size_t r) const { return first + r; }
};

/// Rows of a batch from a list.
struct RowsOf {
    const std::uint32_t* rows;
    [[nodiscard]] std::size_t operator()(std::size_t r) const { return rows[r]; }
};

/// Calls f with the block size, as a compile-time constant for common sizes.
template <class F>
void with_block(std::size_t block, const F& f) {
    switch (block) {
    case 2: return f(std::integral_constant<std::size_t, 2>());
    case 4: return f(std::integral_constant<std::size_t, 4>());
    case 8: return f(std::integral_constant<std::size_t, 8>());
    default: return f(block);
    }
}

/// Copies `count` rows of the view to a row-major tile.
template <class T, class Rows>
void features_to_rows(const FeatureView<const T>& view, const Rows& rows, std::size_t count, T* tile,
                      std::size_t stride) {
    with_block(view.block, [&](auto block) {
        for (std::size_t c = 0; c < view.columns; c += block) {
            const T* const from = view.column(c);
            for (std::size_t r = 0; r < count; ++r)
                for (std::size_t j = 0; j < block; ++j) tile[r * stride + c + j] = from[rows(r) * block + j];
        }
    });
}

/// Writes a row-major tile to `count` rows of the view.
template <class T, class Rows>
void rows_to_features(const T* tile, std::size_t stride, const Rows& rows, std::size_t count,
                      const FeatureView<T>& view, Write mode) {
    with_block(view.block, [&](auto block) {
        for (std::size_t c = 0; c < view.columns; c += block) {
            T* const to = view.column(c);
            if (mode == Write::assign) {
                for (std::size_t r = 0; r < count; ++r)
                    for (std::size_t j = 0; j < block; ++j) to[rows(r) * block + j] = tile[r * stride + c + j];
            } else {
                for (std::size_t r = 0; r < count; ++r)
                    for (std::size_t j = 0; j < block; ++j) to[rows(r) * block + j] += tile[r * stride + c + j];
            }
        }
    });
}

/// Copies `count` rows of a view to the first rows of another with equal columns and blocks.
template <class T, class Rows>
void gather_features(const FeatureView<const T>& from, const Rows& rows, std::size_t count, const FeatureView<T>& to) {
    with_block(to.block, [&](auto block) {
        for (std::size_t c = 0; c < to.columns; c += block) {
            const T* const source = from.column(c);
            T* const target = to.column(c);
            for (std::size_t r = 0; r < count; ++r)
                for (std::size_t j = 0; j < block; ++j) target[r * block + j] = source[rows(r) * block + j];
        }
    });
}

/// Copies `count` rows of `columns` numbers.
template <class T, class Rows>
void copy_rows(const T* from, std::size_t columns, const Rows& rows, std::size_t count, T* to) {
    for (std::size_t r = 0; r < count; ++r) std::copy_n(from + rows(r) * columns, columns, to + r * columns);
}

/// Prefetches rows of the next tile during the work on this one, a few cache lines at a time. The hardware prefetcher
/// alone loses track at the end of every tile.
template <class T, class Rows>
struct Ahead {
    FeatureView<const T> view;
    Rows rows; ///< of the next tile
    std::size_t count;

    void operator()(std::size_t first, std::size_t more) const {
        constexpr std::size_t line = 64 / sizeof(T);
        const std::size_t end = std::min(first + more, count);
        const std::size_t step = view.block < line ? line / view.block : 1; // neighbours share lines
        for (std::size_t c = 0; c < view.columns; c += view.block)
            for (std::size_t r = first; r < end; r += step)
                for (std::size_t i = 0; i < view.block; i += line) prefetch(view.column(c) + rows(r) * view.block + i);
    }
};

/// Walks over the rows [begin, end) of a network's backward pass, in tiles of those whose dL_doutputs are not all zero.
/// The other rows contribute nothing, and the gradient of their features is zero; it is written while the walk passes.
template <class T>
class GradientRows {
public:
    static constexpr std::size_t capacity = 64;

    /// dL_doutputs [rows, outputs]. dL_dfeatures may be the memory of the features, since a row of it is written only
    /// if the row has no gradient.
    GradientRows(Span<const T> dL_doutputs, std::size_t outputs, const FeatureView<T>& dL_dfeatures, Write mode,
                 std::size_t begin, std::size_t end)
        : dL_doutputs_(dL_doutputs.data()), outputs_(outputs), dL_dfeatures_(dL_dfeatures), mode_(mode),
          walked_(begin), end_(end) {
        collect(upcoming_);
    }

    /// Collects the next tile; false if no row is left.
    bool next() {
        std::swap(tile_, upcoming_);
        collect(upcoming_);
        return tile_.count != 0;
    }

    [[nodiscard]] std::size_t count() const { return tile_.count; }
    [[nodiscard]] RowsOf rows() const { return RowsOf{tile_.rows.data()}; } // nvcc needs the type
    /// True if the tile's rows follow each other in the batch.
    [[nodiscard]] bool consecutive() const { return tile_.rows[tile_.count - 1] - tile_.rows[0] == tile_.count - 1; }

    /// For prefetching rows of the tile after this one.
    template <class U>
    [[nodiscard]] Ahead<U, RowsOf> ahead(const FeatureView<const U>& view) const {
        return Ahead<U, RowsOf>{view, RowsOf{upcoming_.rows.data()}, upcoming_.count};
    }

private:
    struct Tile {
        std::size_t count = 0;
        std::array<std::uint32_t, capacity> rows;
    };

    void collect(Tile& to) {
        to.count = 0;
        for (; walked_ < end_ && to.count < capacity; ++walked_) {
            const T* const gradient = dL_doutputs_ + walked_ * outputs_;
            if (std::any_of(gradient, gradient + outputs_, [](T g) { return g != T(0); }))
                to.rows[to.count++] = static_cast<std::uint32_t>(walked_);
            else if (mode_ == Write::assign)
                with_block(dL_dfeatures_.block, [&](auto block) {
                    for (std::size_t c = 0; c < dL_dfeatures_.columns; c += block)
                        std::fill_n(dL_dfeatures_.column(c) + walked_ * block, std::size_t(block), T(0));
                });
        }
    }

    const T* dL_doutputs_;
    std::size_t outputs_;
    FeatureView<T> dL_dfeatures_;
    Write mode_;
    std::size_t walked_, end_; // rows before walked_ are in a tile, or have no gradient
    Tile tile_, upcoming_;
};

} // namespace detail

} // namespace gsh::cpu
