// SPDX-License-Identifier: Apache-2.0
/// @file  Plans a change of density control on a GPU: which Gaussians there are afterwards.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/core/span.hpp>
#include <gsh/pipeline/density_descent.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cuda {

namespace detail {

using gsh::detail::Kin;

/// What is common to the passes: a block counts the children of 2,048 Gaussians, a thread of eight in a row.
struct DescentTile {
    static constexpr unsigned threads = 256, items = 8, size = threads * items;
    struct Shared {
        SharedArray<std::uint32_t, threads / warp_size> warps;
    };

    [[nodiscard]] __device__ static std::size_t first() {
        return std::size_t(blockIdx.x) * size + std::size_t(threadIdx.x) * items;
    }
    [[nodiscard]] GSH_HD static std::uint32_t children(Fate fate, std::uint32_t split_count) {
        return fate == Fate::prune ? 0 : fate == Fate::clone ? 2 : fate == Fate::split ? split_count : 1;
    }
};

/// The number of children of each block, and the numbers of clones, splits and pruned.
struct CountDescent {
    static constexpr unsigned block_size = DescentTile::threads;
    using Shared = DescentTile::Shared;
    Span<const Fate> fates;
    std::uint32_t split_count;
    Span<std::uint32_t> block_counts;
    Span<std::uint32_t> changes; ///< [4], by fate; zero before. Fate::keep is not counted.

    __device__ void operator()(Shared& shared) const {
        const std::size_t begin = DescentTile::first();
        std::uint32_t children = 0, of_fate[4] = {};
        for (unsigned k = 0; k < DescentTile::items && begin + k < fates.size(); ++k) {
            const Fate fate = fates[begin + k];
            children += DescentTile::children(fate, split_count);
            of_fate[static_cast<unsigned>(fate)] += 1;
        }
        for (unsigned f = 1; f < 4; ++f) // not those that are kept: they are many
            if (of_fate[f] != 0) atomicAdd(&changes[f], of_fate[f]);
        std::uint32_t total = 0;
        (void)block_scan<block_size>(shared.warps, children, total);
        if (threadIdx.x == 0) block_counts[blockIdx.x] = total;
    }
};

/// Each block's first child, in one block; the last number is that of all children.
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

/// Writes the children of each Gaussian.
struct FillDescent {
    static constexpr unsigned block_size = DescentTile::threads;
    using Shared = DescentTile::Shared;
    Span<const Fate> fates;
    std::uint32_t split_count;
    Span<const std::uint32_t> block_begin;
    Span<std::uint32_t> parents;
    Span<Kin> kin;

    __device__ void operator()(Shared& shared) const {
        const std::size_t begin = DescentTile::first();
        std::uint32_t children = 0, total = 0;
        for (unsigned k = 0; k < DescentTile::items && begin + k < fates.size(); ++k)
            children += DescentTile::children(fates[begin + k], split_count);
        std::size_t r = block_begin[blockIdx.x] + block_scan<block_size>(shared.warps, children, total);
        for (unsigned k = 0; k < DescentTile::items && begin + k < fates.size(); ++k) {
            const Fate fate = fates[begin + k];
            const std::uint32_t count = DescentTile::children(fate, split_count);
            for (std::uint32_t c = 0; c < count; ++c, ++r) {
                parents[r] = static_cast<std::uint32_t>(begin + k);
                kin[r] = fate == Fate::split ? Kin::part : c == 0 ? Kin::self : Kin::copy;
            }
        }
    }
};

} // namespace detail

/// The overload of DensityControl's plan. Four numbers come to the host. A change that `most` limits is planned there,
/// because it needs the order of all gradients.
template <class T>
DensityChange plan_descent(Device& device, Span<const Fate> fates, Span<const T> gradients, std::size_t split_count,
                           std::size_t most, gsh::detail::DescentBuffers<Device>& to) {
    if (fates.empty()) return {};
    if (fates.size() > std::numeric_limits<std::uint32_t>::max() / (split_count + 2)) // a count would not fit
        return gsh::detail::plan_descent_on_host(device, fates, gradients, split_count, most, to);
    const std::size_t blocks = chunk_count(fates.size(), detail::DescentTile::size);
    const auto parts = static_cast<std::uint32_t>(split_count);
    Buffer<std::uint32_t> block_counts(blocks), block_begin(blocks + 1), changes(4);
    device.fill(Span<std::uint32_t>(changes), 0u);
    device.launch(blocks, detail::CountDescent{fates, parts, block_counts, changes});
    device.launch(1, detail::ScanDescent{block_counts, block_begin});
    std::uint32_t total = 0, of_fate[4] = {};
    device.download(Span<const std::uint32_t>(changes), Span<std::uint32_t>(of_fate, 4));
    device.download(Span<const std::uint32_t>(block_begin).subspan(blocks, 1), Span<std::uint32_t>(&total, 1));
    if (total > most) return gsh::detail::plan_descent_on_host(device, fates, gradients, split_count, most, to);

    const auto number = [&](Fate fate) { return std::size_t(of_fate[static_cast<unsigned>(fate)]); };
    to.parents.resize(total);
    to.kin.resize(total);
    device.launch(blocks, detail::FillDescent{fates, parts, block_begin, to.parents, to.kin});
    return {.cloned = number(Fate::clone), .split = number(Fate::split), .pruned = number(Fate::prune)};
}

} // namespace gsh::cuda
