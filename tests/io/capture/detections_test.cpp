// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/detections.hpp>

#include "io/sample_files.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>

using namespace gsh;
using detail::Json;

namespace {

/// Two frames of two cameras with masks, and one person in the first frame of the first.
struct DetectorFolder {
    test::Temporary folder;
    Json video, keypoints, calibration;

    DetectorFolder() {
        const auto camera = [](const char* name) {
            return Json{{"name", name}, {"source", "a.mp4"}, {"width", 24}, {"height", 16}, {"times", {0.0, 0.1}}};
        };
        video = {{"fps", 10}, {"cameras", {camera("left"), camera("right")}}};
        Json points = Json::array();
        for (int k = 0; k < 33; ++k)
            for (const double number : {1.0 + k % 20, 1.0 + k % 13, 0.5}) points.push_back(number);
        keypoints = {{"images", {{{"id", 3}, {"file_name", "left/0000.png"}}}},
                     {"annotations", {{{"image_id", 3}, {"mediapipe_pose", points}}}}};
        const auto calibrated = [](const char* name) {
            return Json{{"name", name},
                        {"width", 24},
                        {"height", 16},
                        {"K", {30, 0, 12, 0, 30, 8, 0, 0, 1}},
                        {"R", {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                        {"t", {0, 0, 2}}};
        };
        calibration = {{"cameras", {calibrated("right"), calibrated("left")}}};
        for (const char* name : {"left", "right"}) {
            std::filesystem::create_directories(folder / "masks" / name);
            for (const char* file : {"0000.png", "0001.png"}) {
                PixelImage mask(1, 16, 24);
                for (std::size_t i = 0; i < 100; ++i) mask.data[i] = 255;
                write_png(folder / "masks" / name / file, mask);
            }
        }
    }
    [[nodiscard]] Detections load() const {
        test::write_text(folder / "video.json", video.dump());
        test::write_text(folder / "keypoints.json", keypoints.dump());
        if (!calibration.is_null()) test::write_text(folder / "calibration.json", calibration.dump());
        return load_detections(folder / "");
    }
    void refused(const char* expected) const {
        std::string message = "none";
        try {
            (void)load();
        } catch (const Error& error) {
            message = error.what();
        }
        CAPTURE(message);
        CHECK(message == test::contains(expected));
    }
    [[nodiscard]] Json& camera(std::size_t c) { return video["cameras"][c]; }
};

} // namespace

TEST_CASE("a detector's folder is read: cameras in the order of the video's, keypoints, masks") {
    const DetectorFolder files;
    const Detections found = files.load();
    REQUIRE(found.cameras.size() == 2);
    CHECK(found.calibrated);
    CHECK(found.cameras[0].name == "left");
    CHECK(found.cameras[0].camera.fx == 30);
    CHECK(found.cameras[0].camera.t.z == 2);
    CHECK(found.times == std::vector<double>{0, 0.1});
    REQUIRE(found.keypoints.size() == 1);
    CHECK(found.keypoints[0].people[0].points.size() == 33);
    CHECK(found.keypoints[0].people[0].points[0].landmark == landmark_number("nose"));
    REQUIRE(found.masks[1].size() == 2);
    const PixelImage mask = load_detected_mask(found, 1, 0);
    CHECK((mask.width == 24 && mask.channels == 1 && mask.data[99] == 255 && mask.data[100] == 0));
}

TEST_CASE("a single camera needs no calibration: 1.2 times the longer side, or the focal length that is known") {
    DetectorFolder files;
    files.calibration = Json();
    files.refused("calibration.json: does not exist; several cameras need a calibration");
    files.video["cameras"].erase(1);
    Detections found = files.load();
    CHECK(!found.calibrated);
    CHECK(!found.known_focal[0]);
    CHECK(found.cameras[0].camera.fx == doctest::Approx(28.8));
    CHECK(found.cameras[0].camera.cx == 12);
    files.camera(0)["focal"] = 31;
    found = files.load();
    CHECK(found.known_focal[0]);
    CHECK(found.cameras[0].camera.fy == 31);
}

TEST_CASE("a camera may end before the others, and a frame may have no mask") {
    DetectorFolder files;
    files.camera(1)["times"] = {0.0, 0.1, 0.2};
    for (const char* file : {"0002.png", "0001.png"})
        write_png(files.folder / "masks/right" / file, PixelImage(1, 16, 24));
    std::filesystem::remove(files.folder / "masks/left/0000.png");
    const Detections found = files.load();
    CHECK(found.times == std::vector<double>{0.0, 0.1, 0.2});
    CHECK(!found.has_mask(0, 0));
    CHECK(found.has_mask(0, 1));
    CHECK(!found.has_mask(0, 2));
    CHECK(found.has_mask(1, 2));
    CHECK(load_detected_mask(found, 0, 1).data[99] == 255);
    std::filesystem::remove_all(files.folder / "masks/left");
    CHECK(!files.load().has_mask(0, 1));
}

TEST_CASE("masks that were cut anew are read first, then those of the detector, then mended ones") {
    DetectorFolder files;
    CHECK(!files.load().masks_by_body);
    files.video["masks_by_body"] = true;
    CHECK(files.load().masks_by_body);
    const auto folder_of = [&](std::size_t camera) { return files.load().masks[camera][0].parent_path(); };
    for (const char* kind : {"masks_detected", "masks_by_body"}) {
        std::filesystem::create_directories(files.folder / kind / "left");
        for (const char* file : {"0000.png", "0001.png"})
            write_png(files.folder / kind / "left" / file, PixelImage(1, 16, 24));
        CHECK(folder_of(0) == files.folder / kind / "left");
        CHECK(folder_of(1) == files.folder / "masks/right");
    }
}

TEST_CASE("damaged folders of a detector are refused, with file and field") {
    const auto changed = [](auto change, const char* expected) {
        DetectorFolder files;
        change(files);
        files.refused(expected);
    };
    changed([](DetectorFolder& f) { f.video = Json::array(); }, "video.json is array, expected an object");
    changed([](DetectorFolder& f) { f.video["cameras"] = Json::array(); },
            "cameras must be a list with at least one camera");
    changed([](DetectorFolder& f) { f.video["masks_by_body"] = 1; }, "masks_by_body is number, expected true or false");
    changed([](DetectorFolder& f) { f.camera(0).erase("width"); }, "'left': width is missing");
    changed([](DetectorFolder& f) { f.camera(0)["width"] = 0; }, "width x height is 0 x 16");
    changed([](DetectorFolder& f) { f.camera(0)["name"] = "../a"; }, "name is not a plain folder name");
    changed([](DetectorFolder& f) { f.camera(1)["name"] = "left"; }, "name stands there twice");
    changed([](DetectorFolder& f) { f.camera(0)["focal"] = -3; }, "focal is -3");
    changed([](DetectorFolder& f) { f.camera(0)["times"] = Json::array(); }, "times is empty");
    changed([](DetectorFolder& f) { f.camera(0)["times"] = {0.1, 0.1}; },
            "times[1] is 0.1, expected more than the 0.1");
    changed([](DetectorFolder& f) { f.camera(1)["times"] = {0.0, 0.1, 0.2}; },
            "masks/left: holds 2 images, expected 3, one for each of the times");
    changed([](DetectorFolder& f) { f.camera(1)["times"] = {0.0, 0.2}; },
            "times[1] is 0.2, expected at most half a frame");
    changed([](DetectorFolder& f) { f.calibration["cameras"][0]["name"] = "top"; }, "has no camera right");
    changed([](DetectorFolder& f) { f.calibration["cameras"][0]["width"] = 48; },
            "is of images of 48 x 16, but video.json");
    changed([](DetectorFolder& f) { f.calibration["cameras"][1]["distortion"] = {0.1, 0, 0, 0, 0}; },
            "has a distortion");
    changed(
        [](DetectorFolder& f) {
            for (const char* name : {"left", "right"}) std::filesystem::remove(f.folder / "masks" / name / "0001.png");
        },
        "holds 1 images, expected 2");
    changed([](DetectorFolder& f) { f.keypoints.erase("images"); }, "has no list images");
    changed([](DetectorFolder& f) { f.keypoints["annotations"][0]["mediapipe_pose"].push_back(1); },
            "has 100 elements");

    test::Temporary empty;
    CHECK_THROWS_WITH_AS((void)load_detections(empty / "none"), doctest::Contains("video.json: does not exist"),
                         IoError);
    const DetectorFolder files;
    Detections found = files.load();
    found.cameras[0].camera.width = 25;
    CHECK_THROWS_WITH_AS((void)load_detected_mask(found, 0, 1),
                         doctest::Contains("is 24 x 16, but the images of camera left are 25 x 16"), ShapeError);
}
