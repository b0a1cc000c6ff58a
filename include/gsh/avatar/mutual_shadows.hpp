// SPDX-License-Identifier: Apache-2.0
/// @file  Posing several people who cast shadows on each other.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/light/shadow_triangle.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// Metres between the roots of two people, beyond which they do not cast shadows on each other. A depth map covers all
/// casters, so a person far outside of the cameras' view would otherwise make its texels too large.
inline constexpr double shadow_reach = 4;

/// Whether two people with these roots do.
[[nodiscard]] inline bool cast_shadows_on_each_other(const vec3<double>& a, const vec3<double>& b) {
    return length(a - b) < shadow_reach;
}

/// Poses people of one frame: calls pose(p, others) once for each person p, in order. `others` are the meshes of the
/// people within shadow_reach of p.
///
/// Shapes  roots [people], each person's `transl` in the frame, in the world; caster(p) is the mesh of person p in the
///         backend's memory, without triangles for people without a light. A mesh must stay as it is until the last
///         call of pose.
template <std::floating_point T, class CasterOf, class Pose>
void pose_people(Span<const vec3<double>> roots, const CasterOf& caster, const Pose& pose) {
    const std::size_t count = roots.size();
    std::vector<ShadowCaster<T>> casters(count);
    for (std::size_t p = 0; p < count && count > 1; ++p) casters[p] = caster(p);
    for (std::size_t p = 0; p < count; ++p) {
        std::vector<ShadowCaster<T>> others;
        for (std::size_t k = 0; k < count; ++k)
            if (k != p && !casters[k].triangles.empty() && cast_shadows_on_each_other(roots[k], roots[p]))
                others.push_back(casters[k]);
        pose(p, Span<const ShadowCaster<T>>(others));
    }
}

} // namespace gsh
