// SPDX-License-Identifier: Apache-2.0
/// @file  Sums of gradients over the bones that Gaussians follow, on the GPU, without atomics.
#pragma once

#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/body/skinning.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda::detail {

/// The sums over bones of a block's Gaussians.
///
/// Neighbouring Gaussians follow the same few bones. A warp takes the bones of its Gaussians one after the other: each
/// lane contributes its gradient times its weight, and the lanes are summed by exchanges. Warps are joined in their
/// order, and blocks by JoinBones. Hence nothing needs to be known about the weights in advance.
template <class T, class Bone, unsigned Block>
struct BoneSums {
    static constexpr unsigned numbers = sizeof(Bone) / sizeof(T), warps = Block / warp_size;
    static constexpr unsigned page = 64; ///< bones that are summed at a time, one for each bit of a word
    static constexpr unsigned size = warps * page * numbers;
    static constexpr unsigned slots = 8; ///< influences that are held in registers

    /// Influences of one Gaussian on bones of a page.
    struct Influences {
        unsigned pending = 0; ///< a bit for each slot that is not summed yet
        unsigned bone[slots]; ///< within the page
        T weight[slots];

        __device__ Influences(const SkinWeights<T>& skin, Span<const Bone> bones, std::size_t i, std::size_t begin,
                              std::size_t first_bone) {
            const std::size_t row = i * skin.influences;
            for (unsigned s = 0; s < slots; ++s) {
                bone[s] = 0, weight[s] = T(0);
                const std::size_t k = begin + s;
                if (k >= skin.influences || skin.weights[row + k] == T(0)) continue;
                const std::size_t joint = skin.joints[row + k];
                if (joint - first_bone >= page) continue; // also if it is smaller
                bone[s] = static_cast<unsigned>(joint - first_bone);
                weight[s] = blend_weight(bones, skin.joints[row], joint, skin.weights[row + k]);
                pending |= 1u << s;
            }
        }
        __device__ Influences() {
            for (unsigned s = 0; s < slots; ++s) bone[s] = 0, weight[s] = T(0);
        }
        [[nodiscard]] __device__ unsigned next() const {
            unsigned result = 0;
            for (unsigned s = 0; s < slots; ++s)
                if (pending >> s & 1u) result = bone[s];
            return result;
        }
        /// The weight of a bone, which is then done with.
        __device__ T take(unsigned which) {
            T sum(0);
            for (unsigned s = 0; s < slots; ++s)
                if ((pending >> s & 1u) && bone[s] == which) sum += weight[s], pending &= ~(1u << s);
            return sum;
        }
    };

    /// Writes the warp's sums to sums[warp, bone, number] and returns the bones that it has sums for.
    template <std::size_t Size>
    __device__ static std::uint64_t of_warp(SharedArray<T, Size>& sums, const SkinWeights<T>& skin,
                                            Span<const Bone> bones, std::size_t i, bool seen, const Bone& dL_dblend,
                                            std::size_t first_bone) {
        const T* const gradient = reinterpret_cast<const T*>(&dL_dblend);
        std::uint64_t have = 0;
        for (std::size_t begin = 0; begin < skin.influences; begin += slots) {
            Influences mine = seen ? Influences(skin, bones, i, begin, first_bone) : Influences();
            while (const unsigned waiting = __ballot_sync(all_lanes, mine.pending != 0)) {
                const unsigned bone = __shfl_sync(all_lanes, mine.next(), __ffs(static_cast<int>(waiting)) - 1);
                const T weight = mine.take(bone);
                T terms[numbers];
                for (unsigned n = 0; n < numbers; ++n) terms[n] = weight == T(0) ? T(0) : gradient[n] * weight;
                const bool again = have >> bone & 1u; // has more than `slots` influences on it
                const unsigned first = (threadIdx.x / warp_size * page + bone) * numbers;
                sum_lanes(terms, [&](unsigned n, T sum) {
                    if (again)
                        sums[first + n] += sum;
                    else
                        sums[first + n] = sum;
                });
                have |= std::uint64_t(1) << bone;
            }
        }
        return have;
    }
};

/// One block for each bone, and one more for the centre: adds the sums of all blocks of BackwardSkinned.
template <class T, class Bone>
struct JoinBones {
    static constexpr unsigned block_size = 512, numbers = sizeof(Bone) / sizeof(T), warps = block_size / warp_size;
    static constexpr unsigned page = BoneSums<T, Bone, block_size>::page;
    struct Shared {
        SharedArray<T, warps * numbers> sums;
    };
    Span<const T> bones;              // [blocks, J, numbers]
    Span<const std::uint64_t> follow; // [pages, blocks]
    Span<const T> center;             // [3, blocks] or empty
    std::size_t blocks;
    Span<Bone> dL_dbones;     // [J] or empty
    Span<vec3<T>> dL_dcenter; // [1] or empty

    __device__ void operator()(Shared& shared) const {
        const std::size_t bone = blockIdx.x, J = dL_dbones.size();
        const bool is_bone = bone < J;
        T sums[numbers];
        for (T& sum : sums) sum = T(0);
        for (std::size_t b = threadIdx.x; b < blocks; b += block_size) {
            if (!is_bone) {
                for (unsigned c = 0; c < 3; ++c) sums[c] += center[c * blocks + b];
            } else if (follow[bone / page * blocks + b] >> bone % page & 1u) {
                const T* const from = &bones[(b * J + bone) * numbers];
                for (unsigned n = 0; n < numbers; ++n) sums[n] += from[n];
            }
        }
        const unsigned warp = threadIdx.x / warp_size;
        sum_lanes(sums, [&](unsigned n, T sum) { shared.sums[warp * numbers + n] = sum; });
        __syncthreads();
        const unsigned n = threadIdx.x;
        if (n >= (is_bone ? numbers : 3)) return;
        T total(0);
        for (unsigned w = 0; w < warps; ++w) {
            const T sum = shared.sums[w * numbers + n];
            total += sum;
        }
        if (is_bone)
            view_as<T>(dL_dbones)[bone * numbers + n] += total;
        else
            view_as<T>(dL_dcenter)[n] += total;
    }
};

} // namespace gsh::cuda::detail
