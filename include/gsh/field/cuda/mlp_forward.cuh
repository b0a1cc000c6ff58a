// SPDX-License-Identifier: Apache-2.0
/// @file  The kernel of the MLP's forward pass: a tile of rows passes through all layers in shared memory.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>

#include <cstddef>

namespace gsh::cuda::detail {

/// One block per tile. Activations of at most 64 columns stay in shared memory from layer to layer; wider ones return
/// from `hidden`, which keeps them for backward anyway.
template <class T>
struct MlpForward {
    using Tile = MlpTile<T>;
    using Shared = typename Tile::Shared;
    static constexpr unsigned block_size = Tile::threads, least_blocks = Tile::least_blocks;

    MlpShape shape;
    MlpRowInputs<T> inputs;
    Span<const Row<T, 4>> packed; ///< MlpShape::forward_offset
    Span<const T> bias;           ///< of the first layer
    Span<Row<T, 4>> hidden;       ///< [tiles][hidden layers][width][rows of a tile]
    Span<T> outputs;

    __device__ void operator()(Shared& shared) const {
        unsigned held = nothing;
        for (unsigned layer = 0; layer < shape.layers; ++layer)
            for (unsigned group = 0; group < mlp_groups(shape.out(layer)); ++group)
                with_width(count_of(shape.out(layer), group), [&](auto width) {
                    run_layer<decltype(width)::value>(shared, layer, group, held);
                });
    }

private:
    static constexpr unsigned nothing = ~0u;

    [[nodiscard]] __device__ static unsigned count_of(unsigned columns, unsigned group) {
        const unsigned rest = columns - group * mlp_columns;
        return rest < mlp_columns ? rest : mlp_columns;
    }
    [[nodiscard]] __device__ static std::size_t first_row() { return std::size_t(blockIdx.x) * Tile::rows; }
    /// Where the activations behind a layer begin, in fours.
    [[nodiscard]] __device__ std::size_t hidden_offset(unsigned layer, unsigned column) const {
        return ((std::size_t(blockIdx.x) * (shape.layers - 1) + layer) * shape.width + column) * (Tile::rows / 4);
    }

    /// 64 outputs of a layer, or the rest. `held` is what the tile holds: 1024 layer + group of the layer's inputs.
    template <unsigned Columns>
    __device__ void run_layer(Shared& shared, unsigned layer, unsigned group, unsigned& held) const {
        constexpr unsigned N = Tile::thread_rows, M = Columns / 8;
        const unsigned first_column = group * mlp_columns, count = count_of(shape.out(layer), group);
        const unsigned length = mlp_groups(shape.out(layer)) * (mlp_columns / 4);
        T sums[N][M];
        for (unsigned j = 0; j < M; ++j) {
            const unsigned c = Tile::template column<Columns>(j);
            const T start = layer == 0 && !bias.empty() ? bias[first_column + c] : T(0);
            for (unsigned i = 0; i < N; ++i) sums[i][j] = start;
        }
        for (unsigned in = 0; in < mlp_groups(shape.in(layer)); ++in) {
            const unsigned inner = count_of(shape.in(layer), in);
            if (held != 1024 * layer + in) load_inputs(shared, layer, in, inner);
            held = 1024 * layer + in;
            for (unsigned k = 0; k < inner; k += Tile::depth) {
                const unsigned depth = inner - k < Tile::depth ? inner - k : Tile::depth;
                __syncthreads();
                load_weights<T>(shared.side, packed,
                                shape.forward_offset(layer) / 4 +
                                    std::size_t(in * mlp_columns + k) * length + group * (mlp_columns / 4),
                                length, depth);
                __syncthreads();
                multiply<T, Columns>(shared, k, depth, sums);
            }
        }
        if (layer + 1 < shape.layers)
            keep<Columns>(shared, layer, first_column, count, sums, held);
        else
            write_outputs<Columns>(shared, first_column, count, sums, held);
    }

    __device__ void load_inputs(Shared& shared, unsigned layer, unsigned in, unsigned count) const {
        __syncthreads();
        if (layer == 0)
            inputs.template load<Tile::rows, Tile::stride>(shared.tile, first_row(), in * mlp_columns, count, count);
        else
            load_columns<Tile::rows, Tile::stride, T>(shared.tile, hidden, hidden_offset(layer - 1, in * mlp_columns),
                                                      Tile::rows / 4, count, count);
    }

    template <unsigned Columns, unsigned N, unsigned M>
    __device__ void keep(Shared& shared, unsigned layer, unsigned first_column, unsigned count, T (&sums)[N][M],
                         unsigned& held) const {
        const bool stays = shape.width <= mlp_columns;
        if (stays) __syncthreads(); // the tile is still read
        for (unsigned j = 0; j < M; ++j) {
            const unsigned c = Tile::template column<Columns>(j);
            for (unsigned i = 0; i < N; i += 4) {
                Row<T, 4> four;
                for (unsigned u = 0; u < 4; ++u) four[u] = sums[i + u][j] > T(0) ? sums[i + u][j] : T(0);
                if (c < count) hidden[hidden_offset(layer, first_column + c) + Tile::row(i) / 4] = four;
                if (stays)
                    for (unsigned u = 0; u < 4; ++u) shared.tile[c * Tile::stride + Tile::row(i) + u] = four[u];
            }
        }
        if (stays) held = 1024 * (layer + 1);
    }

    /// Through shared memory, so that neighbouring threads write neighbouring numbers.
    template <unsigned Columns, unsigned N, unsigned M>
    __device__ void write_outputs(Shared& shared, unsigned first_column, unsigned count, T (&sums)[N][M],
                                  unsigned& held) const {
        __syncthreads();
        for (unsigned j = 0; j < M; ++j)
            for (unsigned i = 0; i < N; ++i)
                shared.tile[Tile::template column<Columns>(j) * Tile::stride + Tile::row(i)] = sums[i][j];
        __syncthreads();
        for (unsigned e = threadIdx.x; e < Tile::rows * count; e += block_size) {
            const unsigned r = e / count, c = e - r * count;
            if (first_row() + r < inputs.rows())
                outputs[(first_row() + r) * shape.outputs + first_column + c] = shared.tile[c * Tile::stride + r];
        }
        held = nothing;
    }
};

} // namespace gsh::cuda::detail
