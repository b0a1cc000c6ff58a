// SPDX-License-Identifier: Apache-2.0
/// @file  A small avatar on a tube, for tests of what is made of an avatar.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/math/vec.hpp>

#include "support/bodies.hpp"

#include <cstddef>
#include <vector>

namespace gsh::test {

/// A tube whose Gaussians lie 2 cm outside of it, red on the left (x > 0) and blue on the right.
inline AvatarData tube_avatar(double density = 12) {
    BodyModel body = tube(4, 8, 8);
    body.posedirs.clear(); // formats of meshes have none
    for (std::size_t v = 0; v < body.vertex_count(); ++v)
        if (v < 40 || v >= 60) body.exprdirs[2 * v] = vec3<double>(0); // the first expression is sparse
    const std::vector<double> betas{0.3, -0.1};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), density), 3);
    AvatarData avatar{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 1)};
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const vec3<double>& p = samples.positions[i];
        const vec3<double> out = normalize(vec3<double>(p.x, 0, p.z));
        avatar.gaussians.means[i] = vec3<float>(p + out * 0.02);
        avatar.gaussians.opacity_logits[i] = 3;
        avatar.gaussians.sh[4 * i] = sh_of_color(p.x > 0 ? vec3<float>(1, 0, 0) : vec3<float>(0, 0, 1));
    }
    return avatar;
}

} // namespace gsh::test
