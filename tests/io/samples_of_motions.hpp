// SPDX-License-Identifier: Apache-2.0
/// @file  Samples of motions: .npz of every layout, BVH, glTF, folders of frames, joint maps.
#pragma once

#include "io/bvh_files.hpp"
#include "io/easymocap_files.hpp"
#include "io/gala_files.hpp"
#include "io/gltf_files.hpp"
#include "io/sam3d_files.hpp"
#include "io/sample_files.hpp"
#include "io/samples.hpp"
#include "io/small_body.hpp"
#include "support/gradient.hpp"
#include "support/skeleton_body.hpp"

#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/joint_map_file.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// Arrays [T, width] of small numbers by their names.
using Widths = std::vector<std::pair<std::string, std::size_t>>;
inline void add_rows_of(NpzWriter& file, std::size_t frames, const Widths& members) {
    Rng rng(9);
    for (const auto& [key, width] : members)
        add_floats(file, key, rng.numbers(frames * width, -0.3, 0.3), {frames, width});
}

/// A frame of ExAvatar's JSON.
inline detail::Json smplx_json_frame() {
    Rng rng(4);
    detail::Json json;
    for (const char* key : {"root_pose", "jaw_pose", "leye_pose", "reye_pose", "trans"})
        json[key] = {0.125, -0.25, 0.5};
    for (const auto& [key, joints] :
         std::vector<std::pair<const char*, int>>{{"body_pose", 21}, {"lhand_pose", 15}, {"rhand_pose", 15}})
        for (int j = 0; j < joints; ++j) json[key].push_back({0.25, 0, -0.125});
    json["expr"] = {0.5, -0.5}, json["betas"] = {1, 0, 0.5};
    return json;
}

inline detail::Json easymocap_person(std::size_t numbers) {
    return {{"id", 0},
            {"Rh", row({0.125, 0, 0})},
            {"Th", row({0, 0, 3})},
            {"poses", row(std::vector<double>(numbers, 0.125))},
            {"shapes", row({0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0})}};
}

inline void add_motion_files(Samples& samples) {
    const BodyModel smplx = small_body(55, 3, 2, true), smpl = small_body(24, 3, 0);
    const auto for_smplx = [smplx](const std::filesystem::path& file) { return load_any_motion(file, smplx); };
    const auto for_smpl = [smpl](const std::filesystem::path& file) { return load_any_motion(file, smpl); };
    const auto for_rig = [](const std::filesystem::path& file) { return load_any_motion(file, skeleton_body()); };
    const auto npz = [&](const char* target, const char* name, const auto& read, std::size_t frames,
                         const Widths& members, const auto& more) {
        NpzWriter file(samples.file(target, name, read), Packing::deflated);
        add_rows_of(file, frames, members);
        more(file);
        file.commit();
    };
    const auto betas = [](NpzWriter& file) { file.add("betas", std::vector<double>{0.5, 0, -0.5}); };

    save_motion(samples.file("motion", "split.npz", for_smplx), still_motion(smplx, 2));
    npz("motion", "components.npz", for_smplx, 2,
        {{"global_orient", 3}, {"body_pose", 63}, {"transl", 3}, {"left_hand_pose", 6}, {"expression", 10}},
        [&](NpzWriter& file) { betas(file), file.add("fps", 25.0), file.add("flat_hand", std::int64_t(1)); });
    save_motion(samples.file("motion-smpl", "whole.npz", for_smpl), still_motion(smpl, 2));
    npz("motion-smpl", "body.npz", for_smpl, 2, {{"poses", 66}, {"transl", 3}}, betas);
    npz("amass", "whole.npz", for_smplx, 2, {{"poses", 165}, {"trans", 3}},
        [&](NpzWriter& file) { betas(file), file.add("mocap_frame_rate", 120.0), file.add_text("gender", "female"); });
    npz("amass", "split.npz", for_smplx, 2,
        {{"root_orient", 3}, {"pose_body", 63}, {"pose_hand", 90}, {"pose_jaw", 3}, {"pose_eye", 6}, {"trans", 3}},
        [](NpzWriter& file) { file.add("mocap_time_length", 0.5); });
    const Widths fits{{"global_orient", 3}, {"body_pose", 63}, {"left_hand_pose", 12},   {"right_hand_pose", 12},
                      {"expression", 2},    {"betas", 3},      {"camera_translation", 3}};
    npz("smplifyx", "camera.npz", for_smplx, 2, fits, [](NpzWriter& file) {
        file.add("camera_rotation", std::vector<double>{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, -1, 0, 0, 0, 0, 1},
                 {2, 1, 3, 3});
        file.add("focal_length", 500.0), file.add("camera_center", std::vector<double>{27, 28, 27, 28}, {2, 2});
        file.add("frame_ids", std::vector<std::int64_t>{3, 5});
    });
    npz("snapshot-poses", "thetas.npz", for_smpl, 2, {{"thetas", 72}, {"transl", 3}}, betas);
    for (const bool camera_axes : {true, false})
        sam3d_arrays(sample_rig({.names = Names::mhr, .spine = 1, .toes = false, .frames = 2}), camera_axes)
            .save(samples.file("sam3d", camera_axes ? "camera.npz" : "world.npz", for_rig));

    const auto rig = sample_rig({.spine = 1, .toes = false, .frames = 2});
    write_text(samples.file("bvh", "mixamo.bvh", for_rig), bvh_text(rig));
    write_text(samples.file("bvh", "cmu.bvh", for_rig),
               bvh_text(sample_rig({.names = Names::cmu, .rest = Rest::A, .units = 100, .z_up = true, .frames = 2}),
                        "XYZ", 0.04));
    write_text(samples.file("glb-motion", "skin.glb", for_rig), gltf_of(rig, {.skin = true}).glb());
    write_text(samples.file("glb-motion", "cubic.glb", for_rig),
               gltf_of(rig, {.axes = 3, .armature = true, .interpolation = "CUBICSPLINE"}).glb());
    write_text(samples.file("glb-motion", "vrm.glb", for_rig),
               gltf_of(sample_rig({.names = Names::vrm, .spine = 1, .toes = false, .frames = 2}),
                       {.posed_nodes = true, .vrm = true, .interpolation = "STEP"})
                   .glb());
    write_text(samples.file("gltf-motion", "skin.gltf", for_rig), gltf_of(rig, {.skin = true}).gltf());

    const auto exavatar =
        samples.folder("smplx-json", "exavatar", {"smplx_optimized/smplx_params_smoothed/2.json"}, for_smplx);
    const auto params = exavatar / "smplx_optimized/smplx_params_smoothed";
    std::filesystem::create_directories(params);
    for (const char* name : {"2.json", "10.json"}) write_text(params / name, smplx_json_frame().dump());
    write_text(exavatar / "smplx_optimized/shape_param.json", "[0.5, 0.25, 0]");
    const auto lhm = samples.folder("smplx-json", "lhm", {"00001.json"}, for_smplx);
    write_text(lhm / "00001.json", smplx_json_frame().dump());
    const auto mocap = samples.folder("easymocap-poses", "smpl", {"output/smpl/smpl/000000.json"}, for_smpl);
    for (int frame = 0; frame < 2; ++frame)
        write_people(mocap / "output/smpl/smpl", frame, detail::Json::array({easymocap_person(72)}));
    const auto annots = samples.folder("easymocap-poses", "annots", {"000003.json"}, for_smpl);
    write_people(annots, 3, {{"annots", detail::Json::array({easymocap_person(69)})}});
    const auto frames = samples.folder("npz-frames", "frames", {"frame_00001.npz"}, for_smplx);
    for (const char* name : {"frame_00001.npz", "frame_00003.npz"}) {
        NpzWriter file(frames / name, Packing::deflated);
        add_rows_of(file, 1, {{"global_orient", 3}, {"body_pose", 63}, {"transl", 3}});
        betas(file);
        file.commit();
    }

    const Gala gala;
    const auto scene =
        samples.folder("gala-poses", "scene", {"model/tpose.txt", "model/mesh.txt", "scene/pose/0001.txt"},
                       [body = small_body(27)](const std::filesystem::path& folder) {
                           return load_any_motion(folder / "scene", load_gala_rig(folder / "model").body);
                       });
    std::filesystem::copy(gala.model, scene / "model");
    std::filesystem::create_directories(scene / "scene/pose");
    for (const char* name : {"0001.txt", "0002.txt"})
        std::filesystem::copy(gala.scene / "pose" / name, scene / "scene/pose");

    write_text(
        samples.file("joint-map", "map.json", [](const std::filesystem::path& file) { return read_joint_map(file); }),
        R"({"Bip_LeftArm": "left_shoulder", "Bip_Prop": null})");
}

} // namespace gsh::test
