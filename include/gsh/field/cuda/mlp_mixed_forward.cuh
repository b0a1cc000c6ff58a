// SPDX-License-Identifier: Apache-2.0
/// @file  Networks of two hidden layers in mixed precision: operands in bf16 on tensor cores, sums and masters in fp32.
///
/// A warp takes 16 rows through all layers without shared memory: the result of a layer has the layout of the next
/// one's operand. Nothing but the outputs is stored. Hidden layers have up to 64 numbers, as the paper's do; registers
/// are those of 64.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/matrix.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_mixed_rows.cuh>
#include <gsh/field/cuda/mlp_mixed_shape.cuh>

namespace gsh::cuda::detail {

/// Each warp takes 16 rows.
template <class Inputs>
struct MixedForward {
    using Rows = MixedRows<Inputs>;
    static constexpr unsigned block_size = 128, block_rows = block_size / warp_size * Rows::rows;
    Rows network;
    Span<float> outputs;

    __device__ void operator()() const {
        const unsigned first_row = (blockIdx.x * (block_size / warp_size) + threadIdx.x / warp_size) * Rows::rows;
        MatrixA x[Rows::most_in_tiles], first[4], second[4];
        for (unsigned k = 0; k < Rows::most_in_tiles; ++k) x[k] = network.input_tile(first_row, k);
        network.hidden(0, x, first);
        network.hidden(1, first, second);
        const MixedShape& shape = network.shape;
        for (unsigned tile = 0; tile < shape.out_tiles(2); ++tile) {
            MatrixC sums[2] = {};
            network.add_products(sums, second, shape.in_tiles(2),
                                 [&](unsigned k) { return MixedShape::forward_tile(2, k, tile); });
            for (unsigned n = 0; n < 2; ++n)
                for (unsigned i = 0; i < 4; ++i) {
                    const unsigned row = first_row + Rows::group() + i / 2 * 8,
                                   column = 16 * tile + 8 * n + Rows::pair() + i % 2;
                    if (row < network.inputs.rows() && column < shape.outputs)
                        outputs[row * shape.outputs + column] = sums[n].values[i];
                }
        }
    }
};

} // namespace gsh::cuda::detail
