// SPDX-License-Identifier: Apache-2.0
/// @file  Density control with a limit on the number of Gaussians: which ones a GPU clones and splits.
///
/// Gaussians with the largest gradients come first (ties: the lower index). A radix select finds the first that does
/// not fit, without sorting: each pass sums the growth of all candidates by the next 8 bits of their gradient, and
/// keeps the 8 bits at which the running sum exceeds the room. Four passes find a gradient in `float`. One more pass,
/// over the candidates with this gradient, finds the index.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/scan.cuh>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/cuda/descent_tile.cuh>
#include <gsh/learn/density_descent.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh::cuda::detail {

/// The candidates for growth and their order. A Gaussian with a growth of 0 is none.
template <class T>
struct GrowthCandidates {
    using Key = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
    static constexpr int digits = sizeof(T); // of 8 bits

    Span<const Fate> wishes, granted;
    Span<const T> gradients;
    std::uint32_t split_count;
    bool refused_clones; ///< the candidates are clones that the first round refused

    [[nodiscard]] __device__ std::uint32_t growth(std::size_t i) const {
        const Fate wish = wishes[i];
        if (refused_clones) return wish == Fate::clone && granted[i] == Fate::keep ? 1 : 0;
        return wish == Fate::clone ? 1 : wish == Fate::split ? split_count - 1 : 0;
    }
    /// Bits in the order of the gradients.
    [[nodiscard]] __device__ Key key(std::size_t i) const {
        constexpr Key sign = Key(1) << (8 * sizeof(Key) - 1);
        const Key bits = bits_as<Key>(gradients[i] + T(0)); // -0 becomes 0
        return bits & sign ? ~bits : bits | sign;
    }
};

/// The search for the first candidate that does not fit.
template <class Key>
struct GrowthSearch {
    Key key;               ///< of its gradient; the bits that are not found yet are 0
    std::uint32_t room;    ///< what candidates with larger gradients leave
    std::uint32_t all_fit; ///< 1: there is no such candidate; 32 bits, so that no byte is padding
};

/// The growth of all candidates that agree with the bits found so far, by their next 8 bits.
template <class T>
struct SumDigits {
    static constexpr unsigned block_size = 256;
    GrowthCandidates<T> candidates;
    Span<const GrowthSearch<typename GrowthCandidates<T>::Key>> search;
    int shift;
    Span<std::uint32_t> sums; ///< [256], zero before

    __device__ void operator()() const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        if (i >= candidates.wishes.size()) return;
        const std::uint32_t growth = candidates.growth(i);
        if (growth == 0) return;
        const auto digit = (candidates.key(i) ^ search[0].key) >> shift;
        if (digit < 256) atomicAdd(&sums[static_cast<std::size_t>(digit)], growth);
    }
};

/// Finds the next 8 bits, the largest first. One block.
template <class Key>
struct FindDigit {
    static constexpr unsigned block_size = 256;
    struct Shared {
        SharedArray<std::uint32_t, block_size / warp_size> warps;
    };
    Span<GrowthSearch<Key>> search;
    int shift;
    Span<std::uint32_t> sums; ///< zero afterwards

    __device__ void operator()(Shared& shared) const {
        const std::size_t digit = block_size - 1 - threadIdx.x;
        const std::uint32_t own = sums[digit];
        sums[digit] = 0;
        std::uint32_t total = 0;
        const std::uint32_t before = block_scan<block_size>(shared.warps, own, total);
        GrowthSearch<Key> found = search[0];
        __syncthreads(); // every thread has read it
        if (total <= found.room) {
            if (threadIdx.x == 0) found.all_fit = true, search[0] = found;
        } else if (before <= found.room && own > found.room - before) {
            found.key |= Key(digit) << shift;
            found.room -= before;
            search[0] = found;
        }
    }
};

/// The candidates with the gradient that was found, among which the index decides.
template <class T>
struct TiedCandidates {
    GrowthCandidates<T> candidates;
    Span<const GrowthSearch<typename GrowthCandidates<T>::Key>> search;

    /// The growth of a tied candidate; 0 for all others.
    [[nodiscard]] __device__ std::uint32_t growth(std::size_t i) const {
        const std::uint32_t growth = candidates.growth(i);
        return growth != 0 && !search[0].all_fit && candidates.key(i) == search[0].key ? growth : 0;
    }
    /// Summed over the Gaussians of the running thread.
    [[nodiscard]] __device__ std::uint32_t growth_of_thread() const {
        std::uint32_t sum = 0;
        DescentTile::for_each(candidates.wishes.size(), [&](std::size_t i) { sum += growth(i); });
        return sum;
    }
};

/// The growth of tied candidates, for each block.
template <class T>
struct SumTies {
    static constexpr unsigned block_size = DescentTile::threads;
    using Shared = DescentTile::Shared;
    TiedCandidates<T> ties;
    Span<std::uint32_t> block_sums;

    __device__ void operator()(Shared& shared) const {
        std::uint32_t total = 0;
        (void)block_scan<block_size>(shared.warps, ties.growth_of_thread(), total);
        if (threadIdx.x == 0) block_sums[blockIdx.x] = total;
    }
};

/// Grants the wishes of the candidates that fit, and writes the room that they leave.
template <class T>
struct GrantRoom {
    static constexpr unsigned block_size = DescentTile::threads;
    using Shared = DescentTile::Shared;
    TiedCandidates<T> ties;
    Span<const std::uint32_t> block_begin; ///< sums of ties in the blocks before
    Span<Fate> granted;
    Span<std::uint32_t> room_left;

    __device__ void operator()(Shared& shared) const {
        const GrowthCandidates<T>& candidates = ties.candidates;
        const auto found = ties.search[0];
        std::uint32_t total = 0;
        std::uint32_t before =
            block_begin[blockIdx.x] + block_scan<block_size>(shared.warps, ties.growth_of_thread(), total);
        DescentTile::for_each(candidates.wishes.size(), [&](std::size_t i) {
            const std::uint32_t growth = candidates.growth(i), tied = ties.growth(i);
            bool fits = growth != 0 && (found.all_fit || candidates.key(i) > found.key);
            if (tied != 0) {
                fits = before + tied <= found.room;
                if (before <= found.room && !fits) room_left[0] = found.room - before; // the first that does not fit
                before += tied;
            }
            if (growth != 0) granted[i] = fits ? candidates.wishes[i] : Fate::keep;
            else if (!candidates.refused_clones) granted[i] = candidates.wishes[i];
        });
    }
};

/// Grants the wishes of candidates in their order, up to the first that does not fit.
template <class T>
void grant_in_order(Device& device, const GrowthCandidates<T>& candidates, std::uint32_t room, Span<Fate> granted,
                    Span<std::uint32_t> room_left) {
    using Key = typename GrowthCandidates<T>::Key;
    const std::size_t count = candidates.wishes.size(), blocks = chunk_count(count, DescentTile::size);
    Buffer<GrowthSearch<Key>> search(1);
    Buffer<std::uint32_t> sums(256), block_sums(blocks), block_begin(blocks + 1);
    device.fill(Span<GrowthSearch<Key>>(search), GrowthSearch<Key>{0, room, 0});
    device.fill(Span<std::uint32_t>(sums), 0u);
    for (int shift = 8 * (GrowthCandidates<T>::digits - 1); shift >= 0; shift -= 8) {
        device.launch(chunk_count(count, SumDigits<T>::block_size), SumDigits<T>{candidates, search, shift, sums});
        device.launch(1, FindDigit<Key>{search, shift, sums});
    }
    const TiedCandidates<T> ties{candidates, search};
    device.launch(blocks, SumTies<T>{ties, block_sums});
    device.launch(1, ScanDescent{block_sums, block_begin});
    device.launch(blocks, GrantRoom<T>{ties, block_begin, granted, room_left});
}

/// The fates of Gaussians when only `room` may be added. `fates` would add more.
template <class T>
void limit_growth(Device& device, Span<const Fate> fates, Span<const T> gradients, std::uint32_t split_count,
                  std::uint32_t room, Span<Fate> granted) {
    Buffer<std::uint32_t> room_left(1);
    device.fill(Span<std::uint32_t>(room_left), 0u);
    grant_in_order<T>(device, {fates, granted, gradients, split_count, false}, room, granted, room_left);
    if (split_count <= 2) return; // the others need as much room as the one that did not fit
    // A split did not fit; clones with smaller gradients may.
    device.download(Span<const std::uint32_t>(room_left), Span<std::uint32_t>(&room, 1));
    if (room > 0) grant_in_order<T>(device, {fates, granted, gradients, split_count, true}, room, granted, room_left);
}

} // namespace gsh::cuda::detail
