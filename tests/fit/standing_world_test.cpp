// SPDX-License-Identifier: Apache-2.0
#include <gsh/fit/standing_world.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/body/joint_error.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("a person seen by a tilted camera stands on the floor of the new world, and looks the same to the camera") {
    const BodyModel& body = test::fitted_actor();
    Motion motion = actor_motion(ActorMotion::talk, 10);
    const Camera<double> filmed = look_at<double>({0.5, 1.9, 3}, {0, 0.8, 0}, {0.1, 1, 0}, 0.8, 400, 400);
    const Affine<double> camera_from_world{filmed.R, filmed.t};
    double ankle = 1e9; // the lowest
    for (const auto& joint : motion_joints(body, motion)) ankle = std::min(ankle, joint.y);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) move_frame(body, motion, t, camera_from_world);
    Camera<double> camera = filmed; // at the origin of its own world
    camera.R = mat3<double>(1.0), camera.t = vec3<double>(0);
    const auto before = motion_joints(body, motion);

    const Affine<double> standing = standing_world(body, {motion});
    Motion moved = motion;
    for (std::size_t t = 0; t < motion.frame_count(); ++t) move_frame(body, moved, t, standing);
    const Camera<double> there = moved_camera(camera, standing);
    const auto after = motion_joints(body, moved);
    for (std::size_t i = 0; i < before.size(); ++i)
        CHECK(length(to_camera(there, after[i]) - to_camera(camera, before[i])) < 1e-9);
    double up = 0, feet = 0;
    for (std::size_t t = 0; t < moved.frame_count(); ++t) {
        up += rotation_from_axis_angle(moved.pose_at(t)[0])[1].y / 10;
        feet += after[55 * t + 7].y / 10;
    }
    CHECK(up > 0.99);
    CHECK((feet > 0.02 && feet < 0.15));                     // ankles above the floor
    CHECK(there.center().z > 2);                             // the camera is in front
    CHECK(std::abs(there.center().y - (1.9 - ankle)) < 0.1); // as high above the feet as it was

    // Lying people leave the camera's up alone.
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        motion.pose[55 * t] = axis_angle_from_rotation(rotation_from_axis_angle(vec3<double>(0, 0, 1.5)));
    CHECK(length(standing_world(body, {motion}).linear * vec3<double>(0, -1, 0) - vec3<double>(0, 1, 0)) < 1e-9);
}
