// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar with some of its Gaussians, in any order, or with fewer SH bands.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

/// The avatar whose Gaussian i is Gaussian order[i] of `avatar`, with everything that belongs to it: its place on the
/// body, weights, ambient occlusion, light.
///
/// Errors  ValueError for an index beyond the avatar's Gaussians.
[[nodiscard]] inline AvatarData avatar_part(const AvatarData& avatar, Span<const std::uint32_t> order) {
    AvatarData part = avatar;
    part.gaussians = reordered(avatar.gaussians, order); // checks the indices
    const auto take = [&](auto& rows, const auto& from, std::size_t width) {
        if (from.empty()) return;
        rows.clear();
        for (const std::uint32_t i : order)
            rows.insert(rows.end(), from.begin() + static_cast<std::ptrdiff_t>(i * width),
                        from.begin() + static_cast<std::ptrdiff_t>((i + 1) * width));
    };
    take(part.rig.triangles, avatar.rig.triangles, 1);
    take(part.rig.barycentric, avatar.rig.barycentric, 1);
    take(part.rig.skin.joints, avatar.rig.skin.joints, avatar.rig.skin.influences);
    take(part.rig.skin.weights, avatar.rig.skin.weights, avatar.rig.skin.influences);
    take(part.ao, avatar.ao, 1);
    take(part.mean_irradiance, avatar.mean_irradiance, 1);
    if (avatar.occlusion_field)
        take(part.occlusion_field->neurons, avatar.occlusion_field->neurons,
             static_cast<std::size_t>(avatar.occlusion_field->width));
    return part;
}

} // namespace gsh
