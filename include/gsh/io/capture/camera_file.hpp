// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes calibrated cameras as JSON: a single camera, or the list of a capture.
#pragma once

#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/named_path.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Reads {"cameras": [...], "fps", "floor_y", "test_frames"}, or a list of cameras alone.
///
/// A camera has K, R (3x3, row by row), t, width, height, and optionally name, role ("train", "test") and distortion
/// [k1, k2, p1, p2, k3]; x_cam = R x_world + t, OpenCV axes. Other entries beside the list are ignored.
///
/// Errors  IoError for a file that is missing or truncated, and for a camera with a missing or unknown field;
///         ValueError for numbers that do not form a camera: a singular K, skew, an R that is not a rotation. Messages
///         name the file, the camera and the field.
[[nodiscard]] inline CameraList read_cameras(const InputFile& input);

/// Reads one camera: from a file with a single entry, or the entry `name` of a list (if `name` is empty, the only one).
[[nodiscard]] inline NamedCamera read_camera(const InputFile& input, std::string_view name = {});

inline void write_cameras(const std::filesystem::path& path, const CameraList& list);
inline void write_camera(const std::filesystem::path& path, const NamedCamera& camera);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline std::string matrix_text(const std::vector<double>& m) {
    std::string text = "[";
    for (std::size_t i = 0; i < m.size(); ++i) text += (i == 0 ? "" : i % 3 ? ", " : "; ") + number_text(m[i]);
    return text + "]";
}

inline void read_intrinsics(const JsonObject& json, Camera<double>& camera) {
    const std::vector<double> K = json.numbers("K", 9);
    const auto expect = [&](bool condition, const char* reason) {
        check_value(condition, json.where(), "K " + std::string(reason) + ", found " + matrix_text(K));
    };
    const double determinant =
        K[0] * (K[4] * K[8] - K[5] * K[7]) - K[1] * (K[3] * K[8] - K[5] * K[6]) + K[2] * (K[3] * K[7] - K[4] * K[6]);
    expect(std::abs(determinant) > 1e-9, "is singular, expected [fx, 0, cx; 0, fy, cy; 0, 0, 1]");
    expect(K[6] == 0 && K[7] == 0 && K[8] == 1, "must end in the row 0, 0, 1");
    expect(K[0] > 0 && K[4] > 0, "must hold positive focal lengths");
    expect(std::abs(K[1]) <= 1e-6 * K[0] && std::abs(K[3]) <= 1e-6 * K[4],
           "holds a skew, which our cameras lack; resample the images without it");
    camera.fx = K[0], camera.fy = K[4], camera.cx = K[2], camera.cy = K[5];
}

inline void read_extrinsics(const JsonObject& json, Camera<double>& camera) {
    const std::vector<double> R = json.numbers("R", 9), t = json.numbers("t", 3);
    camera.R =
        mat3<double>(vec3<double>(R[0], R[3], R[6]), vec3<double>(R[1], R[4], R[7]), vec3<double>(R[2], R[5], R[8]));
    camera.t = {t[0], t[1], t[2]};
    double deviation = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) deviation = std::max(deviation, std::abs(dot(camera.R[i], camera.R[j]) - (i == j)));
    check_value(deviation <= 1e-3, json.where(),
                "R is not a rotation (its columns are not orthonormal within 1e-3), found " + matrix_text(R));
    check_value(determinant(camera.R) > 0, json.where(),
                "R mirrors (determinant -1), expected a rotation; found " + matrix_text(R));
}

inline NamedCamera read_camera_entry(const Json& json, const std::string& where) {
    NamedCamera result;
    const JsonObject unnamed(json, where);
    if (unnamed.has("name")) result.name = unnamed.text("name");
    const JsonObject object(json, where + (result.name.empty() ? "" : " '" + shortened(result.name) + "'"));
    if (object.has("role")) {
        const std::string role = object.text("role");
        check_value(role == "train" || role == "test", object.where(),
                    "role is '" + shortened(role) + "', expected train or test");
        result.role = role == "test" ? NamedCamera::Role::test : NamedCamera::Role::train;
    }
    Camera<double>& camera = result.camera;
    camera.width = object.integer("width");
    camera.height = object.integer("height");
    constexpr std::int64_t most = std::int64_t(1) << 26; // pixels, as for image files
    check_value(camera.width > 0 && camera.height > 0 && std::int64_t(camera.width) * camera.height <= most,
                object.where(),
                "width x height is " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    ", expected at least 1 each and at most " + std::to_string(most) + " pixels in all");
    read_intrinsics(object, camera);
    read_extrinsics(object, camera);
    if (object.has("distortion")) {
        const std::vector<double> d = object.numbers("distortion", 5);
        if (std::any_of(d.begin(), d.end(), [](double value) { return value != 0; })) {
            result.distortion = Distortion<double>{d[0], d[1], d[2], d[3], d[4]};
            check_distortion(object.where(), "camera", camera, *result.distortion);
        }
    }
    object.expect_only({"name", "role", "width", "height", "K", "R", "t", "distortion"});
    return result;
}

inline CameraList read_camera_list(const Json& json, const std::string& name) {
    CameraList result;
    const bool bare = json.is_array();
    const Json& list = bare ? json : JsonObject(json, name).at("cameras");
    if (!list.is_array() || list.empty()) throw IoError(name + ": cameras must be a list with at least one camera");
    std::set<std::string> names;
    for (std::size_t i = 0; i < list.size(); ++i) {
        const std::string where = name + ": cameras[" + std::to_string(i) + "]";
        NamedCamera camera = read_camera_entry(list[i], where);
        if (camera.name.empty()) throw IoError(where + ": name is missing");
        // The name is also the name of a folder.
        if (!is_plain_name(camera.name))
            throw ValueError(where + ": name is '" + shortened(camera.name) + "', expected a plain folder name");
        check_value(names.insert(camera.name).second, where,
                    "name '" + shortened(camera.name) + "' stands there twice");
        result.cameras.push_back(std::move(camera));
    }
    if (bare) return result;
    const JsonObject object(json, name);
    if (object.has("fps")) {
        result.fps = object.number("fps");
        check_value(result.fps > 0, name, "fps is " + number_text(result.fps) + ", expected a positive number");
    }
    if (object.has("floor_y")) result.floor_y = object.number("floor_y");
    if (object.has("test_frames")) result.test_frames = object.integers("test_frames");
    std::set<int> seen;
    for (const int frame : result.test_frames)
        check_value(frame >= 0 && seen.insert(frame).second, name,
                    "test_frames holds " + std::to_string(frame) + (frame < 0 ? "" : " twice") +
                        ", expected frame numbers from 0, each once");
    return result;
}

inline Json camera_json(const NamedCamera& named) {
    const Camera<double>& c = named.camera;
    Json json;
    if (!named.name.empty()) json["name"] = named.name;
    json["role"] = named.role == NamedCamera::Role::test ? "test" : "train";
    json["width"] = c.width;
    json["height"] = c.height;
    json["K"] = {{c.fx, 0.0, c.cx}, {0.0, c.fy, c.cy}, {0.0, 0.0, 1.0}};
    json["R"] = {{c.R[0].x, c.R[1].x, c.R[2].x}, {c.R[0].y, c.R[1].y, c.R[2].y}, {c.R[0].z, c.R[1].z, c.R[2].z}};
    json["t"] = {c.t.x, c.t.y, c.t.z};
    if (const auto& d = named.distortion) json["distortion"] = {d->k1, d->k2, d->p1, d->p2, d->k3};
    return json;
}

} // namespace detail

inline CameraList read_cameras(const InputFile& input) {
    return detail::read_camera_list(detail::read_json(input, "cameras"), input.name());
}

inline NamedCamera read_camera(const InputFile& input, std::string_view name) {
    const detail::Json json = detail::read_json(input, "cameras");
    if (json.is_object() && !json.contains("cameras")) {
        NamedCamera camera = detail::read_camera_entry(json, input.name());
        if (!name.empty() && camera.name != name)
            throw IoError(input.name() + ": holds the camera '" + detail::shortened(camera.name) + "', not '" +
                          std::string(name) + "'");
        return camera;
    }
    CameraList list = detail::read_camera_list(json, input.name());
    if (name.empty() && list.cameras.size() == 1) return std::move(list.cameras[0]);
    std::vector<std::string> known;
    for (NamedCamera& camera : list.cameras) {
        if (camera.name == name) return std::move(camera);
        known.push_back(camera.name);
    }
    throw IoError(input.name() + ": holds " + std::to_string(list.cameras.size()) + " cameras, " +
                  (name.empty() ? std::string("name one of them") : "none called '" + std::string(name) + "'") + ": " +
                  detail::listed(known, "none"));
}

inline void write_cameras(const std::filesystem::path& path, const CameraList& list) {
    detail::Json json;
    if (list.fps > 0) json["fps"] = list.fps;
    if (list.floor_y) json["floor_y"] = *list.floor_y;
    if (!list.test_frames.empty()) json["test_frames"] = list.test_frames;
    json["cameras"] = detail::Json::array();
    for (const NamedCamera& camera : list.cameras) json["cameras"].push_back(detail::camera_json(camera));
    write_file(path, json.dump(1) + "\n");
}

inline void write_camera(const std::filesystem::path& path, const NamedCamera& camera) {
    write_file(path, detail::camera_json(camera).dump(1) + "\n");
}

} // namespace gsh
