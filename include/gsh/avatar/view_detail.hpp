// SPDX-License-Identifier: Apache-2.0
/// @file  How many Gaussians an avatar needs in a picture, by the size at which the picture shows its body.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// Square metres of the surface of a rig's body, in its own shape.
[[nodiscard]] inline double surface_area(const RigData& rig) {
    const std::vector<vec3<double>> vertices = shaped_vertices(rig.body, rig.betas);
    double area = 0;
    for (const std::array<int, 3>& t : rig.body.faces) {
        const vec3<double>&a = vertices[static_cast<std::size_t>(t[0])], &b = vertices[static_cast<std::size_t>(t[1])],
              &c = vertices[static_cast<std::size_t>(t[2])];
        area += 0.5 * length(cross(b - a, c - a));
    }
    return area;
}

/// Pixels that a metre at a place covers, if it faces the camera; 0 for a place that is not in front of it.
[[nodiscard]] inline double pixels_per_metre(const Camera<double>& camera, const vec3<double>& place) {
    const double depth = (camera.R * place + camera.t).z;
    return depth > 0 ? std::sqrt(camera.fx * camera.fy) / depth : 0;
}

/// The number of Gaussians that a surface of `area` square metres needs in a picture in which a metre of it covers
/// `pixels_per_metre` pixels:
///
///     2150 · area · √pixels_per_metre, and at least 1.
///
/// The rule is measured, not derived: coarser_avatar with that many Gaussians loses 0.2 to 0.3 dB against photographs.
/// The number falls more slowly than that of the pixels, because merged Gaussians also lose shape. An avatar with no
/// more Gaussians is shown as it is.
///
/// Errors  ValueError for a number that is negative or not finite.
[[nodiscard]] inline std::size_t gaussians_for_view(double area, double pixels_per_metre) {
    check_value(std::isfinite(area) && area >= 0 && std::isfinite(pixels_per_metre) && pixels_per_metre >= 0,
                "gaussians_for_view", "area and pixels_per_metre must be finite and at least 0");
    return static_cast<std::size_t>(std::clamp(std::ceil(2150 * area * std::sqrt(pixels_per_metre)), 1.0, 1e15));
}

} // namespace gsh
