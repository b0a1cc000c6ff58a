// SPDX-License-Identifier: Apache-2.0
/// @file  How far a landmark lies from a keypoint.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>

namespace gsh {

/// In pixels of the image, and in metres at the landmark's depth.
struct KeypointDistance {
    double pixels = 0, metres = 0;
};

/// The distance of a landmark from a pixel; `focal` is a factor on the camera's focal lengths.
///
/// Frame   landmark in the world.
[[nodiscard]] inline KeypointDistance keypoint_distance(const vec3<double>& landmark, const Camera<double>& camera,
                                                        const vec2<double>& pixel, double focal = 1) {
    const vec3<double> x = to_camera(camera, landmark);
    const double z = std::max(x.z, 0.1);
    const double dx = focal * x.x / z * camera.fx + camera.cx - pixel.x;
    const double dy = focal * x.y / z * camera.fy + camera.cy - pixel.y;
    return {std::hypot(dx, dy), std::hypot(dx / camera.fx, dy / camera.fy) * z / focal};
}

} // namespace gsh
