// SPDX-License-Identifier: Apache-2.0
/// @file  A scene in EasyMocap's folders, written file by file.
#pragma once

#include "io/sample_files.hpp"

#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <cstddef>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

namespace gsh::test {

/// EasyMocap stores n numbers as (1, n).
inline detail::Json row(const std::vector<double>& numbers) { return detail::Json::array({numbers}); }

inline void write_people(const std::filesystem::path& folder, int frame, const detail::Json& people) {
    std::filesystem::create_directories(folder);
    write_text(folder / (padded(frame, 6) + ".json"), people.dump(4));
}

/// A photograph and its mask.
inline void write_view(const std::filesystem::path& scene, const std::string& camera, int frame,
                       const PixelImage& rgba) {
    const auto file = [&](const char* kind) {
        std::filesystem::create_directories(scene / kind / camera);
        return scene / kind / camera / (padded(frame, 6) + ".png");
    };
    write_png(file("images"), colors_of(rgba));
    write_png(file("mask"), mask_of(rgba));
}

/// intri.yml and extri.yml as OpenCV writes them: matrices row by row, pixels counted from the centre of the first one.
inline void write_opencv_cameras(const std::filesystem::path& scene, const std::vector<NamedCamera>& cameras) {
    std::ostringstream intrinsics, extrinsics;
    const auto matrix = [](std::ostringstream& out, const std::string& name, int rows, int columns,
                           const std::vector<double>& data) {
        out << name << ": !!opencv-matrix\n  rows: " << rows << "\n  cols: " << columns << "\n  dt: d\n  data: [";
        for (std::size_t i = 0; i < data.size(); ++i) out << (i ? ", " : "") << data[i];
        out << "]\n";
    };
    for (std::ostringstream* out : {&intrinsics, &extrinsics}) {
        out->precision(17);
        *out << "%YAML:1.0\n---\nnames:\n";
        for (const NamedCamera& named : cameras) *out << "  - \"" << named.name << "\"\n";
    }
    for (const auto& [name, role, c, distortion] : cameras) {
        const mat3<double> R = transpose(c.R); // by rows
        matrix(intrinsics, "K_" + name, 3, 3, {c.fx, 0, c.cx - 0.5, 0, c.fy, c.cy - 0.5, 0, 0, 1});
        matrix(extrinsics, "Rot_" + name, 3, 3,
               {R[0].x, R[0].y, R[0].z, R[1].x, R[1].y, R[1].z, R[2].x, R[2].y, R[2].z});
        matrix(extrinsics, "T_" + name, 3, 1, {c.t.x, c.t.y, c.t.z});
    }
    write_text(scene / "intri.yml", intrinsics.str());
    write_text(scene / "extri.yml", extrinsics.str());
}

} // namespace gsh::test
