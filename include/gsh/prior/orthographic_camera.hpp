// SPDX-License-Identifier: Apache-2.0
/// @file  The orthographic camera of prior views, and cameras that frame a body from the front, back, left or right.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/box.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>

namespace gsh {

/// Parallel projection, x_cam = R x_world + t, pixel = scale (x, y)_cam + (cx, cy); a point's depth is its camera z.
///
/// Frame   camera x right, y down, z forward, as for Camera; the first pixel's centre is (0.5, 0.5).
/// Units   metres; scale in pixels per metre.
struct OrthographicCamera {
    mat3<double> R = mat3<double>(1.0);
    vec3<double> t = vec3<double>(0);
    double scale = 1, cx = 0, cy = 0;
    int width = 0, height = 0;
};

/// Transforms a world point to camera coordinates.
[[nodiscard]] inline vec3<double> to_camera(const OrthographicCamera& camera, const vec3<double>& point) {
    return camera.R * point + camera.t;
}

/// Projects a camera-space point to pixel coordinates.
[[nodiscard]] inline vec2<double> to_pixel(const OrthographicCamera& camera, const vec3<double>& p) {
    return {camera.scale * p.x + camera.cx, camera.scale * p.y + camera.cy};
}

/// Throws ValueError unless every number is finite, R is a rotation, scale is positive and the image has a size.
inline void check_camera(std::string_view where, std::string_view name, const OrthographicCamera& camera) {
    const auto require = [&](bool condition, const std::string& what) {
        check_value(condition, where, std::string(name) + ' ' + what);
    };
    for (const double x : {camera.scale, camera.cx, camera.cy, camera.t.x, camera.t.y, camera.t.z})
        require(std::isfinite(x), "holds a NaN or an infinity, expected finite numbers");
    require(camera.scale > 0, "has scale " + detail::number_text(camera.scale) + ", expected pixels per metre above 0");
    require(camera.width > 0 && camera.height > 0, "has an image of " + std::to_string(camera.width) + " x " +
                                                       std::to_string(camera.height) +
                                                       " pixels, expected at least 1 x 1");
    bool orthonormal = determinant(camera.R) > 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            orthonormal = orthonormal && std::abs(dot(camera.R[i], camera.R[j]) - (i == j)) < 1e-3;
    require(orthonormal, "has an R that is not a rotation (orthonormal, determinant +1); x_cam = R x_world + t");
}

/// The position of a camera around a body that faces +z, its left at +x: on +z, -z, +x or -x.
enum class BodySide { front, back, left, right };

struct SideViewParams {
    int resolution = 512;  ///< pixels along each side of the square image
    double margin = 0.05;  ///< fraction of the image left free at each border, along the longest direction
};

/// The camera that frames a body from one side, y up in the image.
///
/// All four sides share one frame: a cube centred at the bounding box. The longest edge of the box leaves `margin` free
/// at either end. Each camera lies on a face of the cube, so depths are positive. The depth of the cube's centre is
/// half its edge length.
///
/// Errors  ValueError for no vertices, no extent, or params out of range.
[[nodiscard]] inline OrthographicCamera side_camera(Span<const vec3<double>> vertices, BodySide side,
                                                    const SideViewParams& params = {}) {
    constexpr std::string_view where = "side_camera";
    check_value(!vertices.empty(), where, "there are no vertices to look at");
    check_value(params.resolution > 0, where,
                "resolution is " + std::to_string(params.resolution) + ", expected at least 1 pixel");
    check_value(params.margin >= 0 && params.margin < 0.5, where,
                "margin is " + detail::number_text(params.margin) + ", expected a share in [0, 0.5)");
    check_finite<double>(where, "vertices", {&vertices[0].x, 3 * vertices.size()});
    const auto [low, high] = box_of_points(vertices);
    const vec3<double> center = (low + high) * 0.5, extent = high - low;
    const double edge = std::max({extent.x, extent.y, extent.z}) / (1 - 2 * params.margin);
    check_value(edge > 0, where, "all vertices lie at one point");

    vec3<double> forward(0);
    switch (side) {
    case BodySide::front: forward.z = -1; break;
    case BodySide::back: forward.z = 1; break;
    case BodySide::left: forward.x = -1; break;
    case BodySide::right: forward.x = 1; break;
    }
    const vec3<double> down(0, -1, 0);
    OrthographicCamera camera;
    camera.R = transpose(mat3<double>(cross(down, forward), down, forward));
    camera.t = vec3<double>(0, 0, edge / 2) - camera.R * center;
    camera.scale = params.resolution / edge;
    camera.cx = camera.cy = params.resolution / 2.0;
    camera.width = camera.height = params.resolution;
    return camera;
}

} // namespace gsh
