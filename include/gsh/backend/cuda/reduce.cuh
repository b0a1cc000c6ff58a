// SPDX-License-Identifier: Apache-2.0
/// @file  Sums over the threads of a warp or a block, with the same bits in every run.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>

#include <concepts>
#include <cstddef>

namespace gsh::cuda {

/// The sum of a number of each lane, on every lane. All 32 lanes take part. Partners exchange their sums and a sum does
/// not depend on the order of its two terms, so the lanes receive the same bits.
template <std::floating_point T>
[[nodiscard]] __device__ T warp_sum(T value) {
    for (int distance = warp_size / 2; distance > 0; distance /= 2)
        value += __shfl_xor_sync(all_lanes, value, distance);
    return value;
}
/// The same for a vector, by its components x, y and z.
template <class Vector>
    requires requires(Vector v) { v.z; }
[[nodiscard]] __device__ Vector warp_sum(const Vector& value) {
    return Vector(warp_sum(value.x), warp_sum(value.y), warp_sum(value.z));
}

/// The sum of a value (a number or a vec3) of each thread of a block, on every thread. All threads take part. Lanes are
/// joined as in warp_sum, warps in their order. `shared` has one element for each warp, and may be used again after
/// the next barrier of the block.
template <unsigned Block, class T, std::size_t Warps>
[[nodiscard]] __device__ T block_sum(SharedArray<T, Warps>& shared, const T& value) {
    static_assert(Block == Warps * warp_size);
    const T of_warp = warp_sum(value);
    if (threadIdx.x % warp_size == 0) shared[threadIdx.x / warp_size] = of_warp;
    __syncthreads();
    T sum = shared[0];
    for (std::size_t warp = 1; warp < Warps; ++warp) {
        const T next = shared[warp];
        sum += next;
    }
    return sum;
}

} // namespace gsh::cuda
