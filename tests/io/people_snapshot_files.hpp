// SPDX-License-Identifier: Apache-2.0
/// @file  A subject of PeopleSnapshot in the form that InstantAvatar's preprocessing writes.
#pragma once

#include "io/sample_files.hpp"

#include <gsh/camera/pinhole.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/image/image_file.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::test {

/// A subject's folder, file by file, with SMPL poses of all frames of the video.
struct PeopleSnapshotFiles {
    Temporary folder;
    std::filesystem::path path = folder / "anna";
    std::vector<double> thetas, transl; // [F, 72], [F, 3]

    PeopleSnapshotFiles() {
        for (const char* name : {"images", "masks", "poses"}) std::filesystem::create_directories(path / name);
    }
    [[nodiscard]] std::filesystem::path image(int f) const {
        return path / "images" / ("image_" + padded(f) + ".png");
    }
    [[nodiscard]] std::filesystem::path mask_file(int f) const {
        return path / "masks" / ("mask_" + padded(f) + ".npy");
    }
    /// Pixels count from the centre of the first one.
    void write_camera(const Camera<double>& c) const {
        const mat3<double> R = transpose(c.R); // by rows
        NpzWriter file(path / "cameras.npz");
        file.add("intrinsic", std::vector<double>{c.fx, 0, c.cx - 0.5, 0, c.fy, c.cy - 0.5, 0, 0, 1}, {3, 3});
        std::vector<double> extrinsic;
        for (int i = 0; i < 3; ++i) extrinsic.insert(extrinsic.end(), {R[i].x, R[i].y, R[i].z, c.t[i]});
        extrinsic.insert(extrinsic.end(), {0, 0, 0, 1});
        file.add("extrinsic", extrinsic, {4, 4});
        file.add("height", std::int64_t(c.height));
        file.add("width", std::int64_t(c.width));
        file.commit();
    }
    /// Masks are 0 and 1.
    void write_photo(int f, const PixelImage& rgba) const {
        write_png(image(f), colors_of(rgba));
        std::vector<std::uint8_t> mask = mask_of(rgba).data;
        for (std::uint8_t& pixel : mask) pixel /= 255;
        write_array(mask_file(f), mask, {static_cast<std::size_t>(rgba.height), static_cast<std::size_t>(rgba.width)});
    }
    /// The poses of all frames.
    void write_all(double beta) const {
        NpzWriter file(path / "poses.npz");
        add_floats(file, "betas", std::vector<double>(10, beta), {10});
        add_floats(file, "thetas", thetas, {thetas.size() / 72, 72});
        add_floats(file, "transl", transl, {transl.size() / 3, 3});
        file.commit();
    }
    /// The poses of these frames. Refined poses differ from the others by a shift.
    void write_split(const std::string& name, const std::vector<int>& frames, double beta, double shift) const {
        std::vector<double> root, rest, shifted;
        for (const int f : frames) {
            const auto row = static_cast<std::size_t>(f);
            root.insert(root.end(), &thetas[72 * row], &thetas[72 * row] + 3);
            rest.insert(rest.end(), &thetas[72 * row] + 3, &thetas[72 * row] + 72);
            for (std::size_t k = 0; k < 3; ++k) shifted.push_back(transl[3 * row + k] + shift);
        }
        NpzWriter file(path / "poses" / name);
        add_floats(file, "betas", std::vector<double>(10, beta), {1, 10});
        add_floats(file, "global_orient", root, {frames.size(), 3});
        add_floats(file, "body_pose", rest, {frames.size(), 69});
        add_floats(file, "transl", shifted, {frames.size(), 3});
        file.commit();
    }
};

} // namespace gsh::test
