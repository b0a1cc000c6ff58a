// SPDX-License-Identifier: Apache-2.0
/// @file  What an avatar learns, group by group; a gradient and an optimiser's moments have the same form.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string_view>

namespace gsh {

/// Parameters that share a learning rate. Which of them an avatar has depends on its configuration; the others are
/// empty.
enum class ParameterGroup : std::size_t {
    joints,               ///< [J, 3] rest positions, metres
    quats,                ///< [N, 4] w, x, y, z
    log_scales,           ///< [N, 3]
    opacity_logits,       ///< [N]
    displacements,        ///< [N, 3] δx of each Gaussian, where no field gives it
    sh,                   ///< [N, (degree + 1)², 3] colours of each Gaussian, where no field gives them
    joint_table,          ///< hash table of the field x₀ ↦ (SH, δx)
    joint_network,        ///< its network
    displacement_table,   ///< hash table of the field x₀ ↦ δx
    displacement_network, ///< its network
    sh_table,             ///< hash table of the field x₀ ↦ SH
    sh_network,           ///< its network
    ao_table,             ///< hash table of the field of ambient occlusion
    ao_network,           ///< its network
};

inline constexpr std::array<std::string_view, 14> parameter_group_names{
    "joints",   "quats",       "log_scales",    "opacity_logits",     "displacements",
    "sh",       "joint_table", "joint_network", "displacement_table", "displacement_network",
    "sh_table", "sh_network",  "ao_table",      "ao_network"};
inline constexpr std::size_t parameter_group_count = parameter_group_names.size();

/// One array of numbers per group, in the backend's memory.
template <Backend B, std::floating_point T = float>
class Parameters {
public:
    using Buffer = typename B::template Buffer<T>;

    [[nodiscard]] Buffer& operator[](ParameterGroup group) { return groups_[static_cast<std::size_t>(group)]; }
    [[nodiscard]] const Buffer& operator[](ParameterGroup group) const {
        return groups_[static_cast<std::size_t>(group)];
    }

    /// Takes the sizes of another set and becomes zero.
    void become_zero_like(B& backend, const Parameters& other) {
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            groups_[g].resize(other.groups_[g].size());
            backend.fill(Span<T>(groups_[g]), T(0));
        }
    }
    [[nodiscard]] std::size_t size() const {
        std::size_t total = 0;
        for (const auto& group : groups_) total += group.size();
        return total;
    }

private:
    std::array<Buffer, parameter_group_count> groups_;
};

} // namespace gsh
