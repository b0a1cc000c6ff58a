// SPDX-License-Identifier: Apache-2.0
/// @file  How much memory training takes, so that a budget can be an input.
#pragma once

#include <gsh/train/avatar_model.hpp>

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

/// What training AvatarModel in float takes, for images of `pixels` pixels and with `held` bytes (the capture) in
/// memory already. Counted from the buffers: 1.1 times the measured peak of 210 images of 540². Of several people each
/// has fields of their own, and the number of Gaussians is each one's.
[[nodiscard]] inline MemoryModel training_memory(const AvatarConfig& config, std::size_t pixels, std::uint64_t held,
                                                 std::size_t people = 1) {
    constexpr std::uint64_t program = 150'000'000; // code, body model, copies for checkpoints
    constexpr std::uint64_t per_pixel = 100;       // render, photograph, gradients, loss terms
    // A field: a table of at most 16 levels of 4 features with gradient and two moments; per Gaussian 64 features and
    // two hidden layers, the features' gradient, outputs.
    const auto table = [](std::uint64_t entries) { return 16 * 4 * sizeof(float) * 4 * entries; };
    constexpr std::uint64_t field_per_gaussian = 1300;
    const std::uint64_t heads = (config.hash_sh ? 1u : 0u) + (config.hash_displacement ? 1u : 0u);
    const std::uint64_t fields = config.heads == Heads::joint && heads ? 1 : heads;
    const bool ao = config.ao != AmbientOcclusion::none;
    return {.fixed = program + held + per_pixel * pixels +
                     people * (fields * table(config.hash_table_size) + (ao ? table(config.ao_table_size) : 0)),
            .per_gaussian = people * (1000 + field_per_gaussian * (fields + (ao ? 1 : 0)))};
}

} // namespace gsh
