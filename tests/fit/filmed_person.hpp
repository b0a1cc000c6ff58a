// SPDX-License-Identifier: Apache-2.0
/// @file  A body in motion, as a faultless detector would see it.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/fit/fit_motion.hpp>
#include <gsh/image/image.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

namespace gsh::test {

/// The built-in actor, made once; a coarse mesh.
inline const BodyModel& fitted_actor() {
    static const BodyModel actor = make_actor({.edge_scale = 1.5});
    return actor;
}

/// Cameras around the actor, at the height of the chest.
inline std::vector<Camera<double>> cameras_around(std::size_t count, double distance = 3.2) {
    std::vector<Camera<double>> cameras;
    for (std::size_t c = 0; c < count; ++c) {
        const double angle = 0.3 + 2 * std::numbers::pi * static_cast<double>(c) / static_cast<double>(count);
        cameras.push_back(look_at<double>(
            {distance * std::sin(angle), 1.1 + 0.2 * static_cast<double>(c % 2), distance * std::cos(angle)},
            {0, 0.85, 0}, {0, 1, 0}, 0.75, 480, 640));
    }
    return cameras;
}

/// What a detector finds of a motion: landmarks in their places, off by a normal error of `noise` metres, and guesses
/// in metres that are off by 5 cm.
inline std::vector<PersonPhoto> seen(const BodyModel& body, const Motion& motion,
                                     const std::vector<Camera<double>>& cameras, double noise = 0,
                                     std::uint64_t seed = 1) {
    const Landmarks marks = landmarks_of(body);
    const MotionLandmarks places(body, motion, marks);
    Rng rng(seed);
    std::vector<PersonPhoto> photos;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        for (std::size_t t = 0; t < motion.frame_count(); ++t) {
            PersonPhoto photo{c, t, {}, {}};
            const auto middle = [&](const char* a, const char* b) {
                return (places.at(t, landmark_number(a)) + places.at(t, landmark_number(b))) * 0.5;
            };
            const vec3<double> hips = middle("left_hip", "right_hip");
            for (int l = 0; l < static_cast<int>(marks.size()); ++l) {
                if (l % 2 == 1 && mirrored_landmark(l) == l) continue; // the middle has one number
                const vec3<double> x = to_camera(cameras[c], places.at(t, l));
                const vec2<double> off{noise * rng.normal(), noise * rng.normal()};
                photo.person.points.push_back({l, to_pixel(cameras[c], x) + off * (cameras[c].fx / x.z), 0.9});
                if (l < 2 * 18)
                    photo.person.metric.push_back({l, cameras[c].R * (places.at(t, l) - hips) + rng.vec(-0.05, 0.05)});
            }
            photos.push_back(std::move(photo));
        }
    return photos;
}

/// The silhouettes of a motion in photographs, 255 where the body is; `photos` tell cameras and frames.
inline std::vector<Image<std::uint8_t>> masks_of(const BodyModel& body, const Motion& motion,
                                                 const std::vector<Camera<double>>& cameras,
                                                 const std::vector<PersonPhoto>& photos) {
    cpu::Serial backend;
    std::vector<Image<std::uint8_t>> masks;
    for (const PersonPhoto& photo : photos) {
        const PosedBody posed = pose_body(body, motion.pose_at(photo.frame), motion.transl[photo.frame], motion.betas);
        masks.push_back(
            rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), body.faces, cameras[photo.camera])
                .mask());
        for (std::uint8_t& pixel : masks.back().data) pixel = static_cast<std::uint8_t>(255 * pixel);
    }
    return masks;
}

} // namespace gsh::test
