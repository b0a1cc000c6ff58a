// SPDX-License-Identifier: Apache-2.0
/// @file  How much memory training takes, so that a budget can be an input.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// Bytes that training takes: a constant part, and a part per Gaussian.
struct MemoryModel {
    std::uint64_t fixed = 0;
    std::uint64_t per_gaussian = 0;

    [[nodiscard]] std::uint64_t bytes(std::size_t gaussians) const { return fixed + per_gaussian * gaussians; }
    /// The most Gaussians that stay within a budget.
    [[nodiscard]] std::size_t gaussians_within(std::uint64_t budget) const {
        return budget <= fixed ? 0 : static_cast<std::size_t>((budget - fixed) / per_gaussian);
    }
};

/// What training AvatarModel in float takes, for images of `pixels` pixels and with `held` bytes (the capture) in memory
/// already. Counted from the buffers and compared with measured peaks, docs/performance.md.
[[nodiscard]] inline MemoryModel training_memory(std::size_t pixels, std::uint64_t held) {
    constexpr std::uint64_t tables = 170'000'000; // two hash tables with gradients and moments
    constexpr std::uint64_t program = 150'000'000; // code, body model, copies for checkpoints
    constexpr std::uint64_t per_pixel = 100;       // render, photograph, gradients, loss terms
    return {.fixed = tables + program + held + per_pixel * pixels, .per_gaussian = 3600};
}

} // namespace gsh
