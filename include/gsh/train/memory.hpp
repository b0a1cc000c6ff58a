// SPDX-License-Identifier: Apache-2.0
/// @file  An estimate of the memory that training takes, to choose the number of Gaussians for a budget.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/avatar_config.hpp>
#include <gsh/pipeline/canonical_points.hpp>
#include <gsh/pipeline/configured_avatar.hpp>
#include <gsh/pipeline/part_size.hpp>
#include <gsh/train/avatar_scene.hpp>

#include <concepts>
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

/// What the memory of an avatar depends on beside its configuration. The defaults are SMPL-X's joints and the priors of
/// its mesh.
struct AvatarInputs {
    std::size_t joint_count = 55;
    PriorInputs priors{.feature_count = 10, .has_region = true};
    std::size_t vertex_count = 10475; ///< of the mesh, for light and prepared poses
    std::size_t frame_count = 0;      ///< of the motion
};

/// The memory of training the avatar of a configuration, for images of `pixels` pixels, with `held` bytes (the capture)
/// in memory already. Learned arrays and the activations of fields are counted exactly, from the sizes that the parts
/// state (avatar_size). The other buffers are estimated. For 170,000 Gaussians and 210 photographs of 540² the result
/// is 1.00 times the peak of `paper`, and 1.03 times those of `no-ao` and `light`. A budget therefore needs a margin of
/// its own. Each of several people has own fields; the number of Gaussians is that of one person.
template <Backend B, std::floating_point T = float>
[[nodiscard]] MemoryModel training_memory(const AvatarConfig& config, std::size_t pixels, std::uint64_t held,
                                          std::size_t people = 1, const AvatarInputs& inputs = {}) {
    constexpr std::uint64_t program = 85'000'000; // code, body model, copies for checkpoints
    constexpr std::uint64_t per_pixel = 100;      // render, photograph, gradients, loss terms
    // Splats, their gradients, gains, bones, tiles; in the end, the avatar that is exported and filled points.
    constexpr std::uint64_t per_gaussian = 914;
    const PartSize avatar = avatar_size<B, T>(config, inputs.joint_count, inputs.priors);
    MemoryModel memory{.fixed = program + held + per_pixel * pixels + people * sizeof(T) * avatar.fixed(),
                       .per_gaussian = people * (per_gaussian + sizeof(T) * avatar.per_point())};
    const std::size_t pose = inputs.vertex_count * sizeof(vec3<T>);
    if (keeps_poses(inputs.frame_count, pose)) memory.fixed += people * inputs.frame_count * pose;
    if (config.light) {
        // The posed mesh, its normals, their gradients, the caster; normal offsets with gradient and moments.
        const std::uint64_t per_vertex = 160 + (config.rates.light_normals > 0 ? 60 : 0);
        constexpr ShadowMapParams maps;
        const auto points = static_cast<std::uint64_t>(config.light_points),
                   directions = static_cast<std::uint64_t>(config.light_directions);
        const auto area = [](int side) { return static_cast<std::uint64_t>(side) * static_cast<std::uint64_t>(side); };
        const std::uint64_t texels =
            points * area(maps.point_resolution) + directions * area(maps.direction_resolution);
        memory.fixed += people * (inputs.vertex_count * (per_vertex + sizeof(T) * (points + directions)) +
                                  (config.light_shadows ? sizeof(T) * texels : 0));
        memory.per_gaussian += people * 116; // corners, posed means, colours without light, irradiance, gradients
    }
    return memory;
}

} // namespace gsh
