// SPDX-License-Identifier: Apache-2.0
/// @file  How the plan of density control is shared by blocks of threads, and where each block begins in a list.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// What is common to the passes: a block has 2,048 Gaussians, a thread eight in a row.
struct DescentTile {
    static constexpr unsigned threads = 256, items = 8, size = threads * items;
    struct Shared {
        SharedArray<std::uint32_t, threads / warp_size> warps;
    };

    /// visit(i) for the Gaussians of the running thread.
    template <class Visit>
    static __device__ void for_each(std::size_t count, const Visit& visit) {
        const std::size_t begin = std::size_t(blockIdx.x) * size + std::size_t(threadIdx.x) * items;
        for (std::size_t i = begin; i < begin + items && i < count; ++i) visit(i);
    }
};

/// The sums of all blocks before each, in one block; the last number is the sum of all.
struct ScanDescent {
    static constexpr unsigned block_size = 1024;
    struct Shared {
        SharedArray<std::uint32_t, block_size / warp_size> warps;
    };
    Span<const std::uint32_t> block_counts; ///< [blocks]
    Span<std::uint32_t> block_begin;        ///< [blocks + 1]

    __device__ void operator()(Shared& shared) const {
        std::uint32_t before = 0;
        for (std::size_t first = 0; first < block_counts.size(); first += block_size) {
            const std::size_t i = first + threadIdx.x;
            std::uint32_t total = 0;
            const std::uint32_t begin =
                block_scan<block_size>(shared.warps, i < block_counts.size() ? block_counts[i] : 0u, total);
            if (i < block_counts.size()) block_begin[i] = before + begin;
            before += total;
            __syncthreads(); // shared.warps is used again
        }
        if (threadIdx.x == 0) block_begin[block_counts.size()] = before;
    }
};

} // namespace gsh::cuda::detail
