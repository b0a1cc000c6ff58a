// SPDX-License-Identifier: Apache-2.0
/// @file  Draws Gaussians as solid ellipsoids, to see what an avatar consists of.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>

namespace gsh::programs {

/// Each splat as the ellipsoid of `ellipsoid_radius` standard deviations, as the projection sees it (no dilation). With
/// q the squared distance of a pixel from the splat's centre in standard deviations and r the radius, where q <= r²
///
///     s = √(1 - q / r²),   depth = z - s r σ_z,   colour = color (0.35 + 0.65 s)
///
/// and the nearest one is kept. Splats of less than `ellipsoid_opacity` are left out. The page's client engine draws
/// the same (programs/web/shaders.js).
inline constexpr float ellipsoid_radius = 1.6f, ellipsoid_opacity = 0.1f;

[[nodiscard]] Image<float> draw_ellipsoids(cpu::Threads& backend, const Camera<float>& camera,
                                           const SplatView<const float>& splats, const vec3<float>& background);

} // namespace gsh::programs
