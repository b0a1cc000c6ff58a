// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/keypoints_file.hpp>

#include "io/sample_files.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using detail::Json;

namespace {

std::vector<NamedCamera> cameras_called(const std::vector<std::string>& names) {
    std::vector<NamedCamera> cameras(names.size());
    for (std::size_t c = 0; c < names.size(); ++c) cameras[c].name = names[c];
    return cameras;
}

/// Points (10 k, 10 k + 1) with confidence 0.5, `count` of them.
Json points(std::size_t count) {
    Json list = Json::array();
    for (std::size_t k = 0; k < count; ++k)
        for (const double number : {10.0 * static_cast<double>(k), 10.0 * static_cast<double>(k) + 1, 0.5})
            list.push_back(number);
    return list;
}

/// The message of the error that `f` throws.
std::string message_of(const std::function<void()>& f) {
    try {
        f();
    } catch (const IoError& error) {
        return error.what();
    }
    return "none";
}

const Keypoint* find(const std::vector<Keypoint>& points, const char* landmark) {
    for (const Keypoint& point : points)
        if (point.landmark == landmark_number(landmark)) return &point;
    return nullptr;
}

struct OpenPose {
    test::Temporary folder;
    std::vector<NamedCamera> cameras = cameras_called({"left", "right"});
    Json person{{"pose_keypoints_2d", points(25)},
                {"hand_left_keypoints_2d", points(21)},
                {"hand_right_keypoints_2d", Json::array()}};

    OpenPose() {
        std::filesystem::create_directories(folder / "left");
        write("left/000007_keypoints.json", {{"version", 1.3}, {"people", {person, person}}});
        write("right_3_keypoints.json", {{"people", {person}}});
        write("right_4.json", {{"people", Json::array()}});
    }
    void write(const char* name, const Json& json) const { test::write_text(folder / name, json.dump()); }
    [[nodiscard]] std::vector<PhotoKeypoints> load() const { return load_keypoints(folder / "", cameras, 10); }
    [[nodiscard]] std::string refused() const {
        return message_of([&] { (void)load(); });
    }
};

} // namespace

TEST_CASE("OpenPose's files are read: camera and frame from the names, landmarks by their numbers") {
    const OpenPose files;
    const std::vector<PhotoKeypoints> found = files.load();
    REQUIRE(found.size() == 2); // right 4 has no people
    CHECK((found[0].camera == 0 && found[0].frame == 7));
    CHECK((found[1].camera == 1 && found[1].frame == 3));
    REQUIRE(found[0].people.size() == 2);
    REQUIRE(found[1].people.size() == 1);
    const std::vector<Keypoint>& points = found[0].people[1].points;
    CHECK(points.size() == 25 + 21); // a body and a hand
    REQUIRE((find(points, "right_elbow") && find(points, "left_ankle") && find(points, "left_pinky2")));
    CHECK(find(points, "right_elbow")->pixel == vec2<double>(30, 31));
    CHECK(find(points, "left_ankle")->pixel == vec2<double>(140, 141));
    CHECK(find(points, "left_thumb1")->pixel == vec2<double>(10, 11));
    CHECK(find(points, "left_pinky_tip")->pixel == vec2<double>(200, 201));
    CHECK(find(points, "right_heel")->pixel == vec2<double>(240, 241));
    CHECK(find(points, "left_pinky2")->pixel == vec2<double>(180, 181));
    CHECK(find(points, "left_pinky2")->confidence == 0.5);
    CHECK(find(points, "right_index1") == nullptr);
}

TEST_CASE("a single camera needs no name in the files") {
    test::Temporary folder;
    const std::string people = Json{{"people", {{{"pose_keypoints_2d", points(25)}}}}}.dump();
    const auto frame_of = [&](const char* name) {
        test::write_text(folder / name, people);
        const auto found = load_keypoints(folder / "", cameras_called({"cam"}), 5);
        std::filesystem::remove(folder / name);
        REQUIRE(found.size() == 1);
        return found[0].frame;
    };
    CHECK(frame_of("video_002_keypoints.json") == 2);
    CHECK(frame_of("video_000000000002_keypoints.json") == 2); // OpenPose 1.7 of a video: twelve digits
    CHECK(frame_of("video_000000000000_keypoints.json") == 0);
    CHECK(frame_of("frame-3.json") == 3);
    CHECK(frame_of("0004.jpg.predictions.json") == 4); // OpenPifPaf 0.13
    CHECK(frame_of("0001.png.json") == 1);
    CHECK(frame_of("cam.01.json") == 1);
    test::write_text(folder / "video_9999999999_keypoints.json", people);
    CHECK(message_of([&] { (void)load_keypoints(folder / "", cameras_called({"cam"}), 5); }) ==
          test::contains("is of frame 9999999999, expected one below 5"));
}

TEST_CASE("files with the names of photographs belong to these, whatever their numbers") {
    test::Temporary folder;
    std::vector<std::string> images; // of two cameras, three frames each
    for (const char* camera : {"left", "right"}) {
        std::filesystem::create_directories(folder / camera);
        for (const char* number : {"00001", "00010", "00020"}) images.push_back("frame_" + std::string(number));
    }
    const auto write = [&](const std::string& name) {
        test::write_text(folder / name, Json{{"people", {{{"pose_keypoints_2d", points(25)}}}}}.dump());
    };
    const auto places = [&] {
        std::vector<std::pair<std::size_t, std::size_t>> result;
        for (const auto& photo : load_keypoints(folder / "", cameras_called({"left", "right"}), 3, images))
            result.emplace_back(photo.camera, photo.frame);
        return result;
    };
    using Places = std::vector<std::pair<std::size_t, std::size_t>>;
    write("left/frame_00001_keypoints.json"), write("left/frame_00020_keypoints.json");
    write("right/frame_00010_keypoints.json");
    CHECK(places() == Places{{0, 0}, {0, 2}, {1, 1}});
    // A detector looks at every photograph of a video, of which the capture may hold a few.
    for (const char* camera : {"left", "right"})
        for (const char* number : {"00001", "00002", "00010", "00020"})
            write(std::string(camera) + "/frame_" + number + "_keypoints.json");
    CHECK(places() == Places{{0, 0}, {0, 1}, {0, 2}, {1, 0}, {1, 1}, {1, 2}});
    // Numbers count from 0 where names do not fit: images from 1, keypoints of a video from 0.
    std::filesystem::remove_all(folder / "left"), std::filesystem::remove_all(folder / "right");
    images = {"1", "2", "3", "1", "2", "3"};
    write("left_0_keypoints.json"), write("left_1_keypoints.json"), write("left_2_keypoints.json");
    CHECK(places() == Places{{0, 0}, {0, 1}, {0, 2}});
    write("left_3_keypoints.json");
    CHECK(message_of([&] { (void)places(); }) == test::contains("frame 3, expected one below 3"));
    for (const char* name : {"left_0_keypoints.json", "left_1_keypoints.json", "left_2_keypoints.json"})
        std::filesystem::remove(folder / name);
    CHECK(places() == Places{{0, 2}});
}

TEST_CASE("keypoints that are no pixels of the images are refused") {
    auto cameras = cameras_called({"cam", "other"});
    cameras[0].camera.width = 640, cameras[0].camera.height = 480;
    const auto refused = [&](double scale, double shift) {
        Json body = Json::array();
        for (std::size_t k = 0; k < 25; ++k) {
            const double x = 250 + 100 * std::sin(static_cast<double>(k)), y = 40 + 16 * static_cast<double>(k);
            for (const double number : {x / 640 * scale + shift, y / 480 * scale + shift, 0.8}) body.push_back(number);
        }
        test::Temporary folder;
        for (const char* name : {"cam_0.json", "cam_1.json"})
            test::write_text(folder / name, Json{{"people", {{{"pose_keypoints_2d", body}}}}}.dump());
        try {
            (void)load_keypoints(folder / "", cameras, 5);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    const auto has = [](const std::string& text, const char* words) { return text.find(words) != std::string::npos; };
    CHECK(refused(480, 0).empty());
    CHECK(refused(480, -20).empty());
    CHECK(has(refused(1, 0), "not pixels, but scaled to 0…1"));
    CHECK(has(refused(1, 0), "camera 'cam'"));
    CHECK(has(refused(1, 0), "640 x 480"));
    CHECK(has(refused(1.2, 0), "scaled to 0…1")); // beyond the border
    CHECK(has(refused(2, -1), "scaled to -1…1"));
    CHECK(has(refused(1500, 0), "lie outside"));
    CHECK(has(refused(480, -480), "lie outside"));
}

TEST_CASE("the message about an annotation of no photograph is short, however long its number is") {
    test::Temporary folder;
    const Json json{{"images", {{{"id", 1}, {"file_name", "left/0.png"}}}},
                    {"annotations", {{{"image_id", std::vector<int>(1000, 7)}, {"keypoints", points(17)}}}}};
    test::write_text(folder / "all.json", json.dump());
    const std::string message =
        message_of([&] { (void)load_keypoints(folder / "all.json", cameras_called({"left"}), 10); });
    CHECK(message == test::contains("image_id [7,7,7"));
    CHECK(message.size() < 300);
}

TEST_CASE("a file of COCO-WholeBody is read; visibility counts as confidence, up to 1") {
    test::Temporary folder;
    Json body = points(17);
    body[3 * 7 + 2] = 2; // left elbow
    body[3 * 9 + 2] = 0; // left wrist: not labelled
    const Json json{{"images",
                     {{{"id", 12}, {"file_name", "images/left/0004.png"}},
                      {{"id", "b"}, {"file_name", "right_5.jpg"}}}},
                    {"annotations",
                     {{{"image_id", "b"}, {"keypoints", body}, {"righthand_kpts", points(21)}, {"foot_kpts", points(6)}, {"face_kpts", points(68)}},
                      {{"image_id", 12}, {"keypoints", points(17)}}}}};
    test::write_text(folder / "all.json", json.dump());
    const auto found = load_keypoints(folder / "all.json", cameras_called({"left", "right"}), 10);
    REQUIRE(found.size() == 2);
    CHECK((found[0].camera == 0 && found[0].frame == 4));
    CHECK((found[1].camera == 1 && found[1].frame == 5));
    CHECK(found[0].people[0].points.size() == 17);
    const std::vector<Keypoint>& points = found[1].people[0].points;
    CHECK(points.size() == 16 + 6 + 8 + 21);
    CHECK(find(points, "left_small_toe")->pixel == vec2<double>(10, 11));
    CHECK(find(points, "right_face_mouth")->pixel == vec2<double>(480, 481));
    REQUIRE(find(points, "left_elbow"));
    CHECK(find(points, "left_elbow")->confidence == 1);
    CHECK(find(points, "left_elbow")->pixel == vec2<double>(70, 71));
    CHECK(find(points, "left_wrist") == nullptr);
    CHECK(find(points, "right_thumb3")->pixel == vec2<double>(30, 31));
}

TEST_CASE("points of MediaPipe are read: pose, hands, some of the face, and metres") {
    test::Temporary folder;
    Json person{{"image_id", 1}, {"mediapipe_pose", points(33)}, {"mediapipe_right_hand", points(21)},
                {"mediapipe_face", points(478)}, {"mediapipe_world", points(33)}};
    const auto load = [&] {
        const Json json{{"images", {{{"id", 1}, {"file_name", "cam/0002.png"}}}}, {"annotations", {person}}};
        test::write_text(folder / "all.json", json.dump());
        return load_keypoints(folder / "all.json", cameras_called({"cam"}), 3);
    };
    const auto found = load();
    REQUIRE(found.size() == 1);
    CHECK(found[0].frame == 2);
    const Detection& detection = found[0].people[0];
    CHECK(detection.points.size() == 33 + 21 + 11);
    CHECK(find(detection.points, "left_mouth_corner")->pixel == vec2<double>(90, 91));
    CHECK(find(detection.points, "right_index_tip")->pixel == vec2<double>(80, 81));
    CHECK(find(detection.points, "left_index_tip") == nullptr);
    CHECK(find(detection.points, "left_face_eye_outer")->pixel == vec2<double>(2630, 2631));
    REQUIRE(detection.metric.size() == 33);
    CHECK(detection.metric[13].landmark == landmark_number("left_elbow"));
    CHECK(detection.metric[13].position == vec3<double>(130, 131, 0.5));
    person["mediapipe_world"] = points(32);
    CHECK_THROWS_WITH_AS((void)load(), doctest::Contains("mediapipe_world has 96 elements, expected 99 numbers"), IoError);
    person["mediapipe_world"] = Json::array(); // a detector without guesses
    CHECK(load()[0].people[0].metric.empty());
}

TEST_CASE("damaged keypoints are refused, with file and field") {
    const auto refused = [](const char* name, const Json& json, const char* expected) {
        const OpenPose files;
        files.write(name, json);
        const std::string message = files.refused();
        CAPTURE(message);
        CHECK(message == test::contains(name));
        CHECK(message == test::contains(expected));
    };
    const auto people = [](const Json& list) { return Json{{"people", {{{"pose_keypoints_2d", list}}}}}; };
    Json text = points(25), infinite = points(25), negative = points(25);
    text[4] = "x", negative[5] = -0.1;
    infinite[4] = nullptr;
    refused("left/1.json", people(points(24)), "pose_keypoints_2d has 72 elements, expected 75");
    refused("left/1.json", people(text), "at place 4");
    refused("left/1.json", people(infinite), "at place 4");
    refused("left/1.json", people(negative), "negative confidence");
    refused("left/1.json", Json{{"people", {Json::object()}}}, "no pose_keypoints_2d");
    refused("left/1.json", Json{{"persons", 1}}, "no list people");
    refused("left/1.json", Json::array(), "no list people (it is as AlphaPose, OpenPifPaf and MMPose write it)");
    refused("left/1.json", Json{{"instance_info", Json::array()}}, "as MMPose and Sapiens write it");
    refused("left/1.json", people(points(18)), "has 54 elements, expected 75 numbers");
    refused("left/1.json", people(points(18)), "--model_pose BODY_25");
    refused("left/10.json", people(points(25)), "frame 10, expected one below 10");
    refused("left/a.json", people(points(25)), "frame's number");
    refused("middle_1.json", people(points(25)), "expected one of left, right");
    refused("left_7.json", people(points(25)), "which another file has");

    test::Temporary folder;
    const auto cameras = cameras_called({"left"});
    const auto load = [&](const Json& json) {
        test::write_text(folder / "a.json", json.dump());
        return message_of([&] { (void)load_keypoints(folder / "a.json", cameras, 9); });
    };
    const Json image{{"id", 1}, {"file_name", "left/1.png"}};
    CHECK(load(Json{{"images", {image, image}}}) == test::contains("twice"));
    CHECK(load(Json{{"images", {{{"id", 1}}}}}) == test::contains("no file_name"));
    CHECK(load(Json{{"images", {image}}}) == test::contains("no list annotations"));
    CHECK(load(Json{{"images", {image}}, {"annotations", {{{"image_id", 2}}}}}) == test::contains("image_id 2"));
    CHECK(load(Json{{"images", {image}}, {"annotations", {{{"image_id", 1}}}}}) == test::contains("no keypoints"));
    CHECK(message_of([&] { (void)load_keypoints(folder / "none.json", cameras, 9); }) ==
          test::contains("does not exist"));
    test::Temporary empty;
    CHECK(message_of([&] { (void)load_keypoints(empty / "", cameras, 9); }) == test::contains("no .json files"));
}
