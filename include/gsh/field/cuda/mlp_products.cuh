// SPDX-License-Identifier: Apache-2.0
/// @file  Products on a tile of the MLP: with weights, and over its rows, which gives gradients of weights.
///
/// Products of floats are taken by matrix instructions, whose right operands come from global memory in the order of
/// the lanes: weights from the first-level cache, inputs once. No barrier stands between the steps of a product. In
/// double, right operands are first copied to shared memory.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/matrix.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>

#include <type_traits>

namespace gsh::cuda::detail {

/// body(a constant) for a share that is known when running. All else around a product is written once, for all of them.
template <class Body>
__device__ void with_mlp_share(unsigned share, const Body& body) {
    if (share == 8)
        body(std::integral_constant<unsigned, 8>());
    else if (share == 4)
        body(std::integral_constant<unsigned, 4>());
    else
        body(std::integral_constant<unsigned, 2>());
}

/// sums[i][j] += sum over k < depth of tile[first + k][row i] side[k][column j], for 8 Share columns.
template <unsigned Share>
__device__ void multiply(const MlpTile<double>::Shared& shared, unsigned first, unsigned depth,
                         MlpTile<double>::Sums& sums) {
    using Tile = MlpTile<double>;
    const auto step = [&](unsigned k) {
        double a[4], b[Share];
        for (unsigned i = 0; i < 4; ++i) a[i] = shared.tile[(first + k) * Tile::stride + Tile::row(i)];
        for (unsigned j = 0; j < Share; ++j) b[j] = shared.side[k * mlp_columns + Tile::column(j, Share)];
        for (unsigned i = 0; i < 4; ++i)
            for (unsigned j = 0; j < Share; ++j) sums[i][j] += a[i] * b[j];
    };
    unsigned k = 0;
    for (; k + 2 <= depth; k += 2) step(k), step(k + 1);
    if (k < depth) step(k);
}
/// sums[i][j] += sum over k < inner of tile[k][row i] weights[k][column j], for 8 Share columns of a packed matrix,
/// whose rows are `length` fours long.
template <unsigned Share>
__device__ void multiply(MlpTile<double>::Shared& shared, Span<const Row<double, 4>> packed, unsigned first,
                         unsigned length, unsigned inner, MlpTile<double>::Sums& sums) {
    using Tile = MlpTile<double>;
    for (unsigned k = 0; k < inner; k += Tile::depth) {
        const unsigned depth = inner - k < Tile::depth ? inner - k : Tile::depth;
        __syncthreads();
        for (unsigned e = threadIdx.x; e < depth * (mlp_columns / 4); e += Tile::threads) {
            const unsigned row = e / (mlp_columns / 4), c = e % (mlp_columns / 4);
            const Row<double, 4> four = packed[first + (k + row) * length + c];
            for (unsigned j = 0; j < 4; ++j) shared.side[row * mlp_columns + 4 * c + j] = four[j];
        }
        __syncthreads();
        multiply<Share>(shared, k, depth, sums);
    }
}
template <unsigned Share>
__device__ void multiply(MlpTile<float>::Shared& shared, Span<const Row<float, 4>> packed, unsigned first,
                         unsigned length, unsigned inner, MlpTile<float>::Sums& sums) {
    using Tile = MlpTile<float>;
    const unsigned thread = computed_anew(threadIdx.x), lane = thread % warp_size, t = lane % 4;
    float part[Share / 2][4][4]; // 16 columns each
    for (unsigned p = 0; p < Share / 2; ++p)
        for (unsigned i = 0; i < 4; ++i)
            for (unsigned j = 0; j < 4; ++j) part[p][i][j] = sums[i][4 * p + j];
    __syncthreads();
    GSH_NO_UNROLL
    for (unsigned k = 0; k < inner; k += 8) {
        float a[2][4];
        for (unsigned half = 0; half < 2; ++half)
            for (unsigned i = 0; i < 4; ++i) // rows g and g + 8 of two left operands
                a[i / 2][2 * half + i % 2] = shared.tile[(k + 4 * half + t) * Tile::stride + Tile::row(i, thread)];
        for (unsigned p = 0; p < Share / 2; ++p) {
            const Row<float, 4> weights = packed[first + k * length + 4 * lane + p];
            const float b[2][2] = {{weights[0], weights[1]}, {weights[2], weights[3]}};
            cuda::multiply_add(part[p], a, b);
        }
    }
    for (unsigned p = 0; p < Share / 2; ++p)
        for (unsigned i = 0; i < 4; ++i)
            for (unsigned j = 0; j < 4; ++j) sums[i][4 * p + j] = part[p][i][j];
}
template <class T>
__device__ void multiply(typename MlpTile<T>::Shared& shared, Span<const Row<T, 4>> packed, unsigned first,
                         unsigned length, unsigned inner, unsigned share, typename MlpTile<T>::Sums& sums) {
    with_mlp_share(share, [&](auto constant) {
        multiply<decltype(constant)::value>(shared, packed, first, length, inner, sums);
    });
}

/// sums[n] += sum over rows r < depth of tile[o][first + r] side[i][r] for a thread's n-th weight (o, i), of
/// 8 `outputs` by 8 `share` weights.
__device__ inline void multiply_over_rows(const MlpTile<double>::Shared& shared, unsigned first, unsigned outputs,
                                          unsigned share, MlpTile<double>::WeightSums& sums) {
    using Tile = MlpTile<double>;
    const unsigned o = Tile::row_group(threadIdx.x), c = Tile::column_group(threadIdx.x);
    const auto of_shares = [&](auto output_share, auto input_share) {
        constexpr unsigned N = decltype(output_share)::value / 2, M = decltype(input_share)::value;
        for (unsigned r = 0; r < Tile::depth; r += 4) {
            double a[N][4];
            for (unsigned i = 0; i < N; ++i)
                for (unsigned u = 0; u < 4; ++u) a[i][u] = shared.tile[(o + 16 * i) * Tile::stride + first + r + u];
            for (unsigned j = 0; j < M; ++j)
                for (unsigned u = 0; u < 4; ++u) {
                    const double b = shared.side[(c + 8 * j) * Tile::side_stride + r + u];
                    for (unsigned i = 0; i < N; ++i) sums[2 * i + j / 4][j % 4] += a[i][u] * b;
                }
        }
    };
    with_mlp_share(outputs, [&](auto output_share) {
        with_mlp_share(share, [&](auto input_share) { of_shares(output_share, input_share); });
    });
}

/// The same over all rows of a tile. column_of(i)(r) are rows r to r + 3 of input i.
template <unsigned Share, class ColumnOf>
__device__ void multiply_over_rows(const MlpTile<float>::Shared& shared, unsigned outputs,
                                   const ColumnOf& column_of, MlpTile<float>::WeightSums& sums) {
    using Tile = MlpTile<float>;
    const unsigned thread = computed_anew(threadIdx.x), g = thread % warp_size / 4, t = thread % 4;
    const unsigned input = 16 * Tile::input_pair(thread, Share) + Tile::input_of(g);
    if (2 * Tile::output_tile(0, thread, Share) >= outputs) return; // the same for the warp
    // Lane t has four rows that follow each other: rows t and t + 4 of two products.
    const auto first = column_of(input), second = column_of(input + 8);
    Row<float, 4> next[2] = {first(4 * t), second(4 * t)};
    GSH_NO_UNROLL
    for (unsigned r = 0; r < Tile::rows; r += 16) {
        const Row<float, 4> b[2] = {next[0], next[1]};
        if (r + 16 < Tile::rows) // while these are multiplied
            next[0] = first(r + 16 + 4 * t), next[1] = second(r + 16 + 4 * t);
        // Two tiles of outputs at a time: products of the same sum wait for each other.
        constexpr unsigned together = Share > 2 ? 2 : 1;
        for (unsigned slot = 0; slot < Share / 2; slot += together) {
            const auto of_tiles = [&](auto count) {
                constexpr unsigned M = decltype(count)::value;
                float a[2 * M][4];
                for (unsigned h = 0; h < 2 * M; ++h) {
                    const unsigned o = 16 * Tile::output_tile(slot + h / 2, thread, Share) + h % 2 * 8 +
                                       Tile::output_of(g);
                    for (unsigned u = 0; u < 4; ++u) a[h][u] = shared.tile[o * Tile::stride + r + 4 * t + u];
                }
                for (unsigned s = 0; s < 4; s += 2) {
                    float left[M][4];
                    for (unsigned m = 0; m < M; ++m)
                        for (unsigned i = 0; i < 4; ++i) left[m][i] = a[2 * m + i % 2][s + i / 2];
                    const float right[2][2] = {{b[0][s], b[0][s + 1]}, {b[1][s], b[1][s + 1]}};
                    cuda::multiply_add(sums, left, right, 2 * slot); // the rasterizer has another in this namespace
                }
            };
            const auto has = [&](unsigned of) { return 2 * Tile::output_tile(of, thread, Share) < outputs; };
            if (together == 2 && has(slot + 1))
                of_tiles(std::integral_constant<unsigned, together>());
            else if (has(slot))
                of_tiles(std::integral_constant<unsigned, 1>());
        }
    }
}
template <class ColumnOf>
__device__ void multiply_over_rows(const MlpTile<float>::Shared& shared, unsigned outputs, unsigned share,
                                   const ColumnOf& column_of, MlpTile<float>::WeightSums& sums) {
    with_mlp_share(share, [&](auto constant) {
        multiply_over_rows<decltype(constant)::value>(shared, outputs, column_of, sums);
    });
}

} // namespace gsh::cuda::detail
