// SPDX-License-Identifier: Apache-2.0
/// @file  Reads reconstructions of COLMAP: cameras, images and points, binary or text.
#pragma once

#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/colmap_file.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// One registered image: its file name and its posed camera.
struct ColmapImage {
    std::string name;                             ///< relative to the folder of images
    Camera<double> camera;                        ///< of the original photograph
    std::optional<Distortion<double>> distortion; ///< empty for SIMPLE_PINHOLE and PINHOLE, or if it is all zero
};

/// A reconstruction by COLMAP's mapper.
///
/// Shapes  images in the order of their names; points, colors [N] in the order of their ids.
/// Frame   x_cam = R x_world + t, x right, y down, z forward; the image's corner is (0, 0). These are our conventions.
/// Units   the reconstruction's own; display-referred sRGB in [0, 1].
struct ColmapScene {
    std::vector<ColmapImage> images;
    std::vector<vec3<double>> points, colors;
};

/// Reads cameras, images and points3D (.bin, or else .txt) of a folder, of its sparse/0 or of its sparse. Features and
/// tracks are skipped. Supported camera models: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV.
///
/// Errors  IoError for a file that is missing, truncated or has excess bytes; ValueError for another camera model, an
///         invalid camera or rotation, or numbers that are not finite. Messages name file and entry.
/// Source  COLMAP's documentation, "Output Format".
[[nodiscard]] inline ColmapScene read_colmap(const std::filesystem::path& folder);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A camera model and its number of parameters.
struct ColmapModel {
    std::string_view name;
    std::int32_t id;
    std::size_t parameter_count;
};
inline constexpr std::array<ColmapModel, 5> colmap_models{{{"SIMPLE_PINHOLE", 0, 3},
                                                           {"PINHOLE", 1, 4},
                                                           {"SIMPLE_RADIAL", 2, 4},
                                                           {"RADIAL", 3, 5},
                                                           {"OPENCV", 4, 8}}};

struct ColmapCamera {
    Camera<double> camera; // the pose is not set
    std::optional<Distortion<double>> distortion;
};

inline ColmapCamera colmap_camera(const std::string& where, const ColmapModel& model, std::uint64_t width,
                                  std::uint64_t height, const std::vector<double>& p) {
    constexpr std::uint64_t most = 1 << 20; // pixels a side
    check_value(width > 0 && height > 0 && width <= most && height <= most, where,
                "has images of " + std::to_string(width) + " x " + std::to_string(height) + " pixels");
    check_finite(where, "parameters", Span<const double>(p));
    ColmapCamera result;
    Camera<double>& c = result.camera;
    c.width = static_cast<int>(width), c.height = static_cast<int>(height);
    const bool two = model.name == "PINHOLE" || model.name == "OPENCV"; // focal lengths
    std::size_t next = 0;
    c.fx = p[next++];
    c.fy = two ? p[next++] : c.fx;
    c.cx = p[next++];
    c.cy = p[next++];
    Distortion<double> d;
    for (double* k : {&d.k1, &d.k2, &d.p1, &d.p2})
        if (next < p.size()) *k = p[next++];
    if (d.k1 != 0 || d.k2 != 0 || d.p1 != 0 || d.p2 != 0) result.distortion = d;
    check_camera(where, "camera", c);
    return result;
}

/// Sets the pose from a quaternion and a translation, x_cam = R x_world + t.
inline void set_colmap_pose(const std::string& where, Camera<double>& camera, const std::array<double, 7>& v) {
    check_finite(where, "pose", Span<const double>(v));
    const quat<double> q{v[0], v[1], v[2], v[3]};
    check_value(dot(q, q) > 1e-12 && dot(q, q) < 1e12, where,
                "has a quaternion of length " + number_text(std::sqrt(dot(q, q))));
    camera.R = rotation_matrix(normalize(q));
    camera.t = {v[4], v[5], v[6]};
}

using ColmapCameras = std::map<std::uint32_t, ColmapCamera>;

inline ColmapImage colmap_image(const std::string& where, const ColmapCameras& cameras, std::uint32_t camera_id,
                                std::string name, const std::array<double, 7>& pose) {
    check_value(stays_inside(name), where,
                "has the name '" + shortened(name) + "', which leads out of the folder of images");
    check_printable_name(name, where);
    const auto camera = cameras.find(camera_id);
    check_value(camera != cameras.end(), where,
                "is of camera " + std::to_string(camera_id) + ", which the list of cameras lacks");
    ColmapImage image{std::move(name), camera->second.camera, camera->second.distortion};
    set_colmap_pose(where, image.camera, pose);
    return image;
}

struct ColmapPoint {
    std::uint64_t id;
    vec3<double> position, color;
};

inline ColmapPoint colmap_point(const std::string& where, std::uint64_t id, const vec3<double>& position,
                                const std::array<int, 3>& rgb) {
    check_value(std::isfinite(position.x) && std::isfinite(position.y) && std::isfinite(position.z), where,
                "has a coordinate that is not finite");
    return {id, position, vec3<double>(rgb[0], rgb[1], rgb[2]) / 255.0};
}

inline std::pair<std::uint32_t, ColmapCamera> read_camera_entry(ColmapBytes& file) {
    const auto id = file.next<std::uint32_t>();
    const auto model_id = file.next<std::int32_t>();
    const std::string where = file.where("camera " + std::to_string(id));
    const auto model =
        std::find_if(colmap_models.begin(), colmap_models.end(), [&](const auto& m) { return m.id == model_id; });
    check_value(model != colmap_models.end(), where,
                "has model " + std::to_string(model_id) +
                    ", expected SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or "
                    "OPENCV (0 to 4); run COLMAP's image_undistorter");
    const auto width = file.next<std::uint64_t>(), height = file.next<std::uint64_t>();
    std::vector<double> parameters(model->parameter_count);
    for (double& p : parameters) p = file.next<double>();
    return {id, colmap_camera(where, *model, width, height, parameters)};
}

inline std::pair<std::uint32_t, ColmapCamera> read_camera_entry(ColmapLines& file) {
    const auto id = file.number<std::uint32_t>();
    const std::string_view name = file.word();
    const auto model =
        std::find_if(colmap_models.begin(), colmap_models.end(), [&](const auto& m) { return m.name == name; });
    check_value(model != colmap_models.end(), file.where(),
                "has model " + shortened(name) +
                    ", expected SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV; "
                    "run COLMAP's image_undistorter");
    const auto width = file.number<std::uint64_t>(), height = file.number<std::uint64_t>();
    std::vector<double> parameters(model->parameter_count);
    for (double& p : parameters) p = file.number<double>();
    if (file.has_more()) file.fail("has more parameters than " + std::string(model->name));
    return {id, colmap_camera(file.where(), *model, width, height, parameters)};
}

inline ColmapScene read_colmap_binary(const std::filesystem::path& folder) {
    ColmapScene scene;
    ColmapCameras cameras;
    ColmapBytes camera_file(folder / "cameras.bin");
    for (auto left = camera_file.count(48); left > 0; --left) cameras.insert(read_camera_entry(camera_file));
    camera_file.finish();

    ColmapBytes image_file(folder / "images.bin");
    for (auto left = image_file.count(73); left > 0; --left) {
        const auto id = image_file.next<std::uint32_t>();
        std::array<double, 7> pose;
        for (double& number : pose) number = image_file.next<double>();
        const auto camera = image_file.next<std::uint32_t>();
        std::string name = image_file.text();
        const std::string where = image_file.where("image " + std::to_string(id) + " (" + shortened(name) + ")");
        scene.images.push_back(colmap_image(where, cameras, camera, std::move(name), pose));
        image_file.skip(image_file.next<std::uint64_t>(), 24); // features: x, y, id of the point
    }
    image_file.finish();

    std::vector<ColmapPoint> points;
    ColmapBytes point_file(folder / "points3D.bin");
    for (auto left = point_file.count(51); left > 0; --left) {
        const auto id = point_file.next<std::uint64_t>();
        vec3<double> position;
        for (int k = 0; k < 3; ++k) position[k] = point_file.next<double>();
        std::array<int, 3> rgb;
        for (int& channel : rgb) channel = point_file.next<std::uint8_t>();
        (void)point_file.next<double>(); // reprojection error
        points.push_back(colmap_point(point_file.where("point " + std::to_string(id)), id, position, rgb));
        point_file.skip(point_file.next<std::uint64_t>(), 8); // track: image, feature
    }
    point_file.finish();
    std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
    for (const ColmapPoint& point : points) scene.points.push_back(point.position), scene.colors.push_back(point.color);
    return scene;
}

inline ColmapScene read_colmap_text(const std::filesystem::path& folder) {
    ColmapScene scene;
    ColmapCameras cameras;
    for (ColmapLines file(folder / "cameras.txt"); file.next();) cameras.insert(read_camera_entry(file));

    for (ColmapLines file(folder / "images.txt"); file.next(); file.skip()) { // features are on a line of their own
        (void)file.number<std::uint32_t>();
        std::array<double, 7> pose;
        for (double& number : pose) number = file.number<double>();
        const auto camera = file.number<std::uint32_t>();
        scene.images.push_back(colmap_image(file.where(), cameras, camera, file.remainder(), pose));
    }

    std::vector<ColmapPoint> points;
    for (ColmapLines file(folder / "points3D.txt"); file.next();) {
        const auto id = file.number<std::uint64_t>();
        vec3<double> position;
        for (int k = 0; k < 3; ++k) position[k] = file.number<double>();
        std::array<int, 3> rgb;
        for (int& channel : rgb) {
            channel = file.number<int>();
            check_value(channel >= 0 && channel <= 255, file.where(), "has a colour outside 0 to 255");
        }
        points.push_back(colmap_point(file.where(), id, position, rgb));
    }
    std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
    for (const ColmapPoint& point : points) scene.points.push_back(point.position), scene.colors.push_back(point.color);
    return scene;
}

} // namespace detail

inline ColmapScene read_colmap(const std::filesystem::path& folder) {
    std::error_code ignored;
    for (const auto& place : {folder, folder / "sparse" / "0", folder / "sparse"}) {
        const bool binary = std::filesystem::exists(place / "cameras.bin", ignored);
        if (!binary && !std::filesystem::exists(place / "cameras.txt", ignored)) continue;
        ColmapScene scene = binary ? detail::read_colmap_binary(place) : detail::read_colmap_text(place);
        check_value(!scene.images.empty(), place.string(), "holds no registered image");
        std::sort(scene.images.begin(), scene.images.end(),
                  [](const auto& a, const auto& b) { return a.name < b.name; });
        for (std::size_t i = 1; i < scene.images.size(); ++i)
            check_value(scene.images[i].name != scene.images[i - 1].name, place.string(),
                        "holds the image '" + detail::shortened(scene.images[i].name) + "' twice");
        return scene;
    }
    throw IoError(folder.string() + ": holds neither cameras.bin nor cameras.txt, nor does its sparse/0 or sparse; "
                                    "expected a reconstruction of COLMAP");
}

} // namespace gsh
