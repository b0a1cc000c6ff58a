// SPDX-License-Identifier: Apache-2.0
/// @file  Running sums of integers over the threads of a warp or a block.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>

#include <concepts>
#include <cstddef>

namespace gsh::cuda {

/// The sum over the lanes up to this one, itself included. All 32 lanes take part.
template <std::unsigned_integral U>
[[nodiscard]] __device__ U warp_scan(U value) {
    const unsigned lane = threadIdx.x % warp_size;
    for (unsigned distance = 1; distance < warp_size; distance *= 2) {
        const U before = __shfl_up_sync(all_lanes, value, distance);
        if (lane >= distance) value += before;
    }
    return value;
}

/// The sum over the threads before this one; `total` becomes the sum over all. All threads of the block take part.
/// `shared` has one element for each warp, and may be used again after the next barrier of the block.
template <unsigned Block, std::unsigned_integral U, std::size_t Warps>
[[nodiscard]] __device__ U block_scan(SharedArray<U, Warps>& shared, U value, U& total) {
    static_assert(Block == Warps * warp_size && Warps <= warp_size);
    const unsigned lane = threadIdx.x % warp_size, warp = threadIdx.x / warp_size;
    const U in_warp = warp_scan(value);
    if (lane == warp_size - 1) shared[warp] = in_warp;
    __syncthreads();
    U of_warp = 0; // each warp scans the sums of all warps
    if (lane < Warps) of_warp = shared[lane];
    const U warps = warp_scan(of_warp);
    total = __shfl_sync(all_lanes, warps, int(Warps) - 1);
    return __shfl_sync(all_lanes, warps - of_warp, int(warp)) + in_warp - value;
}

} // namespace gsh::cuda
