// SPDX-License-Identifier: Apache-2.0
/// @file  Samples of cameras, prior views, keypoints, detections, reconstructions by COLMAP, and captures.
#pragma once

#include "io/colmap_files.hpp"
#include "io/easymocap_files.hpp"
#include "io/gala_files.hpp"
#include "io/people_snapshot_files.hpp"
#include "io/sample_cameras.hpp"
#include "io/sample_files.hpp"
#include "io/samples.hpp"
#include "io/samples_of_motions.hpp"
#include "io/small_body.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/io/capture/any_capture.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/colmap_image.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/easymocap_cameras.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/io/capture/prior_views_file.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::test {

/// Opaque in the middle.
inline PixelImage person_photo(int width, int height, int number) {
    return masked(numbered_image(width, height, 1, number),
                  [&](int y, int x) { return y >= 1 && y < height - 1 && x >= width / 4 && x < 3 * width / 4; });
}

/// `count` points x, y, confidence, inside a picture of 24 × 16 pixels.
inline detail::Json sample_points(int count) {
    detail::Json list = detail::Json::array();
    for (int k = 0; k < count; ++k)
        for (const double number : {1.0 + k % 20, 1.0 + k % 13, 0.5}) list.push_back(number);
    return list;
}

inline void add_camera_files(Samples& samples) {
    const auto list = [](const std::filesystem::path& file) { return read_cameras(file); };
    write_cameras(samples.file("cameras", "two.json", list), {sample_cameras(), 25, -0.5, {1}});
    copy_of_0_1("capture/cameras.json", samples.file("cameras", "distorted.json", list));
    const auto one = [](const std::filesystem::path& file) { return read_camera(file); };
    copy_of_0_1("camera.json", samples.file("camera", "of_0_1.json", one));

    const auto priors = samples.folder("prior-views", "maps", {"priors.json"}, [](const std::filesystem::path& folder) {
        const std::vector<std::string> people{"anna", "ben"};
        return read_prior_views(folder / "priors.json", sample_cameras(), 3, people);
    });
    write_array(priors / "depth.npy", std::vector<float>(48, 2.0f), {6, 8});
    PixelImage normals(3, 6, 8), white(1, 6, 8);
    for (std::size_t i = 0; i < normals.data.size(); ++i) normals.data[i] = i % 3 == 2 ? 255 : 128;
    for (std::size_t i = 0; i < white.data.size(); ++i) white.data[i] = i % 8 < 5 ? 255 : 0;
    write_png(priors / "normals.png", normals), write_png(priors / "mask.png", white);
    write_text(priors / "priors.json", R"({"views": [
  {"depth": "depth.npy", "crop": [0, 0, 24, 16], "camera": "cam00", "frame": 2, "mask": "mask.png"},
  {"normals": "normals.png", "encoding": "opencv", "facing": "away", "person": "ben",
   "camera": {"width": 8, "height": 6, "scale": 4, "cx": 4, "cy": 3, "R": [1, 0, 0, 0, 1, 0, 0, 0, 1], "t": [0, 0, 2]}},
  {"normals": "normals.png", "integrate": true, "camera": "cam01", "crop": [2, 2, 16, 12], "frame": "canonical"}]})");

    const auto keypoints = [](const std::filesystem::path& folder) {
        const auto file = folder / "keypoints.json";
        return load_keypoints(std::filesystem::exists(file) ? file : folder, sample_cameras(), 3);
    };
    const auto openpose = samples.folder("keypoints", "openpose", {"cam00/000001_keypoints.json"}, keypoints);
    std::filesystem::create_directories(openpose / "cam00");
    const detail::Json person{{"pose_keypoints_2d", sample_points(25)},
                              {"hand_left_keypoints_2d", sample_points(21)},
                              {"face_keypoints_2d", detail::Json::array()}};
    const std::string people = detail::Json{{"version", 1.3}, {"people", {person}}}.dump();
    write_text(openpose / "cam00/000001_keypoints.json", people);
    write_text(openpose / "cam01_2_keypoints.json", people);
    const auto annotated = [&](const char* name, detail::Json annotation) {
        annotation["image_id"] = 1;
        const auto folder = samples.folder("keypoints", name, {"keypoints.json"}, keypoints);
        write_text(folder / "keypoints.json", detail::Json{{"images", {{{"id", 1}, {"file_name", "cam00/0001.png"}}}},
                                                           {"annotations", {annotation}}}
                                                  .dump());
    };
    annotated(
        "coco",
        {{"keypoints", sample_points(17)}, {"foot_kpts", sample_points(6)}, {"lefthand_kpts", sample_points(21)}});
    detail::Json world = detail::Json::array();
    for (int k = 0; k < 99; ++k) world.push_back(0.01 * k);
    annotated("mediapipe", {{"mediapipe_pose", sample_points(33)},
                            {"mediapipe_right_hand", sample_points(21)},
                            {"mediapipe_world", world}});

    const auto found = [](const std::filesystem::path& folder) { return load_detections(folder); };
    const auto single = samples.folder("detections", "of_0_1", {"video.json", "keypoints.json"}, found);
    std::filesystem::remove_all(single);
    copy_of_0_1("detections", single);
    const auto pair = samples.folder("detections", "calibrated", {"video.json", "calibration.json"}, found);
    detail::Json films = detail::Json::array();
    for (const char* name : {"cam00", "cam01"})
        films.push_back({{"name", name}, {"width", 24}, {"height", 16}, {"times", {0, 0.1, 0.2}}, {"focal", 30}});
    write_text(pair / "video.json", detail::Json{{"fps", 10}, {"cameras", films}}.dump());
    write_cameras(pair / "calibration.json", {sample_cameras(), 0, {}, {}});
    std::filesystem::copy_file(openpose.parent_path() / "coco/keypoints.json", pair / "keypoints.json");
    for (const char* name : {"cam00", "cam01"}) {
        std::filesystem::create_directories(pair / "masks" / name);
        for (const char* frame : {"0000.png", "0002.png"})
            write_png(pair / "masks" / name / frame, mask_of(person_photo(24, 16, 0)));
    }
}

inline void add_reconstructions(Samples& samples) {
    const auto read = [](const std::filesystem::path& folder) {
        return read_colmap_image(read_colmap(folder).images.at(0), folder / "images");
    };
    ColmapFiles files;
    files.cameras = {{1, 4, "OPENCV", 24, 16, {20, 20, 12, 8, -0.02, 0.003, 0.001, -0.002}},
                     {2, 2, "SIMPLE_RADIAL", 24, 16, {20, 12, 8, 0.01}}};
    files.images = {{1, {1, 0, 0, 0}, {0, 0, 2}, 1, "left/0001.png", 2}, {2, {0, 1, 0, 0}, {1, 0, 2}, 2, "m.png", 0}};
    files.points = {{7, {1, 2, 3}, {255, 0, 9}, 2}};
    const auto binary = samples.folder("colmap", "binary", {"cameras.bin", "images.bin", "points3D.bin"}, read);
    files.write_binary(binary);
    const auto text = samples.folder("colmap", "text", {"cameras.txt", "images.txt", "points3D.txt"}, read);
    write_text(text / "cameras.txt", "# cameras\n1 PINHOLE 24 16 20 20 12 8\n2 RADIAL 24 16 20 12 8 0.01 0.02\n");
    write_text(text / "images.txt", "1 1 0 0 0 0 0 2 1 left/0001.png\n1.5 2.5 -1\n2 1 0 0 0 1 0 2 2 m.png\n\n");
    write_text(text / "points3D.txt", "7 1 2 3 255 0 9 0.5 1 0\n");
    for (const auto& folder : {binary, text}) {
        std::filesystem::create_directories(folder / "images/left");
        write_png(folder / "images/left/0001.png", person_photo(24, 16, 0));
    }
    const auto cameras =
        samples.folder("easymocap-cameras", "two", {"intri.yml", "extri.yml"},
                       [](const std::filesystem::path& folder) { return read_easymocap_cameras(folder); });
    write_opencv_cameras(cameras, sample_cameras());
}

inline void add_captures(Samples& samples) {
    const BodyModel body = small_body(24, 3, 0);
    const auto read = [body](std::vector<std::filesystem::path> poses) {
        return [body, poses](const std::filesystem::path& folder) {
            cpu::Serial backend;
            return load_people_capture(backend, folder, {&body, 1}, poses);
        };
    };
    Capture made;
    made.cameras = sample_cameras();
    made.motion = still_motion(body, 2);
    made.fps = 1;
    for (int i = 0; i < 4; ++i) made.images.push_back(person_photo(24, 16, i));
    const auto own =
        samples.folder("capture", "own", {"cameras.json", "poses.npz", "images/cam00/0000.png"}, read({"poses.npz"}));
    made.backgrounds.assign(2, masked(numbered_image(24, 16, 2, 0), [](int, int) { return true; }));
    made.hidden.assign(4, {});
    made.hidden[1] = {{5, {0, 0, 0}, 1}, {6, {0, 0, 0}, 1}};
    save_capture(own, made);
    const auto with_masks = samples.folder("capture", "masks", {"masks/cam01/0001.png"}, read({"poses.npz"}));
    made.backgrounds.clear(), made.hidden.clear();
    save_capture(with_masks, made);
    for (const NamedCamera& camera : made.cameras) {
        std::filesystem::create_directories(with_masks / "masks" / camera.name);
        for (const char* name : {"0000.png", "0001.png"})
            write_png(with_masks / "masks" / camera.name / name, mask_of(person_photo(24, 16, 0)));
    }
    const auto people =
        samples.folder("people-capture", "two", {"ben.npz", "cameras.json"}, read({"anna.npz", "ben.npz"}));
    save_capture(people, made);
    std::filesystem::rename(people / "poses.npz", people / "anna.npz");
    save_motion(people / "ben.npz", still_motion(body, 2));
    std::filesystem::create_directories(people / "person_masks/ben/cam00");
    for (const char* name : {"0000.png", "0001.png"})
        write_png(people / "person_masks/ben/cam00" / name, mask_of(person_photo(24, 16, 0)));

    PeopleSnapshotFiles video;
    Camera<double> camera = sample_cameras()[0].camera;
    camera.R = mat3<double>(1.0), camera.t = vec3<double>(0);
    video.write_camera(camera);
    for (int frame = 0; frame < 4; ++frame) {
        std::vector<double> pose(72, 0.125);
        pose[0] = 3;
        video.thetas.insert(video.thetas.end(), pose.begin(), pose.end());
        for (const double number : {0.0, 0.6, 5.0}) video.transl.push_back(number);
        video.write_photo(frame, person_photo(24, 16, frame));
    }
    video.write_all(0.5);
    video.write_split("anim_nerf_train.npz", {0, 2}, 0.25, 0.125);
    video.write_split("anim_nerf_test.npz", {3}, 0.25, 0.125);
    write_text(video.path / "split.json", R"({"train": [0, 2, 2], "test": [3, 3, 1]})");
    const auto snapshot = samples.folder("snapshot-capture", "video",
                                         {"cameras.npz", "poses/anim_nerf_train.npz", "split.json"}, read({}));
    std::filesystem::copy(video.path, snapshot, std::filesystem::copy_options::recursive);

    const auto mocap = samples.folder("easymocap-capture", "studio",
                                      {"intri.yml", "extri.yml", "output/smpl/smpl/000003.json"}, read({}));
    write_opencv_cameras(mocap, sample_cameras());
    for (const int frame : {3, 4}) {
        write_people(mocap / "output/smpl/smpl", frame, detail::Json::array({easymocap_person(72)}));
        for (const char* name : {"cam00", "cam01"}) write_view(mocap, name, frame, person_photo(24, 16, frame));
    }

    const Gala gala;
    const auto scene =
        samples.folder("gala-capture", "scene",
                       {"model/weights.npy", "model/jointParent.txt", "scene/camera/1.txt", "scene/pose/0000.txt"},
                       [](const std::filesystem::path& folder) {
                           cpu::Serial backend;
                           return load_any_capture(backend, folder / "scene", nullptr);
                       });
    std::filesystem::copy(gala.model, scene / "model");
    std::filesystem::copy(gala.scene, scene / "scene", std::filesystem::copy_options::recursive);
    for (const char* frame : {"0002", "0003"}) {
        std::filesystem::remove(scene / "scene/pose" / (std::string(frame) + ".txt"));
        for (const char* id : {"0", "1", "6"})
            for (const char* ending : {".png", "_mask.png"})
                std::filesystem::remove(scene / "scene" / id / (std::string(frame) + ending));
    }
}

} // namespace gsh::test
