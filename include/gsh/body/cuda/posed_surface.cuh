// SPDX-License-Identifier: Apache-2.0
/// @file  The gradient of bones by a posed mesh on the GPU: a warp for each piece of a bone, then one for each bone.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/body/posed_surface.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh::cuda {

namespace detail {

/// Calls use(number, sum over the lanes) for the twelve numbers of an affine map.
template <class T, class Use>
__device__ void sum_affines(const Affine<T>& map, const Use& use) {
    T values[12];
    for (int c = 0; c < 4; ++c)
        for (int r = 0; r < 3; ++r) values[3 * c + r] = c < 3 ? map.linear[c][r] : map.translation[r];
    sum_lanes(values, use);
}

/// BonePieceBackward, a warp for each piece.
template <class T>
struct SumBonePieces {
    static constexpr unsigned block_size = 128;
    gsh::detail::BonePieceBackward<T> element;

    __device__ void operator()() const {
        const std::size_t piece = (std::size_t(blockIdx.x) * block_size + threadIdx.x) / warp_size;
        if (piece >= element.dL_dpieces.size()) return;
        const auto& [starts, moved, rest, offsets, dL_dposed, dL_dpieces] = element;
        Affine<T> sum = Affine<T>::zero();
        for (std::uint32_t e = starts[piece] + threadIdx.x % warp_size; e < starts[piece + 1]; e += warp_size) {
            const std::uint32_t v = moved[e].vertex;
            const vec3<T> g = dL_dposed[v] * moved[e].weight;
            sum.linear += outer(g, rest.empty() ? offsets[v] : rest[v] + offsets[v]);
            if (!rest.empty()) sum.translation += g;
        }
        const Span<T> numbers = view_as<T>(dL_dpieces);
        sum_affines(sum, [&](unsigned n, T total) { numbers[12 * piece + n] = total; });
    }
};

/// JoinBonePieces, a warp for each bone.
template <class T>
struct JoinBonePiecesByWarps {
    static constexpr unsigned block_size = warp_size;
    gsh::detail::JoinBonePieces<T> element;

    __device__ void operator()() const {
        const std::size_t j = blockIdx.x;
        Affine<T> sum = Affine<T>::zero();
        for (std::uint32_t piece = element.bone_pieces[j] + threadIdx.x; piece < element.bone_pieces[j + 1];
             piece += warp_size)
            sum.add_scaled(element.dL_dpieces[piece], T(1));
        const Span<T> numbers = view_as<T>(element.dL_dbones);
        sum_affines(sum, [&](unsigned n, T total) { numbers[12 * j + n] += total; });
    }
};

} // namespace detail

template <class T>
void bone_pieces_sum(Device& device, const gsh::detail::BonePieceBackward<T>& element) {
    using Kernel = detail::SumBonePieces<T>;
    device.launch(chunk_count(element.dL_dpieces.size() * warp_size, Kernel::block_size), Kernel{element});
}

template <class T>
void bone_pieces_join(Device& device, const gsh::detail::JoinBonePieces<T>& element) {
    device.launch(element.dL_dbones.size(), detail::JoinBonePiecesByWarps<T>{element});
}

} // namespace gsh::cuda
