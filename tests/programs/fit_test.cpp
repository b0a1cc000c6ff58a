// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-fit makes a detector's folder a capture that gsh-check accepts, and refuses what it cannot read.
#include "programs/process.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/bvh_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <numbers>
#include <string>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

/// The actor turns once before one camera; what a faultless MediaPipe would write of it, without faces.
struct FilmedTurn {
    test::Temporary folder;
    fs::path detections = folder / "turn", body_file = folder / "body.npz";
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion motion = actor_motion(ActorMotion::talk, 12);
    Camera<double> camera = look_at<double>({0, 0.3, 3}, {0, -0.1, 0}, {0, 1, 0}, 0.75, 120, 160);

    FilmedTurn() {
        const std::vector<vec3<double>> pose(motion.pose.begin(), motion.pose.begin() + 55);
        for (std::size_t t = 0; t < 12; ++t) {
            std::copy(pose.begin(), pose.end(), motion.pose.begin() + static_cast<std::ptrdiff_t>(55 * t));
            motion.pose[55 * t] = vec3<double>(0, 2 * std::numbers::pi * static_cast<double>(t) / 12, 0);
            motion.transl[t] = motion.transl[0];
        }
        save_body_model(body_file, body);
        fs::create_directories(detections / "masks/front");
        const MotionLandmarks places(body, motion, landmarks_of(body));
        cpu::Serial backend;
        Json images = Json::array(), annotations = Json::array(), times = Json::array();
        for (std::size_t t = 0; t < 12; ++t) {
            char name[16];
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
            fs::create_directories(detections / "images/front");
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

FilmedTurn& filmed() {
    static FilmedTurn instance;
    return instance;
}

} // namespace

TEST_CASE("a turn becomes a capture in an upright world, with a report; gsh-check reads it") {
    FilmedTurn& turn = filmed();
    const auto outcome = run(turn.fit({"--height", "1.7", "--test-every", "5", "--to", turn.folder / "turn.bvh"}));
    check_done(outcome);
    CHECK(outcome.out.find("nobody was found in frames 5") != std::string::npos);
    CHECK(outcome.out.find("next: gsh-check ") != std::string::npos);
    const Motion found = load_motion(turn.detections / "poses.npz", turn.body);
    REQUIRE(found.frame_count() == 12);
    CHECK(joint_errors(turn.body, found, turn.motion, RootAlignment::rotation).mean_mm < 25);
    const CameraList list = read_cameras(turn.detections / "cameras.json");
    REQUIRE(list.cameras.size() == 1);
    CHECK(list.cameras[0].camera.fx == doctest::Approx(turn.camera.fx)); // it was known
    CHECK(list.fps == doctest::Approx(10));
    CHECK(list.floor_y == 0.0);
    CHECK(list.test_frames == std::vector<int>{2, 7});
    CHECK(std::abs(list.cameras[0].camera.R[1].y + 1) < 0.1); // y is up, and the camera level
    for (std::size_t t = 0; t < 12; ++t) CHECK(rotation_from_axis_angle(found.pose_at(t)[0])[1].y > 0.98);
    const Json report = Json::parse(read_file(turn.detections / "fit.json"));
    CHECK(report["frames_without_person"] == Json{5});
    CHECK(report["frame_median_mm"][5].is_null());
    CHECK(report["turn_degrees"].get<double>() > 300);
    CHECK(report["pose_held"] == true);
    CHECK(report["height_m"].get<double>() == doctest::Approx(1.7).epsilon(0.02));
    CHECK(fs::file_size(turn.folder / "turn.bvh") > 1000);

    const auto checked = run({"gsh-check", turn.detections.string(), "--body", turn.body_file.string(),
                              "--out", turn.folder / "check"});
    CAPTURE(checked.out);
    CHECK(checked.code >= 0);
    CHECK(checked.out.find("0.9") != std::string::npos); // masks and bodies overlap

    // Once more: the result does not depend on what it wrote.
    const std::string before = read_file(turn.detections / "poses.npz");
    check_done(run(turn.fit({"--height", "1.7", "--test-every", "5"})));
    CHECK(read_file(turn.detections / "poses.npz") == before);
}

TEST_CASE("every refusal is one line and code 2, and writes nothing") {
    const FilmedTurn turn;
    const auto refused = [&](const std::vector<std::string>& words, const char* expected) {
        check_refused(run(words), "gsh-fit", {expected});
        CHECK(!fs::exists(turn.detections / "poses.npz"));
    };
    refused({"gsh-fit", turn.folder / "none", "--body", turn.body_file.string(), "--to", turn.folder / "a.bvh"},
            "none: does not exist");
    refused({"gsh-fit", turn.detections / "images/front", "--body", turn.body_file.string()}, "--out: is required");
    refused(turn.fit({"--fps", "5"}), "--fps: is for videos");
    refused(turn.fit({"--height", "17"}), "--height");
    refused(turn.fit({"--turn", "maybe"}), "--turn");
    refused(turn.fit({"--to", turn.folder / "a.fbx"}), "--to ");
    fs::remove(turn.detections / "masks/front/0003.png");
    refused(turn.fit(), "has 11 masks, expected 12");
    fs::remove_all(turn.detections / "masks");
    write_file(turn.detections / "keypoints.json", R"({"images": [], "annotations": []})");
    refused(turn.fit(), "nobody was found in any photograph");
}
