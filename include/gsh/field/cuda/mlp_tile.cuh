// SPDX-License-Identifier: Apache-2.0
/// @file  A tile of rows of the MLP in shared memory: what is loaded into it, and the products on it.
///
/// A tile is kept column after column, so that a thread reads four rows of a column with one instruction. Columns are
/// four numbers longer than the tile has rows. Eight neighbouring columns then begin in different banks. Indexes have
/// 32 bits, to save registers; the overloads check the sizes.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>

#include <cstddef>
#include <type_traits>

namespace gsh::cuda::detail {

/// Sizes of a tile, and a thread's share of its products. There are 128 threads: 16 groups by rows times 8 by columns.
/// A thread makes 8 x 8 numbers (in double 4 x 8) of a product, from 16 that it reads, so that almost nine of ten
/// instructions are arithmetic. Four blocks of float fit a multiprocessor, by registers and by shared memory; while one
/// loads, the others compute.
template <class T>
struct MlpTile {
    static constexpr unsigned threads = 128;
    static constexpr unsigned rows = 512 / sizeof(T);  // 128 floats
    static constexpr unsigned depth = 128 / sizeof(T); // inner numbers of a product that are loaded at a time
    static constexpr unsigned stride = rows + 4, side_stride = depth + 4;
    static constexpr unsigned thread_rows = rows / 16;
    static constexpr unsigned least_blocks = sizeof(T) == 4 ? 4 : 2;

    struct Shared {
        alignas(16) SharedArray<T, mlp_columns * stride> tile;      ///< [64][stride]: 64 columns of the rows
        alignas(16) SharedArray<T, mlp_columns * side_stride> side; ///< weights [depth][64], or columns of depth rows
    };

    // Neighbouring threads have neighbouring rows: eight of them write 128 contiguous bytes of a column, and all that
    // read the same columns of the other operand are in one half of the warps.
    [[nodiscard]] __device__ static unsigned row_group(unsigned thread) { return thread / 32 % 2 * 8 + thread % 8; }
    [[nodiscard]] __device__ static unsigned column_group(unsigned thread) { return thread / 64 * 4 + thread % 32 / 8; }
    [[nodiscard]] __device__ static unsigned row_group() { return row_group(threadIdx.x); }
    [[nodiscard]] __device__ static unsigned column_group() { return column_group(threadIdx.x); }

    /// A thread's j-th row. Rows come in fours.
    [[nodiscard]] __device__ static unsigned row(unsigned j) { return j / 4 * 64 + row_group() * 4 + j % 4; }
    /// A thread's j-th column, where it has `share` of them. Columns come in fours, too, if there are so many.
    [[nodiscard]] __device__ static unsigned column(unsigned j, unsigned share) {
        return j / 4 * 32 + column_group() * (share < 4 ? share : 4) + j % 4;
    }
};

/// The number of columns in a group.
[[nodiscard]] __device__ inline unsigned mlp_count(unsigned columns, unsigned group) {
    const unsigned rest = columns - group * mlp_columns;
    return rest < mlp_columns ? rest : mlp_columns;
}

/// A thread's share of a product with `count` columns: 2, 4 or 8, which makes products of 16, 32 or 64 columns. Fewer
/// would save little, since the 128 threads read all of the other operand anyway.
[[nodiscard]] __device__ inline unsigned mlp_share(unsigned count) {
    return count > 32 ? 8 : count > 16 ? 4 : 2;
}

/// A FeatureView, of which a thread takes four numbers of a row at once where their place in memory permits.
template <class T>
struct MlpColumns {
    Span<T> values;
    Span<RowOf<4, T>> by_four; ///< empty if they cannot be taken so
    std::size_t rows = 0;
    unsigned columns = 0, block = 1;

    MlpColumns() = default;
    MlpColumns(const FeatureView<T>& view)
        : values(view.values), rows(view.rows), columns(static_cast<unsigned>(view.columns)),
          block(static_cast<unsigned>(view.block)) {
        if (view.block % 4 == 0 && has_rows<4>(values)) by_four = as_rows<4>("Mlp", values);
    }
    [[nodiscard]] __device__ unsigned index(unsigned row, unsigned column) const {
        const unsigned group = block == 4 ? column / 4 : column / block;
        return (group * static_cast<unsigned>(rows) + row) * block + (column - group * block);
    }
};

/// Inputs of the network that differ from row to row: features, then the points' own.
template <class T>
struct MlpRowInputs {
    MlpColumns<const T> features;
    Span<const T> points;
    std::size_t own; ///< numbers of each point

    [[nodiscard]] __device__ unsigned rows() const { return static_cast<unsigned>(features.rows); }
    [[nodiscard]] __device__ T operator()(unsigned row, unsigned column) const {
        return column < features.columns ? features.values[features.index(row, column)]
                                         : points[row * static_cast<unsigned>(own) + (column - features.columns)];
    }

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
            for (unsigned c = 4 * part; c < from; c += 4 * step) {
                Row<T, 4> four{};
                if (inside) four = features.by_four[features.index(first_row + r, column + c) / 4];
                for (unsigned j = 0; j < 4; ++j) to[(c + j) * Stride + r] = four[j];
            }
        }
        for (unsigned c = from + part; c < padded; c += step)
            to[c * Stride + r] = inside && c < count ? (*this)(first_row + r, column + c) : T(0);
    }
};

/// The numbers of a row-major matrix of `columns` columns, a thread's one after the other: neighbouring threads have
/// neighbouring numbers. Steps without division.
struct MlpWalk {
    unsigned columns, row, column;

    __device__ explicit MlpWalk(unsigned count)
        : columns(count), row(threadIdx.x / count), column(threadIdx.x - row * count), rows_of_step_(128 / count),
          columns_of_step_(128 - rows_of_step_ * count) {}
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
    for (unsigned e = threadIdx.x; e < padded * fours; e += 128) {
        const unsigned c = e / fours, r = e % fours;
        Row<T, 4> four{};
        if (c < count) four = from[first + c * length + r];
        for (unsigned j = 0; j < 4; ++j) to[c * Stride + 4 * r + j] = four[j];
    }
}

/// Weights of `depth` rows of a packed matrix, 64 columns of each.
template <class T, class Array>
__device__ void load_weights(Array& to, Span<const Row<T, 4>> from, unsigned first, unsigned length, unsigned depth) {
    for (unsigned e = threadIdx.x; e < depth * (mlp_columns / 4); e += 128) {
        const unsigned k = e / (mlp_columns / 4), c = e % (mlp_columns / 4);
        const Row<T, 4> four = from[first + k * length + c];
        for (unsigned j = 0; j < 4; ++j) to[k * mlp_columns + 4 * c + j] = four[j];
    }
}

/// sums[i][j] += sum over k < depth of tile[first + k][row i] side[k][column j], for j < Share.
template <class T, unsigned Share>
__device__ void multiply(const typename MlpTile<T>::Shared& shared, unsigned first, unsigned depth,
                         T (&sums)[MlpTile<T>::thread_rows][8]) {
    using Tile = MlpTile<T>;
    const auto step = [&](unsigned k) {
        T a[Tile::thread_rows], b[Share];
        for (unsigned i = 0; i < Tile::thread_rows; ++i) a[i] = shared.tile[(first + k) * Tile::stride + Tile::row(i)];
        for (unsigned j = 0; j < Share; ++j) b[j] = shared.side[k * mlp_columns + Tile::column(j, Share)];
        for (unsigned i = 0; i < Tile::thread_rows; ++i)
            for (unsigned j = 0; j < Share; ++j) sums[i][j] += a[i] * b[j];
    };
    unsigned k = 0;
    for (; k + 2 <= depth; k += 2) step(k), step(k + 1);
    if (k < depth) step(k);
}
/// For a share that is known when running. All else around a product is written once, for eight columns.
template <class T>
__device__ void multiply(const typename MlpTile<T>::Shared& shared, unsigned first, unsigned depth, unsigned share,
                         T (&sums)[MlpTile<T>::thread_rows][8]) {
    if (share == 8)
        multiply<T, 8>(shared, first, depth, sums);
    else if (share == 4)
        multiply<T, 4>(shared, first, depth, sums);
    else
        multiply<T, 2>(shared, first, depth, sums);
}

/// sums[i][j] += sum over rows r < depth of tile[o_i][first + r] side[c_j][r], with o_i = row group + 16 i and
/// c_j = column group + 8 j: neighbouring threads read neighbouring columns, and these lie in different banks.
template <class T, unsigned Outputs, unsigned Inputs>
__device__ void multiply_over_rows(const typename MlpTile<T>::Shared& shared, unsigned first, T (&sums)[4][8]) {
    using Tile = MlpTile<T>;
    for (unsigned r = 0; r < Tile::depth; r += 4) {
        T a[Outputs][4];
        for (unsigned i = 0; i < Outputs; ++i)
            for (unsigned u = 0; u < 4; ++u)
                a[i][u] = shared.tile[(Tile::row_group() + 16 * i) * Tile::stride + first + r + u];
        for (unsigned j = 0; j < Inputs; ++j) {
            T b[4];
            for (unsigned u = 0; u < 4; ++u)
                b[u] = shared.side[(Tile::column_group() + 8 * j) * Tile::side_stride + r + u];
            for (unsigned u = 0; u < 4; ++u)
                for (unsigned i = 0; i < Outputs; ++i) sums[i][j] += a[i][u] * b[u];
        }
    }
}
/// For shares of outputs (times two) and inputs that are known when running.
template <class T>
__device__ void multiply_over_rows(const typename MlpTile<T>::Shared& shared, unsigned first, unsigned outputs,
                                   unsigned inputs, T (&sums)[4][8]) {
    const auto for_outputs = [&](auto share) {
        constexpr unsigned N = decltype(share)::value;
        if (inputs == 8)
            multiply_over_rows<T, N, 8>(shared, first, sums);
        else if (inputs == 4)
            multiply_over_rows<T, N, 4>(shared, first, sums);
        else
            multiply_over_rows<T, N, 2>(shared, first, sums);
    };
    if (outputs == 8)
        for_outputs(std::integral_constant<unsigned, 4>());
    else if (outputs == 4)
        for_outputs(std::integral_constant<unsigned, 2>());
    else
        for_outputs(std::integral_constant<unsigned, 1>());
}

} // namespace gsh::cuda::detail
