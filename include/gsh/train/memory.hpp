// SPDX-License-Identifier: Apache-2.0
/// @file  An estimate of the memory that training takes, to choose the number of Gaussians for a budget.
#pragma once

#include <gsh/math/sh.hpp>
#include <gsh/pipeline/avatar_config.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

/// The memory of training in bytes: a constant part, and a part per Gaussian.
struct MemoryModel {
    std::uint64_t fixed = 0;
    std::uint64_t per_gaussian = 0;

    [[nodiscard]] std::uint64_t bytes(std::size_t gaussians) const { return fixed + per_gaussian * gaussians; }
    /// The largest number of Gaussians within a budget.
    [[nodiscard]] std::size_t gaussians_within(std::uint64_t budget) const {
        return budget <= fixed ? 0 : static_cast<std::size_t>((budget - fixed) / per_gaussian);
    }
};

/// The memory of training AvatarModel in float, for images of `pixels` pixels, with `held` bytes (the capture) in
/// memory already. The estimate is counted from the buffers. It is 1.1 times the peak that was measured for `paper`
/// with 210 images of 540². Each of several people has own fields; the number of Gaussians is that of one person.
[[nodiscard]] inline MemoryModel training_memory(const AvatarConfig& config, std::size_t pixels, std::uint64_t held,
                                                 std::size_t people = 1) {
    constexpr std::uint64_t program = 150'000'000; // code, body model, copies for checkpoints
    constexpr std::uint64_t per_pixel = 100;       // render, photograph, gradients, loss terms
    constexpr std::uint64_t per_gaussian = 1000;   // attributes, splats, their gradients and moments, tiles
    constexpr std::uint64_t levels = 16, features = 4, colors = 3 * sh_basis_count(2), displacement = 3;
    MemoryModel memory{.fixed = program + held + per_pixel * pixels, .per_gaussian = people * per_gaussian};
    // A field: tables with gradient and two moments; per Gaussian features, hidden layers and outputs, and gradients of
    // the first and last.
    const auto add_field = [&](std::uint64_t entries, std::uint64_t tables, std::uint64_t outputs) {
        const auto hidden = static_cast<std::uint64_t>(config.mlp_hidden_layers) *
                            static_cast<std::uint64_t>(config.mlp_width);
        memory.fixed += people * sizeof(float) * 4 * tables * entries * levels * features;
        memory.per_gaussian += people * sizeof(float) * (2 * levels * features + hidden + 2 * outputs);
    };
    const auto add_stored = [&](std::uint64_t numbers) { // values with gradient and two moments
        memory.per_gaussian += people * sizeof(float) * 4 * numbers;
    };
    const std::uint64_t tables = config.separate_tables ? 2 : 1;
    const bool joint = config.has_joint_head();
    if (joint) add_field(config.hash_table_size, tables, colors + displacement);
    if (!joint && config.hash_sh) add_field(config.hash_table_size, tables, colors);
    if (!joint && config.hash_displacement) add_field(config.hash_table_size, tables, displacement);
    if (!config.hash_sh) add_stored(colors);
    if (!config.hash_displacement) add_stored(displacement);
    if (config.ao != AmbientOcclusion::none) add_field(config.ao_table_size, 1, 1);
    return memory;
}

} // namespace gsh
