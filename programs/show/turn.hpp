// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars from all around, in one of their poses, as a strip of pictures.
#pragma once

#include "show/framing.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"

#include <gsh/body/moved_motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace gsh::programs {

/// Cameras around the people in a frame, evenly, at one distance; the first one is in front of the first person. Up is
/// the coordinate axis that the first person stands along, or else +y.
[[nodiscard]] inline std::vector<Camera<double>> cameras_around(const ShownPeople& people, std::size_t frame, int count,
                                                                int width, int height) {
    std::vector<vec3<double>> points;
    for (std::size_t p = 0; p < people.data.size(); ++p) {
        const Motion& motion = people.motions[p];
        const auto body = pose_body(people.data[p].rig.body, motion.pose_at(frame), motion.transl[frame], motion.betas,
                                    motion.expression_at(frame));
        points.insert(points.end(), body.vertices.begin(), body.vertices.end());
    }
    const Motion& first = people.motions[0];
    const mat3<double> upright = upright_rotation(first).value_or(mat3<double>(1.0));
    const vec3<double> up = transpose(upright)[1];
    vec3<double> front = rotation_from_axis_angle(first.pose_at(frame)[0])[2];
    front -= up * dot(front, up);
    if (length(front) < 0.1) front = transpose(upright)[2]; // the person lies
    front = normalize(front);
    const vec3<double> side = cross(up, front);
    std::vector<Camera<double>> cameras;
    double farthest = 0;
    for (int k = 0; k < count; ++k) {
        const double angle = 2 * std::numbers::pi * k / count;
        const vec3<double> eye = front * std::cos(angle) + side * std::sin(angle) + up * 0.1;
        constexpr double field_of_view = 30 * std::numbers::pi / 180;
        Framing framing(look_at<double>(eye, vec3<double>(0), up, field_of_view, width, height));
        framing.add(points);
        cameras.push_back(framing.camera());
        farthest = std::max(farthest, cameras.back().t.z);
    }
    for (Camera<double>& camera : cameras) camera.t.z = farthest;
    return cameras;
}

/// What these cameras see, side by side, on white.
[[nodiscard]] inline Image<float> turn_picture(Renderer& renderer, std::size_t frame,
                                               const std::vector<Camera<double>>& cameras) {
    const int width = cameras.front().width, height = cameras.front().height;
    Image<float> strip(3, height, width * static_cast<int>(cameras.size()));
    for (std::size_t k = 0; k < cameras.size(); ++k) {
        const Image<float> picture = renderer.render(frame, cameras[k], {1, 1, 1});
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < height; ++y)
                std::copy_n(picture.view().row(c, y), width,
                            strip.view().row(c, y) + static_cast<std::ptrdiff_t>(k) * width);
    }
    return strip;
}

} // namespace gsh::programs
