// SPDX-License-Identifier: Apache-2.0
/// @file  A tile of rows of the MLP in shared memory, a thread's share of its products, and what is loaded into it.
///
/// A tile is kept column after column, so that a thread reads four rows of a column with one instruction. Columns are
/// a few numbers longer than the tile has rows, so that neighbouring lanes read different banks. Indexes have 32 bits,
/// to save registers; the overloads check the sizes.
#pragma once

#include <gsh/backend/cuda/divisor.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>

#include <cstddef>

namespace gsh::cuda::detail {

/// Sizes of a tile, and a thread's share of its products: 4 rows of 16 columns in float, of 8 columns in double.
///
/// Products of floats are taken by matrix instructions (backend/cuda/matrix.cuh), of 32 rows by a warp. With lane
/// = 4 g + t, a thread reads 4 rows of a column at once, which are rows g and g + 8 of two left operands. Products of
/// doubles are taken number by number. Four blocks of float fit a multiprocessor, by registers and by shared memory;
/// while one loads, the others compute.
template <class T>
struct MlpTile {
    static constexpr bool by_matrices = sizeof(T) == 4;
    static constexpr unsigned threads = 128;
    static constexpr unsigned rows = 512 / sizeof(T);  // 128 floats
    static constexpr unsigned depth = 128 / sizeof(T); // inner numbers of a product that are loaded at a time
    static constexpr unsigned stride = rows + (by_matrices ? 8 : 4), side_stride = depth + 4; // for different banks
    static constexpr unsigned thread_columns = by_matrices ? 16 : 8;
    static constexpr unsigned least_blocks = by_matrices ? 4 : 2;

    struct Shared {
        alignas(16) SharedArray<T, mlp_columns * stride> tile; ///< [64][stride]: 64 columns of the rows
        /// In double: weights [depth][64], or columns of depth rows.
        alignas(16) SharedArray<T, by_matrices ? 1 : mlp_columns * side_stride> side;
    };
    using Sums = T[4][thread_columns];
    using WeightSums = T[8][4]; ///< of a thread's weights in a piece of 64 x 64
    static constexpr unsigned thread_weights = 32;

    /// A number of a packed matrix of `groups` groups of 64 columns: rows of it in double, in float tiles of 8 x 64 in
    /// the order of the lanes, of which each has 8 right operands.
    struct Packed {
        unsigned inner, column;
    };
    [[nodiscard]] __device__ static Packed packed(unsigned at, unsigned groups) {
        const unsigned columns = groups * mlp_columns;
        if constexpr (!by_matrices) return {at / columns, at % columns};
        const unsigned tile = at / (8 * mlp_columns), lane = at / 16 % warp_size, n = at / 2 % 8;
        return {tile / groups * 8 + at % 2 * 4 + lane % 4, tile % groups * mlp_columns + 8 * n + lane / 4};
    }
    /// From a group of columns to the next, in fours.
    static constexpr unsigned packed_group = (by_matrices ? 8 : 1) * mlp_columns / 4;
    /// A thread's j-th row. They follow each other.
    [[nodiscard]] __device__ static unsigned row(unsigned j, unsigned thread = threadIdx.x) {
        return 4 * row_group(thread) + j;
    }
    /// The number of a thread's columns in a product of 8 `share` columns.
    [[nodiscard]] __device__ static unsigned columns(unsigned share) { return share * (thread_columns / 8); }
    /// A thread's j-th column.
    [[nodiscard]] __device__ static unsigned column(unsigned j, unsigned share, unsigned thread = threadIdx.x) {
        if constexpr (by_matrices) return j / 2 * 8 + thread % 4 * 2 + j % 2;
        return j / 4 * 32 + column_group(thread) * (share < 4 ? share : 4) + j % 4;
    }

    /// A weight's place in a piece: the n-th of a thread's WeightSums in a product of 8 `share` inputs. What a thread
    /// has no weight for lies beyond the piece.
    struct Weight {
        unsigned out, in;
    };
    [[nodiscard]] __device__ static Weight weight(unsigned n, unsigned thread, unsigned share) {
        if constexpr (!by_matrices) return {row_group(thread) + n / 8 * 16, column_group(thread) + n % 8 * 8};
        const unsigned lane = thread % warp_size;
        return {16 * output_tile(n / 8, thread, share) + n / 4 % 2 * 8 + output_of(lane / 4),
                16 * input_pair(thread, share) + n / 2 % 2 * 8 + input_of(lane % 4 * 2 + n % 2)};
    }
    /// Whether a product of 8 `outputs` by 8 `share` weights has it.
    [[nodiscard]] __device__ static bool has_weight(unsigned n, unsigned outputs, unsigned share) {
        if constexpr (!by_matrices) return n / 8 * 2 < outputs && n % 8 < share;
        return n / 8 < share / 2 && 2 * output_tile(n / 8, threadIdx.x, share) < outputs;
    }

    // Gradients of weights by matrices: a warp has a pair of tiles of 8 inputs and some tiles of 16 outputs. All four
    // warps have work, however few tiles there are.
    [[nodiscard]] __device__ static unsigned input_pair(unsigned thread, unsigned share) {
        return thread / warp_size % (share / 2);
    }
    [[nodiscard]] __device__ static unsigned output_tile(unsigned slot, unsigned thread, unsigned share) {
        return thread / warp_size / (share / 2) + slot * (8 / share);
    }
    /// The order of rows and columns of a tile of gradients, for which neighbouring lanes read different banks.
    [[nodiscard]] __device__ static unsigned output_of(unsigned g) { return (g & 4u) | (g & 1u) << 1 | (g >> 1 & 1u); }
    [[nodiscard]] __device__ static unsigned input_of(unsigned g) { return (g & 1u) << 2 | g >> 1; }

    // In double, neighbouring threads have neighbouring rows: eight of them write contiguous numbers of a column, and
    // all that read the same columns of the other operand are in one half of the warps.
    [[nodiscard]] __device__ static unsigned row_group(unsigned thread) {
        if constexpr (by_matrices) return thread / 4;
        return thread / 32 % 2 * 8 + thread % 8;
    }
    [[nodiscard]] __device__ static unsigned column_group(unsigned thread) { return thread / 64 * 4 + thread % 32 / 8; }
};

/// The number of columns in a group.
[[nodiscard]] __device__ inline unsigned mlp_count(unsigned columns, unsigned group) {
    const unsigned rest = columns - group * mlp_columns;
    return rest < mlp_columns ? rest : mlp_columns;
}

/// The share of a product with `count` columns: 2, 4 or 8, which makes products of 16, 32 or 64 columns. Fewer would
/// save little, since the threads read all of the other operand anyway.
[[nodiscard]] __device__ inline unsigned mlp_share(unsigned count) {
    return count > 32 ? 8 : count > 16 ? 4 : 2;
}

/// A column of a matrix in memory.
template <class T>
struct MlpColumn {
    Span<T> values;
    unsigned first, step; ///< place of the first row; from a row to the next
    [[nodiscard]] __device__ T& operator[](unsigned row) const { return values[first + row * step]; }
};

/// A FeatureView, of which a thread takes four numbers of a row at once where their place in memory permits.
template <class T>
struct MlpColumns {
    Span<T> values;
    Span<RowOf<4, T>> by_four; ///< empty if they cannot be taken so
    std::size_t rows = 0;
    unsigned columns = 0;
    Divisor block;

    MlpColumns() = default;
    MlpColumns(const FeatureView<T>& view)
        : values(view.values), rows(view.rows), columns(static_cast<unsigned>(view.columns)),
          block(static_cast<unsigned>(view.block)) {
        if (view.block % 4 == 0 && has_rows<4>(values)) by_four = as_rows<4>("Mlp", values);
    }
    [[nodiscard]] __device__ unsigned index(unsigned row, unsigned column) const {
        const unsigned group = block.quotient(column);
        return (group * static_cast<unsigned>(rows) + row) * block.number + block.remainder(column, group);
    }
    [[nodiscard]] __device__ MlpColumn<T> column(unsigned c) const { return {values, index(0, c), block.number}; }
};

/// Inputs of the network that differ from row to row: features, then the points' own.
template <class T>
struct MlpRowInputs {
    MlpColumns<const T> features;
    Span<const T> points;
    std::size_t own; ///< numbers of each point

    [[nodiscard]] __device__ unsigned rows() const { return static_cast<unsigned>(features.rows); }
    [[nodiscard]] __device__ MlpColumn<const T> column(unsigned c) const {
        if (c < features.columns) return features.column(c);
        return {points, c - features.columns, static_cast<unsigned>(own)};
    }
    [[nodiscard]] __device__ T operator()(unsigned row, unsigned c) const { return column(c)[row]; }

    /// Columns [column, column + count) of Rows rows, column after column at distance Stride; zeros beyond the last row
    /// and up to `padded` columns.
    template <unsigned Rows, unsigned Stride, class Array>
    __device__ void load(Array& to, unsigned first_row, unsigned column, unsigned count, unsigned padded) const {
        constexpr unsigned step = 128 / Rows;
        const unsigned r = threadIdx.x % Rows, part = threadIdx.x / Rows;
        const bool inside = first_row + r < rows();
        unsigned from = 0; // of the columns that follow
        if (!features.by_four.empty() && column < features.columns) {
            from = count < features.columns - column ? count : features.columns - column;
            for (unsigned begin = 4 * part; begin < from; begin += 16 * step) {
                Row<T, 4> fours[4] = {}; // all are read before the first is written
                for (unsigned b = 0; b < 4; ++b) {
                    const unsigned c = begin + b * 4 * step;
                    if (inside && c < from) fours[b] = features.by_four[features.index(first_row + r, column + c) / 4];
                }
                for (unsigned b = 0; b < 4; ++b) {
                    const unsigned c = begin + b * 4 * step;
                    if (c >= from) continue;
                    for (unsigned j = 0; j < 4; ++j) to[(c + j) * Stride + r] = fours[b][j];
                }
            }
        }
        for (unsigned begin = from + part; begin < padded; begin += 8 * step) {
            T numbers[8]; // all are read before the first is written
            for (unsigned b = 0; b < 8; ++b) {
                const unsigned c = begin + b * step;
                numbers[b] = inside && c < count ? (*this)(first_row + r, column + c) : T(0);
            }
            for (unsigned b = 0; b < 8; ++b)
                if (begin + b * step < padded) to[(begin + b * step) * Stride + r] = numbers[b];
        }
    }
};

/// The numbers of a row-major matrix of `columns` columns, a thread's one after the other: neighbouring threads have
/// neighbouring numbers. Steps without division.
struct MlpWalk {
    unsigned columns, row, column;

    __device__ explicit MlpWalk(unsigned count)
        : columns(count), row(computed_anew(threadIdx.x) / count), column(threadIdx.x - row * count),
          rows_of_step_(128 / count), columns_of_step_(128 - rows_of_step_ * count) {}
    __device__ void step() {
        row += rows_of_step_, column += columns_of_step_;
        if (column >= columns) column -= columns, ++row;
    }

private:
    unsigned rows_of_step_, columns_of_step_;
};

/// Columns [0, count) of Rows rows of a tile in global memory, whose columns are `length` fours long; zeros up to
/// `padded` columns.
template <unsigned Rows, unsigned Stride, class T, class Array>
__device__ void load_columns(Array& to, Span<const Row<T, 4>> from, unsigned first, unsigned length, unsigned count,
                             unsigned padded) {
    constexpr unsigned fours = Rows / 4;
    for (unsigned e = computed_anew(threadIdx.x); e < padded * fours; e += 128) {
        const unsigned c = e / fours, r = e % fours;
        Row<T, 4> four{};
        if (c < count) four = from[first + c * length + r];
        for (unsigned j = 0; j < 4; ++j) to[c * Stride + 4 * r + j] = four[j];
    }
}

} // namespace gsh::cuda::detail
