// SPDX-License-Identifier: Apache-2.0
/// @file  The packages of gsh-view: a scene for the page's client engine, and a motion.
#pragma once

#include "view/package.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace gsh {
struct LowRank;
}

namespace gsh::programs {

struct ViewMotion;
struct ViewScene;

/// How much a package of a scene keeps.
enum class ScenePacking {
    exact,   ///< all numbers as floats: for a page on the same machine
    compact, ///< 8 and 16 bits: for files
};

/// Everything that the client engine needs to pose, light and draw a scene: a block of bytes (Package).
///
/// Arrays of person p are named "P/…": means, quats (w x y z), log_scales, opacities (after the sigmoid), sh, ao,
/// triangles, barycentric, skin_joints, skin_weights of the Gaussians; rest, shape, expression and pose directions,
/// vertex_joints and vertex_weights of the body's vertices; with a light also faces, caster_vertices, caster_triangles,
/// normal_offsets. The header has filter, clamping, deformation, degree and light.
///
/// `occlusion`, if it is given and not of rank 0, is how the ao of the first person's motions departs from the mean
/// (occlusion_of_motions). The array "0/occlusion_basis" [N, rank] is its basis, and package_motion adds the
/// coefficients of each frame.
[[nodiscard]] std::string package_scene(const ViewScene& scene, ScenePacking packing = ScenePacking::exact,
                                        const LowRank* occlusion = nullptr);

/// A motion for the page: pose [T, 3 J], transl [T, 3], expression [T, E], seconds [T] from 0 on; betas in the header.
/// With `occlusion` also "occlusion" [T, rank]: its rows from `first_row` on.
[[nodiscard]] std::string package_motion(const ViewMotion& motion, const std::vector<std::string>& warnings = {},
                                         const LowRank* occlusion = nullptr, std::size_t first_row = 0);

} // namespace gsh::programs
