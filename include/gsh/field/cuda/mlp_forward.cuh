// SPDX-License-Identifier: Apache-2.0
/// @file  The kernel of the MLP's forward pass: a tile of rows passes through all layers in shared memory.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_products.cuh>
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
        for (unsigned layer = 0; layer < shape.layers; ++layer)
            for (unsigned group = 0; group < mlp_groups(shape.out(layer)); ++group) run_layer(shared, layer, group);
    }

private:
    using Sums = typename Tile::Sums;

    [[nodiscard]] __device__ static unsigned first_row() { return blockIdx.x * Tile::rows; }
    /// Where the activations behind a layer begin, in fours.
    [[nodiscard]] __device__ unsigned hidden_offset(unsigned layer, unsigned column) const {
        return ((blockIdx.x * (shape.layers - 1) + layer) * shape.width + column) * (Tile::rows / 4);
    }

    /// 64 outputs of a layer, or the rest.
    __device__ void run_layer(Shared& shared, unsigned layer, unsigned group) const {
        const unsigned first_column = group * mlp_columns, count = mlp_count(shape.out(layer), group);
        const unsigned share = mlp_share(count);
        const unsigned length = mlp_groups(shape.out(layer)) * (mlp_columns / 4);
        Sums sums;
        for (unsigned j = 0; j < Tile::thread_columns; ++j) {
            const bool biased = layer == 0 && !bias.empty() && j < Tile::columns(share);
            const T start = biased ? bias[first_column + Tile::column(j, share)] : T(0);
            for (unsigned i = 0; i < 4; ++i) sums[i][j] = start;
        }
        const bool held = layer != 0 && group == 0 && shape.width <= mlp_columns; // from the layer before
        const unsigned weights = shape.forward_offset(layer) / 4 + group * Tile::packed_group;
        for (unsigned in = 0; in < mlp_groups(shape.in(layer)); ++in) {
            const unsigned inner = mlp_count(shape.in(layer), in);
            if (!held) load_inputs(shared, layer, in, inner);
            multiply<T>(shared, packed, weights + in * mlp_columns * length, length, inner, share, sums);
        }
        if (layer + 1 < shape.layers)
            keep(shared, layer, first_column, count, sums);
        else
            write_outputs(shared, first_column, count, sums);
    }

    __device__ void load_inputs(Shared& shared, unsigned layer, unsigned in, unsigned count) const {
        __syncthreads();
        if (layer == 0)
            inputs.template load<Tile::rows, Tile::stride>(shared.tile, first_row(), in * mlp_columns, count,
                                                               mlp_padded(count));
        else
            load_columns<Tile::rows, Tile::stride, T>(shared.tile, hidden, hidden_offset(layer - 1, in * mlp_columns),
                                                      Tile::rows / 4, count, mlp_padded(count));
    }

    __device__ void keep(Shared& shared, unsigned layer, unsigned first_column, unsigned count,
                         const Sums& sums) const {
        const unsigned share = mlp_share(count);
        const bool stays = shape.width <= mlp_columns;
        const unsigned begin = hidden_offset(layer, first_column);
        if (stays) __syncthreads(); // the tile is still read
        for (unsigned j = 0; j < Tile::thread_columns; ++j) {
            if (j >= Tile::columns(share)) continue; // not break: the loop must have a constant length
            const unsigned c = Tile::column(j, share);
            Row<T, 4> four;
            for (unsigned i = 0; i < 4; ++i) four[i] = sums[i][j] > T(0) ? sums[i][j] : T(0);
            if (c < count) hidden[begin + (c * Tile::rows + Tile::row(0)) / 4] = four;
            if (stays)
                for (unsigned i = 0; i < 4; ++i) shared.tile[c * Tile::stride + Tile::row(i)] = four[i];
        }
    }

    /// Through shared memory, so that neighbouring threads write neighbouring numbers.
    __device__ void write_outputs(Shared& shared, unsigned first_column, unsigned count, const Sums& sums) const {
        const unsigned share = mlp_share(count);
        __syncthreads();
        for (unsigned j = 0; j < Tile::thread_columns; ++j) {
            if (j >= Tile::columns(share)) continue; // not break: the loop must have a constant length
            for (unsigned i = 0; i < 4; ++i)
                shared.tile[Tile::column(j, share) * Tile::stride + Tile::row(i)] = sums[i][j];
        }
        __syncthreads();
        const unsigned rest = inputs.rows() - first_row(), rows = rest < Tile::rows ? rest : Tile::rows;
        for (MlpWalk at(count); at.row < rows; at.step())
            outputs[(first_row() + at.row) * shape.outputs + first_column + at.column] =
                shared.tile[at.column * Tile::stride + at.row];
    }
};

} // namespace gsh::cuda::detail
