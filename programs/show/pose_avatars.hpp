// SPDX-License-Identifier: Apache-2.0
/// @file  Posing all avatars of a picture, for the renderer of the programs and for gsh-view.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/mutual_shadows.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <deque>
#include <vector>

namespace gsh::programs {

/// Writes the splats of all avatars, one avatar after the other, as seen from `center`. Avatars with a light cast
/// shadows on each other.
///
/// Shapes  poses, roots, caches [avatars]; roots are the poses' `transl`.
template <Backend B>
void pose_avatars(const std::deque<Avatar<B>>& avatars, const std::vector<RigPose<B, float>>& poses,
                  Span<const vec3<double>> roots, const vec3<float>& center, const SplatView<float>& splats,
                  std::vector<typename Avatar<B>::Cache>& caches) {
    for (std::size_t p = 0; p < avatars.size(); ++p) avatars[p].move(poses[p], caches[p]);
    const auto caster = [&](std::size_t p) {
        return avatars[p].is_lit() ? avatars[p].caster(caches[p]) : ShadowCaster<float>();
    };
    std::size_t first = 0;
    pose_people<float>(roots, caster, [&](std::size_t p, Span<const ShadowCaster<float>> others) {
        avatars[p].write_splats(center, splats.subview(first, avatars[p].size()), caches[p], others);
        first += avatars[p].size();
    });
}

} // namespace gsh::programs
