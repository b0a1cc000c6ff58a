// SPDX-License-Identifier: Apache-2.0
/// @file  Sums that the MLP's kernels take in the same way in float and in mixed precision.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/mlp_shape.cuh>

#include <cstddef>

namespace gsh::cuda::detail {

/// The first of the tiles that a block processes: its tiles come before the next block's, and their numbers differ by
/// one at most.
[[nodiscard]] __device__ inline unsigned mlp_first_tile(std::size_t rows, unsigned tile_rows, unsigned block) {
    const std::size_t tiles = (rows + tile_rows - 1) / tile_rows;
    return static_cast<unsigned>(tiles * block / gridDim.x);
}

/// What the shared inputs add to output `o` of the first layer, on every lane; zero beyond the outputs. All lanes of
/// the warp take part.
template <class T>
[[nodiscard]] __device__ T mlp_bias(const MlpShape& shape, Span<const T> weights, Span<const T> shared, unsigned o) {
    T sum = 0;
    if (o < shape.out(0))
        for (unsigned c = threadIdx.x % warp_size; c < shape.shared; c += warp_size)
            sum += weights[o * shape.weights_stride(0) + shape.inputs + c] * shared[c];
    return warp_sum(sum);
}

/// Sums the gradients of blocks: 32 numbers a thread block, each by 8 threads, which take consecutive parts of them.
template <class T>
struct MlpSumOfBlocks {
    static constexpr unsigned numbers = 32, parts = 8, block_size = numbers * parts;
    struct Shared {
        SharedArray<T, block_size> sums;
    };

    /// The number of a thread.
    [[nodiscard]] __device__ static unsigned number() { return blockIdx.x * numbers + threadIdx.x % numbers; }
    /// Whether a thread receives the sum of its number.
    [[nodiscard]] __device__ static bool receives() { return threadIdx.x < numbers; }

    /// The sum of number() over blocks of `size` numbers, for the threads that receive it; zero unless it is wanted.
    /// All threads take part.
    [[nodiscard]] __device__ static T sum(Shared& shared, Span<const T> values, unsigned size, unsigned blocks,
                                          bool wanted) {
        const unsigned part = threadIdx.x / numbers;
        T sum = 0;
        if (wanted)
            for (unsigned b = blocks * part / parts; b < blocks * (part + 1) / parts; ++b)
                sum += values[b * size + number()];
        shared.sums[threadIdx.x] = sum;
        __syncthreads();
        if (receives())
            for (unsigned p = 1; p < parts; ++p) sum += shared.sums[p * numbers + threadIdx.x];
        return sum;
    }
};

} // namespace gsh::cuda::detail
