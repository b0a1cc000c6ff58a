// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-fit tells two people apart whom one camera films, and makes one capture of both.
#include "programs/process.hpp"
#include "support/contains.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
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

/// Ann walks to the right, in front of Bob, who walks to the left and leaves. The file names them in changing order, and Bob is missed where Ann hides him.
struct FilmedPair {
    static constexpr std::size_t frame_count = 30, gone = 22; // from then on, Bob is out of the picture
    static constexpr int width = 240, height = 180;

    test::Temporary folder;
    fs::path detections = folder / "pair", body_file = folder / "body.npz";
    BodyModel body = make_actor({.edge_scale = 1.5});
    std::vector<Motion> people{walk(-1, 0.35), walk(1, -0.35)};
    Camera<double> camera = look_at<double>({0, 0.3, 4.2}, {0, -0.1, 0}, {0, 1, 0}, 0.6, width, height);

    static Motion walk(double from, double z) {
        Motion motion = actor_motion(ActorMotion::stride, frame_count);
        for (std::size_t t = 0; t < frame_count; ++t) {
            motion.transl[t] += vec3<double>(from * (1 - 0.08 * static_cast<double>(t)), 0, z);
            motion.pose[55 * t] = vec3<double>(0, -0.5 * std::numbers::pi * from, 0);
        }
        return motion;
    }
    [[nodiscard]] bool shows(std::size_t person, std::size_t t) const { return person == 0 || t < gone; }

    FilmedPair() {
        save_body_model(body_file, body);
        fs::create_directories(detections / "masks/front");
        fs::create_directories(detections / "images/front");
        const std::vector<MotionLandmarks> places{{body, people[0], landmarks_of(body)},
                                                  {body, people[1], landmarks_of(body)}};
        cpu::Serial backend;
        Json images = Json::array(), annotations = Json::array(), times = Json::array();
        for (std::size_t t = 0; t < frame_count; ++t) {
            times.push_back(0.1 * static_cast<double>(t));
            PixelImage mask(1, height, width), photo(3, height, width);
            std::fill(photo.data.begin(), photo.data.end(), std::uint8_t{200});
            for (const std::size_t p : {t % 3 % 2, 1 - t % 3 % 2}) {
                if (!shows(p, t)) continue;
                const PosedBody posed = pose_body(body, people[p].pose_at(t), people[p].transl[t], people[p].betas);
                const auto image =
                    rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), body.faces, camera);
                for (std::size_t i = 0; i < mask.data.size(); ++i) {
                    if (!image.covers(i)) continue;
                    mask.data[i] = 255;
                    for (std::size_t c = 0; c < 3; ++c)
                        photo.data[3 * i + c] = static_cast<std::uint8_t>(60 + 40 * c + 50 * p);
                }
                const double apart = people[0].transl[t].x - people[1].transl[t].x;
                if (p == 1 && std::abs(apart) < 0.3) continue; // hidden
                const auto numbers = [&](const auto& landmarks, bool mirrored) {
                    Json list = Json::array();
                    for (const int landmark : landmarks) {
                        const vec2<double> pixel = to_pixel(
                            camera,
                            to_camera(camera, places[p].at(t, mirrored ? mirrored_landmark(landmark) : landmark)));
                        for (const double number : {pixel.x, pixel.y, 0.9}) list.push_back(number);
                    }
                    return list;
                };
                const auto at = [&](int landmark) { return places[p].at(t, landmark); };
                const vec3<double> hips = (at(landmark_number("left_hip")) + at(landmark_number("right_hip"))) * 0.5;
                Json world = Json::array();
                for (const int landmark : mediapipe_pose_landmarks) {
                    const vec3<double> guess = camera.R * (at(landmark) - hips);
                    for (int k = 0; k < 3; ++k) world.push_back(guess[k]);
                }
                annotations.push_back({{"image_id", t},
                                       {"mediapipe_pose", numbers(mediapipe_pose_landmarks, false)},
                                       {"mediapipe_left_hand", numbers(left_hand_landmarks, false)},
                                       {"mediapipe_right_hand", numbers(left_hand_landmarks, true)},
                                       {"mediapipe_world", world}});
            }
            char name[16];
            std::snprintf(name, sizeof name, "%04zu.png", t);
            images.push_back(
                {{"id", t}, {"file_name", std::string("front/") + name}, {"width", width}, {"height", height}});
            write_png(detections / "masks/front" / name, mask);
            write_png(detections / "images/front" / name, photo);
        }
        write_file(detections / "keypoints.json", Json{{"images", images}, {"annotations", annotations}}.dump());
        const Json front{
            {"name", "front"}, {"width", width}, {"height", height}, {"times", times}, {"focal", camera.fx}};
        write_file(detections / "video.json", Json{{"cameras", {front}}}.dump());
    }
    [[nodiscard]] std::vector<std::string> fit(const std::vector<std::string>& more = {}) const {
        std::vector<std::string> words{"gsh-fit", detections.string(), "--body", body_file.string(), "--betas", "4"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
};

FilmedPair& filmed_pair() {
    static FilmedPair instance;
    return instance;
}

} // namespace

TEST_CASE("two people who cross become a capture of two, in one world, with names from left to right") {
    FilmedPair& pair = filmed_pair();
    constexpr std::size_t frame_count = FilmedPair::frame_count, gone = FilmedPair::gone;
    const auto outcome =
        run(pair.fit({"--people", "ann,bob", "--height", "1.7,1.7", "--to", pair.folder / "walk.bvh"}));
    check_done(outcome);
    CAPTURE(outcome.out);
    CHECK(!fs::exists(pair.detections / "poses.npz"));
    CHECK(outcome.out == test::contains("--poses ann.npz,bob.npz"));
    CHECK(outcome.out == test::contains("bob: out of view in frames 22"));
    for (const char* file : {"walk_ann.bvh", "walk_bob.bvh"}) CHECK(fs::file_size(pair.folder / file) > 1000);
    CHECK(!fs::exists(pair.folder / "walk.bvh"));

    const Motion ann = load_motion(pair.detections / "ann.npz", pair.body),
                 bob = load_motion(pair.detections / "bob.npz", pair.body);
    REQUIRE(ann.frame_count() == frame_count);
    REQUIRE(bob.frame_count() == frame_count);
    // Each walks its way, Bob behind Ann. The world's x is the image's.
    const auto way = [](const Motion& motion, std::size_t from, std::size_t to) {
        return motion.transl[to].x - motion.transl[from].x;
    };
    CHECK(way(ann, 2, 27) == doctest::Approx(2.0).epsilon(0.1));
    CHECK(way(bob, 2, 20) == doctest::Approx(-1.44).epsilon(0.1));
    for (std::size_t t = 2; t < gone; ++t) {
        CAPTURE(t);
        CHECK(std::abs(ann.transl[t].z - bob.transl[t].z - 0.7) < 0.3);
        CHECK(std::abs(ann.transl[t].y - bob.transl[t].y) < 0.12); // on one floor
    }
    for (std::size_t t = gone; t < frame_count; ++t) CHECK(bob.transl[t] == vec3<double>(0, -100, 0));
    const CameraList list = read_cameras(pair.detections / "cameras.json");
    CHECK(list.floor_y == 0.0);

    const Json report = Json::parse(read_file(pair.detections / "fit.json"));
    REQUIRE(report["people"].size() == 2);
    CHECK(report["people"][0]["name"] == "ann");
    CHECK(report["people"][1]["poses"] == "bob.npz");
    CHECK(report["people"][0]["fit"]["frames_out_of_view"].empty());
    CHECK(report["people"][1]["fit"]["frames_out_of_view"].size() == frame_count - gone);
    for (const Json& person : report["people"])
        CHECK(person["fit"]["height_m"].get<double>() == doctest::Approx(1.7).epsilon(0.03));

    // The masks of both stay as they were.
    for (const char* name : {"0003.png", "0012.png", "0020.png", "0026.png"}) {
        const PixelImage before = read_image(pair.detections / "masks_detected/front" / name),
                         after = read_image(pair.detections / "masks/front" / name);
        std::size_t shown = 0, changed = 0;
        for (std::size_t i = 0; i < before.data.size(); ++i)
            shown += before.data[i] > 127, changed += before.data[i] != after.data[i];
        CAPTURE(name);
        CHECK(static_cast<double>(changed) < 0.03 * static_cast<double>(shown));
    }
    const auto checked = run({"gsh-check", pair.detections.string(), "--body", pair.body_file.string(), "--poses",
                              "ann.npz,bob.npz", "--out", pair.folder / "check"});
    CAPTURE(checked.out);
    CAPTURE(checked.err);
    CHECK(checked.code >= 0);
    CHECK(checked.code <= 1);
    CHECK(checked.out == test::contains("bob"));
}

TEST_CASE("without --people the one who is seen longest is fitted, and a note tells of the other; auto finds both") {
    FilmedPair& pair = filmed_pair();
    const auto outcome = run(pair.fit());
    check_done(outcome);
    CHECK(outcome.out == test::contains("2 people are in view"));
    CHECK(outcome.out == test::contains("--people 2 fits all"));
    const Motion ann = load_motion(pair.detections / "poses.npz", pair.body);
    CHECK(ann.transl[27].x - ann.transl[2].x > 1.5);
    fs::remove(pair.detections / "poses.npz");
    check_done(run(pair.fit({"--people", "auto"})));
    CHECK(fs::exists(pair.detections / "person1.npz"));
    CHECK(fs::exists(pair.detections / "person2.npz"));
    CHECK(!fs::exists(pair.detections / "person3.npz"));
}

TEST_CASE("people who cannot be fitted are refused in one line with code 2") {
    const FilmedPair pair;
    const auto refused = [&](const std::vector<std::string>& more, const char* expected) {
        check_refused(run(pair.fit(more)), "gsh-fit", {expected});
        CHECK(!fs::exists(pair.detections / "fit.json"));
    };
    refused({"--people", "0"}, "--people: is 0, expected 1 to 100");
    refused({"--people", "3"}, "--people: asks for 3 people, and 2 were found");
    refused({"--people", "ann,ann"}, "--people: has the name ann twice");
    refused({"--people", "ann,../bob"}, "expected names of files");
    refused({"--people", "ann,"}, "expected names of files");
    refused({"--people", "2", "--height", "1.7"}, "--height: has 1 heights for 2 people");
}
