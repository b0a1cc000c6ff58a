// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the SMPL poses of PeopleSnapshot, for all frames or for those of a split.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/amass_file.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>
#include <gsh/io/motion/smplifyx_file.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::detail {

/// A frame of the video that the capture uses.
struct SnapshotFrame {
    int number = 0;
    bool test = false;
};

/// SMPL poses of a file: thetas [n, 72], or global_orient and body_pose.
struct SnapshotPoses {
    std::filesystem::path path;
    std::vector<double> thetas, transl; // [n, 72], [n, 3]
    NpyArray<double> betas;
    [[nodiscard]] std::size_t size() const { return transl.size() / 3; }
};

inline SnapshotPoses read_snapshot_poses(const InputFile& input) {
    const NpzReader file(input);
    MotionTable table(input.path());
    TableOfNpz members(file, table);
    SnapshotPoses poses{input.path(), {}, {}, {}};
    if (members.take("thetas", "thetas", 72) || members.take("poses", "thetas", 72)) {
        poses.thetas = table.read<double>("thetas").data;
    } else {
        for (const auto& [key, width] : {std::pair<const char*, std::size_t>{"global_orient", 3}, {"body_pose", 69}})
            if (!members.take(key, key, width)) throw IoError(file.name_of(key) + " is missing, and so is thetas");
        const auto root = table.read<double>("global_orient"), rest = table.read<double>("body_pose");
        for (std::size_t t = 0; t < members.frames(); ++t) {
            poses.thetas.insert(poses.thetas.end(), &root.data[3 * t], &root.data[3 * t] + 3);
            poses.thetas.insert(poses.thetas.end(), &rest.data[69 * t], &rest.data[69 * t] + 69);
        }
    }
    if (!members.take("transl", "transl", 3) && !members.take("trans", "transl", 3))
        throw IoError(file.name_of("transl") + " is missing");
    poses.transl = table.read<double>("transl").data;
    poses.betas = file.read<double>("betas");
    return poses;
}

/// Adds the poses to a table as parts of SMPL, under the names that MotionReader expects.
inline void add_snapshot_poses(MotionTable& table, const SnapshotPoses& poses) {
    const std::size_t T = poses.size();
    std::vector<double> root, rest;
    for (std::size_t t = 0; t < T; ++t) {
        const double* row = &poses.thetas[72 * t];
        root.insert(root.end(), row, row + 3);
        rest.insert(rest.end(), row + 3, row + 72);
    }
    table.add("global_orient", "global_orient", std::move(root), {T, 3});
    table.add("body_pose", "body_pose", std::move(rest), {T, 69});
    table.add("transl", "transl", poses.transl, {T, 3});
    table.add("betas", "betas", poses.betas);
}

/// Loads a motion file of this layout alone.
inline Motion load_snapshot_motion(const InputFile& input, const BodyModel& body, const MotionFileOptions& options,
                                   std::vector<std::string>* warnings) {
    MotionTable table(input.path());
    add_snapshot_poses(table, read_snapshot_poses(input));
    copy_stated_time(NpzReader(input), table);
    return MotionReader<MotionTable>(std::move(table), body, options, warnings).read();
}

/// Motion of SMPL poses for these frames, from the files of the split or else from the file of all frames.
inline Motion snapshot_motion(const std::filesystem::path& folder, const BodyModel& body,
                              const std::vector<SnapshotFrame>& frames, std::size_t images,
                              MotionFileOptions::Hands hands, std::vector<std::string>* warnings) {
    std::error_code ignored;
    std::optional<SnapshotPoses> of_split[2], of_all;
    for (const bool test : {false, true}) {
        const std::string name = test ? "test.npz" : "train.npz";
        for (const auto& path : {folder / "poses" / ("anim_nerf_" + name), folder / "poses" / name})
            if (!of_split[test] && std::filesystem::exists(path, ignored)) of_split[test] = read_snapshot_poses(path);
    }
    auto everything = folder / "poses.npz";
    if (!std::filesystem::exists(everything, ignored)) everything = folder / "poses_optimized.npz";
    for (const bool test : {false, true}) {
        std::size_t wanted = 0;
        for (const SnapshotFrame& frame : frames) wanted += frame.test == test;
        if (wanted == 0) continue;
        if (!of_split[test] && !of_all) of_all = read_snapshot_poses(everything);
        const SnapshotPoses& poses = of_split[test] ? *of_split[test] : *of_all;
        const std::size_t expected = of_split[test] ? wanted : images;
        if (poses.size() != expected)
            throw ShapeError(poses.path.string() + ": holds " + std::to_string(poses.size()) + " poses, expected " +
                             std::to_string(expected) + ", one per " +
                             (of_split[test]
                                  ? test ? "test frame; does the split fit?" : "training frame; does the split fit?"
                                  : "image"));
    }
    SnapshotPoses chosen{
        of_split[0] ? of_split[0]->path : everything, {}, {}, of_split[0] ? of_split[0]->betas : of_all->betas};
    std::vector<double> timestamps;
    std::size_t next[2] = {0, 0};
    for (const auto& [number, test] : frames) {
        const SnapshotPoses& poses = of_split[test] ? *of_split[test] : *of_all;
        const std::size_t row = of_split[test] ? next[test]++ : static_cast<std::size_t>(number);
        chosen.thetas.insert(chosen.thetas.end(), &poses.thetas[72 * row], &poses.thetas[72 * row] + 72);
        chosen.transl.insert(chosen.transl.end(), &poses.transl[3 * row], &poses.transl[3 * row] + 3);
        timestamps.push_back(number / 30.0);
    }
    MotionTable table(chosen.path);
    add_snapshot_poses(table, chosen);
    table.add("timestamps", "timestamps", std::move(timestamps), {frames.size()});
    if (body.joint_count() != 24 && warnings)
        warnings->push_back(folder.string() + ": its poses were fitted to SMPL, the body has " +
                            std::to_string(body.joint_count()) +
                            " joints elsewhere; take an SMPL body, or give SMPL-X fits as smplx.npz");
    return MotionReader<MotionTable>(std::move(table), body, {hands, 30}, warnings).read();
}

} // namespace gsh::detail
