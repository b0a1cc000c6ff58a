// SPDX-License-Identifier: Apache-2.0
/// @file  Sums of several numbers over the lanes of a warp with few exchanges, and the same bits in every run.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>

namespace gsh::cuda {

namespace detail {

/// Lanes that differ in the bits of `Distance` and above already share their sums; `first` is the index of values[0].
template <int Distance, int Group, int N, class T, class Use>
__device__ void sum_lanes_from(const T (&values)[N], unsigned first, const Use& use) {
    const unsigned lane = threadIdx.x % warp_size;
    if constexpr (Distance == 0) {
        static_assert(N <= Group);
        for (unsigned k = 0; k < N; ++k)
            if (lane % Group == k) use(first + k, values[k]);
    } else if constexpr (N % 2 == 0 && N / 2 <= Distance) {
        const bool upper = (lane & Distance) != 0;
        T half[N / 2];
        for (int k = 0; k < N / 2; ++k) {
            const T other = __shfl_xor_sync(all_lanes, upper ? values[k] : values[k + N / 2], Distance);
            half[k] = (upper ? values[k + N / 2] : values[k]) + other;
        }
        sum_lanes_from<Distance / 2, Distance>(half, upper ? first + N / 2 : first, use);
    } else {
        T all[N];
        for (int k = 0; k < N; ++k) all[k] = values[k] + __shfl_xor_sync(all_lanes, values[k], Distance);
        sum_lanes_from<Distance / 2, Group>(all, first, use);
    }
}

} // namespace detail

/// Sums each of N numbers over the lanes of a warp, or over each `Lanes` consecutive ones, and calls use(k, sum of
/// values[k]) on one of them for each k, always the same. All 32 lanes take part.
///
/// While their number is even, the lower lanes go on with one half of the numbers and the upper lanes with the other:
/// twelve numbers take 18 exchanges, where twelve separate sums take 60.
template <int Lanes = int(warp_size), int N, class T, class Use>
__device__ void sum_lanes(const T (&values)[N], const Use& use) {
    static_assert(0 < N && N <= Lanes && Lanes <= int(warp_size) && (Lanes & (Lanes - 1)) == 0);
    detail::sum_lanes_from<Lanes / 2, Lanes>(values, 0u, use);
}

} // namespace gsh::cuda
