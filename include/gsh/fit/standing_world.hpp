// SPDX-License-Identifier: Apache-2.0
/// @file  A world in which a fitted person stands upright on a floor.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh {

/// The change from the world of a single camera to one with y up, in which people stand on average: up is the mean of
/// their axes, the lowest heels and toes touch y = 0 (but for the lowest 2%, which are errors), and the camera looks
/// along -z from above the z axis. A person who lies down throughout keeps the camera's own up.
///
/// Frame   in the old world the camera is at the origin and looks along z, y down.
[[nodiscard]] inline Affine<double> standing_world(const BodyModel& body, const std::vector<Motion>& people) {
    vec3<double> up(0);
    for (const Motion& motion : people)
        for (std::size_t t = 0; t < motion.frame_count(); ++t) up += rotation_from_axis_angle(motion.pose_at(t)[0])[1];
    const vec3<double> camera_up(0, -1, 0);
    up = length(up) > 1e-9 ? normalize(up) : camera_up;
    if (dot(up, camera_up) < 0.5) up = camera_up; // more than 60 degrees: nobody films standing people so
    const vec3<double> forward = vec3<double>(0, 0, 1) - up * up.z;
    const vec3<double> z = normalize(forward) * -1.0, x = cross(up, z);
    const mat3<double> A = transpose(mat3<double>(x, up, z));

    std::vector<double> lowest;
    double depth = 0, across = 0, count = 0;
    const Landmarks marks = landmarks_of(body);
    for (const Motion& motion : people) {
        const MotionLandmarks places(body, motion, marks);
        for (std::size_t t = 0; t < motion.frame_count(); ++t) {
            double low = std::numeric_limits<double>::infinity();
            for (const char* name : {"left_heel", "right_heel", "left_foot", "right_foot"})
                if (const int foot = landmark_number(name); places.has(foot))
                    low = std::min(low, (A * places.at(t, foot)).y);
            if (std::isfinite(low)) lowest.push_back(low);
            const vec3<double> place = A * motion.transl[t];
            across += place.x, depth += place.z, count += 1;
        }
    }
    double floor = 0;
    if (!lowest.empty()) {
        const auto rank = lowest.begin() + static_cast<std::ptrdiff_t>(lowest.size() / 50);
        std::nth_element(lowest.begin(), rank, lowest.end());
        floor = *rank;
    }
    if (count == 0) return {A, vec3<double>(0)};
    return {A, vec3<double>(-across / count, -floor, -depth / count)};
}

/// The camera in the new world.
[[nodiscard]] inline Camera<double> moved_camera(Camera<double> camera, const Affine<double>& new_from_old) {
    camera.R = camera.R * transpose(new_from_old.linear);
    camera.t -= camera.R * new_from_old.translation;
    return camera;
}

} // namespace gsh
