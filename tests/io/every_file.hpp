// SPDX-License-Identifier: Apache-2.0
/// @file  A good file of every kind that gsh reads, with its reader, for tests that damage files or let reading fail.
#pragma once

#include "io/bvh_files.hpp"
#include "io/colmap_files.hpp"
#include "io/gltf_files.hpp"
#include "io/safetensors_files.hpp"
#include "io/small_body.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/digest.hpp"
#include "support/sample_rig.hpp"
#include "support/tube_avatar.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/body/region_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/easymocap_cameras.hpp>
#include <gsh/io/capture/gala_basketball.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/capture/prior_views_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/safetensors.hpp>
#include <gsh/io/file/settings_file.hpp>
#include <gsh/io/image/depth_map_file.hpp>
#include <gsh/io/image/environment_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/normal_map_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/easymocap_file.hpp>
#include <gsh/io/motion/joint_map_file.hpp>
#include <gsh/io/splat/any_splats.hpp>

#include <doctest/doctest.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// A whole file and its reader. The reader may look at other files of the folder.
struct FileSample {
    std::string name; ///< of the file that is damaged
    /// Returns a digest of what was read.
    std::function<std::string(const std::filesystem::path& file)> read;
};

inline std::string sample_jpeg() {
    PixelImage image(3, 16, 24);
    for (std::size_t i = 0; i < image.data.size(); ++i) image.data[i] = static_cast<std::uint8_t>(37 * i);
    std::string bytes;
    const auto append = [](void* context, void* data, int size) {
        static_cast<std::string*>(context)->append(static_cast<const char*>(data), static_cast<std::size_t>(size));
    };
    REQUIRE(stbi_write_jpg_to_func(append, &bytes, image.width, image.height, 3, image.data.data(), 90));
    return bytes;
}

inline NamedCamera sample_camera(const std::string& name) {
    NamedCamera camera;
    camera.name = name;
    camera.camera.width = 24, camera.camera.height = 16;
    camera.camera.fx = camera.camera.fy = 20, camera.camera.cx = 12, camera.camera.cy = 8;
    camera.camera.R = mat3<double>(1.0), camera.camera.t = {0, 0, 3};
    return camera;
}

/// Writes a good file for each reader.
inline std::vector<FileSample> write_file_samples(const std::filesystem::path& folder) {
    const auto at = [&](const char* name) { return folder / name; };
    const BodyModel body = small_body();
    std::vector<FileSample> samples;
    const auto add = [&](const std::string& name, std::function<std::string(const std::filesystem::path&)> read) {
        samples.push_back({name, std::move(read)});
    };
    const auto splats = [](const std::filesystem::path& file) { return Digest::of(load_any_splats(file)); };
    const auto motion = [body](const std::filesystem::path& file) { return Digest::of(load_any_motion(file, body)); };

    save_body_model(at("body.npz"), body);
    add("body.npz", [](const std::filesystem::path& file) { return Digest::of(load_body_model(file)); });
    save_motion(at("motion.npz"), still_motion(body, 3));
    add("motion.npz", motion);
    save_avatar(at("a.gsh"), tube_avatar(3));
    add("a.gsh", [](const std::filesystem::path& file) { return Digest::of(load_avatar(file)); });
    SafetensorsFile tensors;
    const std::vector<float> numbers{1, 2, 3, 4, 5, 6};
    tensors.add("first", "2, 3", numbers), tensors.add("second", "6", numbers, "BF16");
    tensors.write(at("a.safetensors"));
    add("a.safetensors", [](const std::filesystem::path& file) {
        const SafetensorsReader reader(file);
        std::string all;
        for (const std::string& key : reader.keys()) all += Digest::of(reader.read<float>(key).data);
        return all;
    });

    const auto cloud = splat_cloud(20, 1);
    for (const SplatFormatTraits& row : splat_formats) {
        if (!row.read || !row.write) continue;
        for (const int version : std::set<int>(row.versions.begin(), row.versions.end())) {
            const std::string name = "splats_" + std::to_string(version) + std::string(row.ending);
            save_splats(folder / name, cloud, {.version = version});
            add(name, splats);
        }
    }

    const auto rig = sample_rig({.spine = 1, .toes = false, .frames = 2});
    write_file(at("a.bvh"), bvh_text(rig));
    add("a.bvh", [](const std::filesystem::path& file) { return Digest::of(load_bvh(file)); });
    const auto gltf = gltf_of(rig, {.skin = true});
    write_file(at("motion.glb"), gltf.glb());
    write_file(at("motion.gltf"), gltf.gltf());
    for (const char* name : {"motion.glb", "motion.gltf"})
        add(name, [](const std::filesystem::path& file) { return Digest::of(load_gltf_motion(file)); });

    PixelImage picture(4, 16, 24);
    for (std::size_t i = 0; i < picture.data.size(); ++i)
        picture.data[i] = static_cast<std::uint8_t>(i % 4 < 3 ? i : 255);
    write_png(at("a.png"), picture);
    write_file(at("a.jpg"), sample_jpeg());
    for (const char* name : {"a.png", "a.jpg"})
        add(name, [](const std::filesystem::path& file) { return Digest::of(read_image(file)); });
    write_file(at("a.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + std::string(128, '\x80'));
    add("a.hdr", [](const std::filesystem::path& file) { return Digest::of(read_environment(file)); });
    PixelImage normals(3, 6, 8);
    for (std::size_t i = 0; i < normals.data.size(); ++i) normals.data[i] = i % 3 == 2 ? 255 : 128;
    write_png(at("normals.png"), normals);
    add("normals.png", [](const std::filesystem::path& file) { return Digest::of(read_normal_map(file, {})); });
    const std::vector<float> depths(48, 2.0f);
    write_npy<float>(at("depth.npy"), depths, {6, 8});
    add("depth.npy", [](const std::filesystem::path& file) { return Digest::of(read_depth_map(file, false)); });

    CameraList list;
    list.cameras = {sample_camera("cam00"), sample_camera("cam01")};
    write_cameras(at("cameras.json"), list);
    add("cameras.json", [](const std::filesystem::path& file) { return Digest::of(read_cameras(file)); });
    write_file(at("priors.json"), R"({"views": [{"depth": "depth.npy", "crop": [0, 0, 24, 16], "camera": "cam00"}]})");
    const auto cameras = list.cameras;
    add("priors.json",
        [cameras](const std::filesystem::path& file) { return Digest::of(read_prior_views(file, cameras, 3)); });
    std::string points;
    for (int i = 0; i < 51; ++i) points += (i ? "," : "") + std::to_string(i % 3 == 2 ? 1 : 1 + i % 14);
    write_file(
        at("keypoints.json"),
        R"({"images": [{"id": 1, "file_name": "cam00/0001.png"}], "annotations": [{"image_id": 1, "keypoints": [)" +
            points + "]}]}");
    add("keypoints.json",
        [cameras](const std::filesystem::path& file) { return Digest::of(load_keypoints(file, cameras, 3)); });
    write_file(at("video.json"),
               R"({"cameras": [{"name": "cam00", "width": 24, "height": 16, "times": [0, 0.1, 0.2]}]})");
    add("video.json",
        [](const std::filesystem::path& file) { return Digest::of(load_detections(file.parent_path())); });
    write_file(at("map.json"), R"({"Bip_LeftArm": "left_shoulder", "Bip_Prop": null})");
    add("map.json", [](const std::filesystem::path& file) { return Digest::of(read_joint_map(file)); });
    write_file(at("settings.json"), R"({"a": 0.5, "b": true, "c": "text"})");
    add("settings.json", [](const std::filesystem::path& file) { return Digest::of(read_settings(file)); });
    write_file(at("regions.json"),
               R"({"face_vertices": [1, 2], "left_hand_vertices": [3], "right_hand_vertices": [4, 5]})");
    add("regions.json", [](const std::filesystem::path& file) { return Digest::of(read_regions(file, 57)); });

    ColmapFiles colmap;
    colmap.cameras = {{1, 4, "OPENCV", 24, 16, {20, 20, 12, 8, -0.02, 0.003, 0.001, -0.002}}};
    colmap.images = {{1, {1, 0, 0, 0}, {0, 0, 2}, 1, "left/0001.png", 2}, {2, {1, 0, 0, 0}, {1, 0, 2}, 1, "2.png", 0}};
    colmap.points = {{7, {1, 2, 3}, {255, 0, 9}, 2}};
    colmap.write_binary(folder);
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"})
        add(name, [](const std::filesystem::path& file) { return Digest::of(read_colmap(file.parent_path())); });
    const std::filesystem::path text = folder / "text";
    std::filesystem::create_directories(text);
    write_file(text / "cameras.txt", "# cameras\n1 PINHOLE 24 16 20 20 12 8\n");
    write_file(text / "images.txt", "1 1 0 0 0 0 0 2 1 left/0001.png\n1.5 2.5 -1\n2 1 0 0 0 1 0 2 1 2.png\n\n");
    write_file(text / "points3D.txt", "7 1 2 3 255 0 9 0.5 1 0\n");
    for (const char* name : {"text/cameras.txt", "text/images.txt", "text/points3D.txt"})
        add(name, [](const std::filesystem::path& file) { return Digest::of(read_colmap(file.parent_path())); });

    const std::string matrix =
        ": !!opencv-matrix\n  rows: 3\n  cols: 3\n  dt: d\n  data: [20, 0, 12, 0, 20, 8, 0, 0, 1]\n";
    const std::string head = "%YAML:1.0\n---\nnames:\n  - \"01\"\n";
    write_file(at("intri.yml"), head + "K_01" + matrix + "H_01: 16\nW_01: 24\n");
    write_file(at("extri.yml"), head + "Rot_01: !!opencv-matrix\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n" +
                                    "T_01: !!opencv-matrix\n  data: [0, 0, 2]\n");
    for (const char* name : {"intri.yml", "extri.yml"})
        add(name,
            [](const std::filesystem::path& file) { return Digest::of(read_easymocap_cameras(file.parent_path())); });
    write_file(at("gala.txt"), "45 24 16\n0 1 3\n0 0 0 1\n");
    add("gala.txt", [](const std::filesystem::path& file) { return Digest::of(gsh::detail::read_gala_camera(file)); });
    std::filesystem::create_directories(folder / "people");
    std::string zeros = "[0";
    for (int i = 1; i < 72; ++i) zeros += ", 0";
    write_file(folder / "people/000000.json", R"([{"id": 0, "Rh": [[0, 0, 0]], "Th": [[0, 0, 3]], "poses": [)" + zeros +
                                                  R"(]], "shapes": [[0, 0, 0, 0, 0, 0, 0, 0, 0, 0]]}])");
    const BodyModel smpl = small_body(24);
    add("people/000000.json",
        [smpl](const std::filesystem::path& file) { return Digest::of(load_any_motion(file.parent_path(), smpl)); });
    return samples;
}

} // namespace gsh::test
