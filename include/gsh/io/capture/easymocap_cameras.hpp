// SPDX-License-Identifier: Apache-2.0
/// @file  Reads EasyMocap's calibration, OpenCV's YAML.
#pragma once

#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/file/opencv_yaml.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Reads FOLDER/intri.yml (K_NAME, dist_NAME or D_NAME; H_NAME, W_NAME) and FOLDER/extri.yml (Rot_NAME or R_NAME,
/// T_NAME), for each of intri.yml's `names`. If a file does not give the image's size, width and height are 0 and must
/// be set from the images.
///
/// Units   EasyMocap's T has the unit of its calibration board, usually metres. The origin of its pixel coordinates is
///         the centre of the first pixel, ours is the image's corner. Half a pixel is therefore added to the principal
///         point.
/// Errors  IoError for a file that is missing or lacks an entry; ValueError for an invalid camera.
[[nodiscard]] inline CameraList read_easymocap_cameras(const std::filesystem::path& folder) {
    const OpenCvYaml intrinsics(folder / "intri.yml"), extrinsics(folder / "extri.yml");
    CameraList list;
    std::set<std::string> names;
    for (const std::string& name : intrinsics.texts("names")) {
        check_value(detail::is_plain_name(name), intrinsics.name_of("names"),
                    "holds '" + detail::shortened(name) + "', expected a plain folder name");
        check_value(names.insert(name).second, intrinsics.name_of("names"),
                    "holds '" + detail::shortened(name) + "' twice");
        NamedCamera named;
        named.name = name;
        Camera<double>& camera = named.camera;
        std::vector<double> K = intrinsics.matrix("K_" + name, 9);
        K[2] += 0.5, K[5] += 0.5;
        if (intrinsics.has("W_" + name) && intrinsics.has("H_" + name)) {
            const double width = intrinsics.number("W_" + name), height = intrinsics.number("H_" + name);
            check_value(width >= 1 && height >= 1 && width <= 65535 && height <= 65535 && width == std::floor(width) &&
                            height == std::floor(height),
                        intrinsics.name_of("W_" + name),
                        "and H_ are " + detail::number_text(width) + " x " + detail::number_text(height) +
                            ", expected pixels");
            camera.width = static_cast<int>(width), camera.height = static_cast<int>(height);
        }
        mat3<double> R;
        if (extrinsics.has("Rot_" + name)) {
            const std::vector<double> m = extrinsics.matrix("Rot_" + name, 9);
            R = mat3<double>(vec3<double>(m[0], m[3], m[6]), vec3<double>(m[1], m[4], m[7]),
                             vec3<double>(m[2], m[5], m[8]));
        } else {
            const std::vector<double> v = extrinsics.matrix("R_" + name, 3);
            R = rotation_from_axis_angle(vec3<double>(v[0], v[1], v[2]));
        }
        const std::vector<double> t = extrinsics.matrix("T_" + name, 3);
        // The size may be set later from the images; the check accepts any positive size.
        const int width = camera.width, height = camera.height;
        camera = camera_from_K<double>(K, R, vec3<double>(t[0], t[1], t[2]), width > 0 ? width : 1,
                                       height > 0 ? height : 1, folder.string() + ": " + name);
        camera.width = width, camera.height = height;
        std::vector<double> d;
        for (const char* prefix : {"dist_", "D_"})
            if (d.empty() && intrinsics.has(prefix + name)) d = intrinsics.matrix(prefix + name, 0);
        while (d.size() > 5 && d.back() == 0) d.pop_back(); // OpenCV's models of 8, 12 and 14 numbers
        if (!d.empty() && d.size() != 4 && d.size() != 5)
            throw ShapeError(intrinsics.name_of("dist_" + name) + " has " + std::to_string(d.size()) +
                             " numbers, expected k1, k2, p1, p2, k3, and zeros after them");
        d.resize(5, 0.0);
        if (std::any_of(d.begin(), d.end(), [](double value) { return value != 0; }))
            named.distortion = Distortion<double>{d[0], d[1], d[2], d[3], d[4]};
        list.cameras.push_back(std::move(named));
    }
    if (list.cameras.empty()) throw IoError(intrinsics.name_of("names") + " lists no camera");
    return list;
}

} // namespace gsh
