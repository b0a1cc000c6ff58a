// SPDX-License-Identifier: Apache-2.0
/// @file  An estimate of the memory that training takes, to choose the number of Gaussians for a budget.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/learn/part_size.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/model/configured_avatar_params.hpp>
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

/// Bytes that training takes beside what the parts of an avatar state (avatar_size), as measured.
struct BufferCosts {
    std::uint64_t fixed = 0;
    std::uint64_t per_pixel = 0;    ///< render, photograph, gradients, loss terms
    std::uint64_t per_gaussian = 0; ///< splats, their gradients, gains, bones, tiles; in the end, the exported avatar
    std::uint64_t per_query = 0;    ///< of each Gaussian: lists of what is added to the entries of a table
    std::uint64_t networks = 0;     ///< numbers beside each weight of a network
};
/// Of a process that trains on the CPU. The fixed part is code, the body model, and copies for checkpoints.
inline constexpr BufferCosts host_costs{.fixed = 85'000'000, .per_pixel = 100, .per_gaussian = 914};
/// Of a GPU's memory, without CUDA's own context. Up to 512 blocks of threads add to gradients of their own.
inline constexpr BufferCosts device_costs{
    .fixed = 15'000'000, .per_pixel = 100, .per_gaussian = 360, .per_query = 800, .networks = 512};

/// The memory of training the avatar of a configuration, for images of `pixels` pixels, with `held` bytes (the capture)
/// in memory already. Learned arrays and the activations of fields are counted exactly, from the sizes that the parts
/// state (avatar_size). The other buffers are estimated. For 170,000 Gaussians and 210 photographs of 540² the result
/// is 1.00 times the peak of `paper`, and 1.03 times those of `no-ao` and `light`; on an emulated GPU, 1.04 times that
/// of `paper`, and with 20,000 Gaussians 1.00 to 1.05 times the peaks of `paper`, `no-ao`, `light` and `baseline`. A
/// budget therefore needs a margin of its own. Each of several people has own fields; the number of Gaussians is that
/// of one person.
template <Backend B, class Parts = AvatarParts, std::floating_point T = float>
[[nodiscard]] MemoryModel training_memory(const ConfiguredAvatarParams& config, std::size_t pixels, std::uint64_t held,
                                          std::size_t people = 1, const AvatarInputs& inputs = {},
                                          const BufferCosts& costs = host_costs) {
    const PartSize avatar = avatar_size<B, Parts, T>(config, inputs.joint_count, inputs.priors);
    const std::uint64_t others = costs.per_gaussian + costs.per_query * avatar.queries;
    MemoryModel memory{.fixed = costs.fixed + held + costs.per_pixel * pixels + people * sizeof(T) * avatar.fixed(),
                       .per_gaussian = people * (others + sizeof(T) * avatar.per_point())};
    for (const LearnedSize& array : avatar.learned)
        if (array.name.ends_with(".network")) memory.fixed += people * sizeof(T) * costs.networks * array.fixed;
    const std::size_t pose = inputs.vertex_count * sizeof(vec3<T>);
    if (keeps_poses(inputs.frame_count, pose)) memory.fixed += people * inputs.frame_count * pose;
    if (config.light) {
        // The posed mesh, its normals, their gradients, the caster; normal offsets with gradient and moments.
        const std::uint64_t per_vertex = 160 + (config.model.normal_offset_rate > 0 ? 60 : 0);
        constexpr ShadowMapParams maps;
        const auto points = static_cast<std::uint64_t>(config.lights.points),
                   directions = static_cast<std::uint64_t>(config.lights.directions);
        const auto area = [](int side) { return static_cast<std::uint64_t>(side) * static_cast<std::uint64_t>(side); };
        const std::uint64_t texels =
            points * area(maps.point_resolution) + directions * area(maps.direction_resolution);
        memory.fixed += people * (inputs.vertex_count * (per_vertex + sizeof(T) * (points + directions)) +
                                  (config.lights.shadows ? sizeof(T) * texels : 0));
        memory.per_gaussian += people * 116; // corners, posed means, colours without light, irradiance, gradients
    }
    return memory;
}

} // namespace gsh
