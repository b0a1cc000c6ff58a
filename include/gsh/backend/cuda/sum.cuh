// SPDX-License-Identifier: Apache-2.0
/// @file  The sum of an array on the GPU, with the same bits in every run.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>

namespace gsh::cuda {

namespace detail {

/// One block per chunk of values: sums[block] = or += the sum of the chunk.
template <class T>
struct SumOfChunks {
    static constexpr unsigned block_size = 256;
    struct Shared {
        SharedArray<T, block_size / warp_size> warps;
    };
    Span<const T> values;
    Span<T> sums;
    std::size_t chunk;
    bool add;

    __device__ void operator()(Shared& shared) const {
        const std::size_t begin = blockIdx.x * chunk,
                          count = values.size() - begin < chunk ? values.size() - begin : chunk;
        T sum(0);
        for (std::size_t i = threadIdx.x; i < count; i += block_size) sum += values[begin + i];
        sum = block_sum<block_size>(shared.warps, sum);
        if (threadIdx.x == 0) sums[blockIdx.x] = add ? sums[blockIdx.x] + sum : sum;
    }
};

} // namespace detail

/// result[0] += sum of values. One kernel sums chunks of fixed length, a second one their sums.
///
/// Shapes  values [N]; result [1]; partials is scratch that the caller keeps, so that a repeated sum allocates nothing.
/// Errors  ShapeError; MemoryError for host memory.
template <class T>
void add_sum(Device& device, Span<const T> values, Span<T> result, Device::Buffer<T>& partials) {
    check_size("add_sum", "result", result.size(), 1);
    check_memory(device, "add_sum", "values", values);
    check_memory(device, "add_sum", "result", result);
    constexpr std::size_t chunk = 1024; // four values per thread; 170,000 values then occupy all of a large GPU
    const std::size_t chunks = chunk_count(values.size(), chunk);
    if (chunks == 0) return;
    if (chunks == 1) {
        device.launch(1, detail::SumOfChunks<T>{values, result, chunk, true});
        return;
    }
    partials.resize(chunks);
    device.launch(chunks, detail::SumOfChunks<T>{values, partials, chunk, false});
    device.launch(1, detail::SumOfChunks<T>{partials, result, chunks, true});
}

} // namespace gsh::cuda
