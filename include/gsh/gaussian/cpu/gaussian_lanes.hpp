// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians and splats in the lanes of vector registers: blocks of them, reading and writing.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_block.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// As is_zero, without a branch.
template <class T>
[[nodiscard]] GSH_INLINE bool has_no_gradient(const SplatView<const T>& dL_dsplats, std::size_t i) {
    using Bits = std::conditional_t<sizeof(T) == 4, std::uint32_t, std::uint64_t>;
    Bits any = std::bit_cast<Bits>(dL_dsplats.opacities[i]);
    const auto take = [&](const auto& numbers) {
        for (std::size_t k = 0; k < sizeof numbers / sizeof(T); ++k)
            any |= std::bit_cast<Bits>(reinterpret_cast<const T*>(&numbers)[k]);
    };
    take(dL_dsplats.means[i]), take(dL_dsplats.colors[i]);
    if (dL_dsplats.is_factored()) take(dL_dsplats.factors[i]);
    else take(dL_dsplats.covariances[i]);
    return Bits(any << 1) == 0; // without the signs
}

/// Runs an element over those of [0, count) that are not skipped, a Block (a WideBlock with a forward or a backward) at
/// a time. The result of a lane depends on its own index alone, so the grouping into blocks does not change any result.
template <class Block, CpuBackend B, class Element, class Skip>
void for_blocks(B& backend, std::size_t count, const Element& element, const Skip& skip) {
    constexpr std::size_t grain = 1024;
    backend.for_chunks(count, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        Block block;
        const auto run = [&] {
            if constexpr (requires { block.forward(mine); }) block.forward(mine);
            else block.backward(mine);
        };
        for (std::size_t i = begin; i < end; ++i)
            if (!skip(i) && block.push(i)) run();
        run();
    });
}
/// The same over all of [0, count).
template <class Block, CpuBackend B, class Element>
void for_blocks(B& backend, std::size_t count, const Element& element) {
    for_blocks<Block>(backend, count, element, [](std::size_t) { return false; });
}

/// The same for an adjoint that may, but need not, skip elements without a gradient. Of `width` neighbours, all are
/// done if half of them have one: skipping single ones costs more, since processors mispredict that branch.
template <class Block, CpuBackend B, class Element>
void for_dense_blocks(B& backend, std::size_t count, const Element& element) {
    constexpr std::size_t grain = 1024, width = Block::width; // whole blocks
    backend.for_chunks(count, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        Block block, sparse;
        for (std::size_t first = begin; first < end; first += width) {
            const std::size_t here = std::min(width, end - first);
            std::size_t wanted = 0;
            for (std::size_t j = 0; j < here; ++j) wanted += !has_no_gradient(mine.dL_dsplats, first + j);
            if (2 * wanted >= here) {
                for (std::size_t j = 0; j < here; ++j) block.push(first + j);
                block.backward(mine);
            } else {
                for (std::size_t j = 0; j < here; ++j)
                    if (!mine.skip(first + j) && sparse.push(first + j)) sparse.backward(mine);
            }
        }
        sparse.backward(mine);
    });
}

/// Reads splats index[0], index[1], … into the lanes [lane, lane + lanes_per_store).
template <class T>
GSH_INLINE void put_splats(Splat<Wide<T>>& wide, std::size_t lane, const std::size_t* index,
                           const SplatView<const T>& from) {
    put_lanes<T>(wide.mean, lane, [&](std::size_t j) -> auto& { return from.means[index[j]]; });
    put_lanes<T>(wide.covariance, lane, [&](std::size_t j) -> auto& { return from.covariances[index[j]]; });
    put_lanes<T>(wide.opacity, lane, [&](std::size_t j) -> auto& { return from.opacities[index[j]]; });
    put_lanes<T>(wide.color, lane, [&](std::size_t j) -> auto& { return from.colors[index[j]]; });
}
template <class T>
GSH_INLINE void put_splats(FactoredSplat<Wide<T>>& wide, std::size_t lane, const std::size_t* index,
                           const SplatView<const T>& from) {
    put_lanes<T>(wide.mean, lane, [&](std::size_t j) -> auto& { return from.means[index[j]]; });
    put_lanes<T>(wide.factor, lane, [&](std::size_t j) -> auto& { return from.factors[index[j]]; });
    put_lanes<T>(wide.opacity, lane, [&](std::size_t j) -> auto& { return from.opacities[index[j]]; });
    put_lanes<T>(wide.color, lane, [&](std::size_t j) -> auto& { return from.colors[index[j]]; });
}
/// Writes splat i from one lane.
template <class T>
GSH_INLINE void get_splat(const Splat<Wide<T>>& wide, std::size_t lane, const SplatView<T>& to, std::size_t i) {
    get_lane<T>(wide.mean, lane, to.means[i]);
    get_lane<T>(wide.covariance, lane, to.covariances[i]);
    get_lane<T>(wide.opacity, lane, to.opacities[i]);
    get_lane<T>(wide.color, lane, to.colors[i]);
}
template <class T>
GSH_INLINE void get_splat(const FactoredSplat<Wide<T>>& wide, std::size_t lane, const SplatView<T>& to, std::size_t i) {
    get_lane<T>(wide.mean, lane, to.means[i]);
    get_lane<T>(wide.factor, lane, to.factors[i]);
    get_lane<T>(wide.opacity, lane, to.opacities[i]);
    get_lane<T>(wide.color, lane, to.colors[i]);
}

/// Reads what all Gaussians have, but for their colours: `wide` is an Input of StaticGaussian or SkinnedGaussian, and
/// `from` a view of their arrays.
template <class T, class Input, class View>
GSH_INLINE void put_attributes(Input& wide, std::size_t lane, const std::size_t* index, const View& from) {
    put_lanes<T>(wide.mean, lane, [&](std::size_t j) -> auto& { return from.means[index[j]]; });
    put_lanes<T>(wide.q, lane, [&](std::size_t j) -> auto& { return from.quats[index[j]]; });
    put_lanes<T>(wide.log_scale, lane, [&](std::size_t j) -> auto& { return from.log_scales[index[j]]; });
    put_lanes<T>(wide.opacity_logit, lane, [&](std::size_t j) -> auto& { return from.opacity_logits[index[j]]; });
}
/// Adds one lane of their gradient to the arrays that are not empty.
template <class T, class Gradient, class View>
GSH_INLINE void add_attributes(const Gradient& wide, std::size_t lane, const View& to, std::size_t i) {
    if (!to.means.empty()) add_lane<T>(wide.mean, lane, to.means[i]);
    if (!to.quats.empty()) add_lane<T>(wide.q, lane, to.quats[i]);
    if (!to.log_scales.empty()) add_lane<T>(wide.log_scale, lane, to.log_scales[i]);
    if (!to.opacity_logits.empty()) add_lane<T>(wide.opacity_logit, lane, to.opacity_logits[i]);
}

} // namespace detail

} // namespace gsh::cpu
