// SPDX-License-Identifier: Apache-2.0
/// @file  A detector's folder of a turn of the actor, for the programs that fit a body.
#pragma once

#include "io/temporary.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_turn.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::test {

/// The actor turns once before one camera; what a faultless MediaPipe would write of it, without faces. It finds nobody
/// in frame 5.
struct FilmedTurn {
    using Json = nlohmann::ordered_json;

    Temporary folder;
    std::filesystem::path detections = folder / "turn", body_file = folder / "body.npz";
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion motion;
    Camera<double> camera = look_at<double>({0, 0.3, 3}, {0, -0.1, 0}, {0, 1, 0}, 0.75, 120, 160);

    explicit FilmedTurn(int frames = 12) : motion(actor_turn(frames)) {
        save_body_model(body_file, body);
        std::filesystem::create_directories(detections / "masks/front");
        const MotionLandmarks places(body, motion, landmarks_of(body));
        cpu::Serial backend;
        Json images = Json::array(), annotations = Json::array(), times = Json::array();
        for (std::size_t t = 0; t < motion.frame_count(); ++t) {
            char name[32];
            std::snprintf(name, sizeof name, "%04zu.png", t);
            images.push_back({{"id", t}, {"file_name", std::string("front/") + name}, {"width", 120}, {"height", 160}});
            times.push_back(0.1 * static_cast<double>(t));
            const auto numbers = [&](const auto& landmarks, bool mirrored) {
                Json list = Json::array();
                for (const int landmark : landmarks) {
                    const vec3<double> x =
                        to_camera(camera, places.at(t, mirrored ? mirrored_landmark(landmark) : landmark));
                    const vec2<double> pixel = to_pixel(camera, x);
                    for (const double number : {pixel.x, pixel.y, 0.9}) list.push_back(number);
                }
                return list;
            };
            const vec3<double> hips =
                (places.at(t, landmark_number("left_hip")) + places.at(t, landmark_number("right_hip"))) * 0.5;
            Json world = Json::array();
            for (const int landmark : mediapipe_pose_landmarks) {
                const vec3<double> guess = camera.R * (places.at(t, landmark) - hips);
                for (int k = 0; k < 3; ++k) world.push_back(guess[k]);
            }
            if (t != 5) // nobody was found
                annotations.push_back({{"image_id", t},
                                       {"mediapipe_pose", numbers(mediapipe_pose_landmarks, false)},
                                       {"mediapipe_left_hand", numbers(left_hand_landmarks, false)},
                                       {"mediapipe_right_hand", numbers(left_hand_landmarks, true)},
                                       {"mediapipe_world", world}});
            const PosedBody posed = pose_body(body, motion.pose_at(t), motion.transl[t], motion.betas);
            const auto image = rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), body.faces, camera);
            PixelImage mask(1, 160, 120);
            for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = image.covers(i) && t != 5 ? 255 : 0;
            write_png(detections / "masks/front" / name, mask);
            PixelImage photo(3, 160, 120);
            for (std::size_t i = 0; i < mask.data.size(); ++i)
                for (std::size_t c = 0; c < 3; ++c)
                    photo.data[3 * i + c] = static_cast<std::uint8_t>(image.covers(i) ? 90 + 40 * c : 200);
            std::filesystem::create_directories(detections / "images/front");
            write_png(detections / "images/front" / name, photo);
        }
        write_file(detections / "keypoints.json", Json{{"images", images}, {"annotations", annotations}}.dump());
        const Json front{{"name", "front"}, {"width", 120}, {"height", 160}, {"times", times}, {"focal", camera.fx}};
        write_file(detections / "video.json", Json{{"cameras", {front}}}.dump());
    }
    [[nodiscard]] std::vector<std::string> fit(std::vector<std::string> more = {}) const {
        std::vector<std::string> words{"gsh-fit", detections.string(), "--body", body_file.string()};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
};

} // namespace gsh::test
