// SPDX-License-Identifier: Apache-2.0
/// @file  Plans a change of density control on a GPU: which Gaussians there are afterwards.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/core/span.hpp>
#include <gsh/learn/cuda/density_limit.cuh>
#include <gsh/learn/cuda/descent_tile.cuh>
#include <gsh/learn/density_descent.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace gsh::cuda {

namespace detail {

using gsh::detail::Kin;

[[nodiscard]] GSH_HD inline std::uint32_t children_of(Fate fate, std::uint32_t split_count) {
    return fate == Fate::prune ? 0 : fate == Fate::clone ? 2 : fate == Fate::split ? split_count : 1;
}

/// The number of children of each block, and the numbers of clones, splits and pruned.
struct CountDescent {
    static constexpr unsigned block_size = DescentTile::threads;
    using Shared = DescentTile::Shared;
    Span<const Fate> fates;
    std::uint32_t split_count;
    Span<std::uint32_t> block_counts;
    Span<std::uint32_t> changes; ///< [4], by fate; zero before. Fate::keep is not counted.

    __device__ void operator()(Shared& shared) const {
        std::uint32_t children = 0, of_fate[4] = {};
        DescentTile::for_each(fates.size(), [&](std::size_t i) {
            children += children_of(fates[i], split_count);
            of_fate[static_cast<unsigned>(fates[i])] += 1;
        });
        for (unsigned f = 1; f < 4; ++f) // not those that are kept: they are many
            if (of_fate[f] != 0) atomicAdd(&changes[f], of_fate[f]);
        std::uint32_t total = 0;
        (void)block_scan<block_size>(shared.warps, children, total);
        if (threadIdx.x == 0) block_counts[blockIdx.x] = total;
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
        std::uint32_t children = 0, total = 0;
        DescentTile::for_each(fates.size(), [&](std::size_t i) { children += children_of(fates[i], split_count); });
        std::size_t r = block_begin[blockIdx.x] + block_scan<block_size>(shared.warps, children, total);
        DescentTile::for_each(fates.size(), [&](std::size_t i) {
            const std::uint32_t count = children_of(fates[i], split_count);
            for (std::uint32_t c = 0; c < count; ++c, ++r) {
                parents[r] = static_cast<std::uint32_t>(i);
                kin[r] = fates[i] == Fate::split ? Kin::part : c == 0 ? Kin::self : Kin::copy;
            }
        });
    }
};

/// The number of children, and of Gaussians of each fate.
struct DescentCounts {
    std::uint32_t children = 0, of_fate[4] = {};
    [[nodiscard]] std::size_t operator[](Fate fate) const { return of_fate[static_cast<unsigned>(fate)]; }
};

inline DescentCounts count_descent(Device& device, Span<const Fate> fates, std::uint32_t split_count,
                                   Span<std::uint32_t> block_begin) {
    const std::size_t blocks = block_begin.size() - 1;
    Buffer<std::uint32_t> block_counts(blocks), changes(4);
    device.fill(Span<std::uint32_t>(changes), 0u);
    device.launch(blocks, CountDescent{fates, split_count, block_counts, changes});
    device.launch(1, ScanDescent{block_counts, block_begin});
    DescentCounts counts;
    device.download(Span<const std::uint32_t>(changes), Span<std::uint32_t>(counts.of_fate, 4));
    device.download(Span<const std::uint32_t>(block_begin).subspan(blocks, 1),
                    Span<std::uint32_t>(&counts.children, 1));
    return counts;
}

} // namespace detail

/// The overload of DensityControl's plan. Five numbers come to the host, ten if `most` limits the change.
template <class T>
DensityChange plan_descent(Device& device, Span<const Fate> fates, Span<const T> gradients, std::size_t split_count,
                           std::size_t most, gsh::detail::DescentBuffers<Device>& to) {
    if (fates.empty()) return {};
    if (fates.size() > std::numeric_limits<std::uint32_t>::max() / (split_count + 2)) // a count would not fit
        return gsh::detail::plan_descent_on_host(device, fates, gradients, split_count, most, to);
    const std::size_t blocks = chunk_count(fates.size(), detail::DescentTile::size);
    const auto parts = static_cast<std::uint32_t>(split_count);
    Buffer<std::uint32_t> block_begin(blocks + 1);
    Buffer<Fate> granted;
    detail::DescentCounts counts = detail::count_descent(device, fates, parts, block_begin);
    if (counts.children > most) {
        const std::size_t kept = fates.size() - counts[Fate::prune];
        granted.resize(fates.size());
        detail::limit_growth(device, fates, gradients, parts, static_cast<std::uint32_t>(most - std::min(most, kept)),
                             Span<Fate>(granted));
        fates = granted;
        counts = detail::count_descent(device, fates, parts, block_begin);
    }
    to.parents.resize(counts.children);
    to.kin.resize(counts.children);
    device.launch(blocks, detail::FillDescent{fates, parts, block_begin, to.parents, to.kin});
    return {.cloned = counts[Fate::clone], .split = counts[Fate::split], .pruned = counts[Fate::prune]};
}

} // namespace gsh::cuda
