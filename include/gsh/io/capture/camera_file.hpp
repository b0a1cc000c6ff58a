// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes calibrated cameras as JSON: a single camera, or the list of a capture.
#pragma once

#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/foreign_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A camera of a capture. If `distortion` is empty, its images are free of distortion.
struct NamedCamera {
    enum class Role { train, test };

    std::string name;
    Role role = Role::train;
    Camera<double> camera;
    std::optional<Distortion<double>> distortion; ///< of the photographs, if they are not undistorted yet
};

/// The contents of a capture's `cameras.json`.
struct CameraList {
    std::vector<NamedCamera> cameras;
    double fps = 0;                ///< frames per second; 0 if the file does not give it
    std::optional<double> floor_y; ///< height of the floor, metres
    std::vector<int> test_frames;  ///< excluded from training in every camera
};

/// Reads {"cameras": [...], "fps", "floor_y", "test_frames"}, or a list of cameras alone.
///
/// A camera has K, R (3x3, row by row), t, width, height, and optionally name, role ("train", "test") and distortion
/// [k1, k2, p1, p2, k3]; x_cam = R x_world + t, OpenCV axes. Other entries beside the list are ignored.
///
/// Errors  IoError for a file that is missing or truncated, and for a camera with a missing or unknown field;
///         ValueError for numbers that do not form a camera: a singular K, skew, an R that is not a rotation. Messages
///         name the file, the camera and the field.
[[nodiscard]] inline CameraList read_cameras(const std::filesystem::path& path);

/// Reads one camera: from a file with a single entry, or the entry `name` of a list (if `name` is empty, the only one).
[[nodiscard]] inline NamedCamera read_camera(const std::filesystem::path& path, std::string_view name = {});

inline void write_cameras(const std::filesystem::path& path, const CameraList& list);
inline void write_camera(const std::filesystem::path& path, const NamedCamera& camera);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

using Json = nlohmann::ordered_json;

inline Json read_json(const std::filesystem::path& path) {
    constexpr std::size_t largest = std::size_t(1) << 26; // bytes: a thousand cameras take 1 MiB
    const std::string text = read_file(path, largest);
    try {
        return Json::parse(text);
    } catch (const nlohmann::json::exception& error) {
        const std::string own = std::string("is not JSON, or truncated: ") + error.what();
        throw IoError(path.string() + ": " + (text.empty() ? own : not_the_kind(path, "JSON", "json", own)));
    }
}

/// A JSON object and its place in the file, for messages.
class JsonObject {
public:
    JsonObject(const Json& json, std::string where) : json_(json), where_(std::move(where)) {
        if (!json_.is_object()) throw IoError(where_ + " is " + json_.type_name() + ", expected an object");
    }
    [[nodiscard]] bool has(const char* field) const { return json_.contains(field) && !json_[field].is_null(); }
    [[nodiscard]] const Json& at(const char* field) const {
        if (!has(field)) throw IoError(where_ + ": " + field + " is missing");
        return json_[field];
    }
    [[nodiscard]] double number(const char* field) const {
        const Json& value = at(field);
        if (!value.is_number()) throw wrong(field, value, "a number");
        return finite(field, value.get<double>());
    }
    [[nodiscard]] int integer(const char* field) const { return integer(field, at(field)); }
    [[nodiscard]] std::string text(const char* field) const {
        const Json& value = at(field);
        if (!value.is_string()) throw wrong(field, value, "text");
        return value.get<std::string>();
    }
    /// The numbers of a list, or of a list of rows.
    [[nodiscard]] std::vector<double> numbers(const char* field) const {
        std::vector<double> values;
        gather(field, at(field), values, 2);
        return values;
    }
    [[nodiscard]] std::vector<double> numbers(const char* field, std::size_t count) const {
        std::vector<double> values = numbers(field);
        if (values.size() != count)
            throw ShapeError(where_ + ": " + field + " has " + std::to_string(values.size()) + " numbers, expected " +
                             std::to_string(count));
        return values;
    }
    [[nodiscard]] std::vector<int> integers(const char* field) const {
        const Json& list = at(field);
        if (!list.is_array()) throw wrong(field, list, "a list of integers");
        std::vector<int> values;
        for (const Json& value : list) values.push_back(integer(field, value));
        return values;
    }
    [[nodiscard]] const std::string& where() const { return where_; }

    /// Throws IoError for an unknown field, which may be misspelt.
    void expect_only(std::initializer_list<std::string_view> known) const {
        for (const auto& item : json_.items()) {
            if (std::find(known.begin(), known.end(), item.key()) != known.end()) continue;
            std::string all;
            for (const std::string_view field : known) all.append(all.empty() ? "" : ", ").append(field);
            throw IoError(where_ + ": holds the unknown field '" + item.key() + "', expected " + all);
        }
    }

private:
    const Json& json_;
    std::string where_;

    [[nodiscard]] IoError wrong(const char* field, const Json& value, const char* expected) const {
        return IoError(where_ + ": " + field + " is " + value.type_name() + ", expected " + expected);
    }
    [[nodiscard]] double finite(const char* field, double value) const {
        check_value(std::isfinite(value), where_, std::string(field) + " is not finite");
        return value;
    }
    [[nodiscard]] int integer(const char* field, const Json& value) const {
        if (!value.is_number_integer()) throw wrong(field, value, "an integer");
        const double number = value.get<double>();
        check_value(std::abs(number) <= 2147483647, where_, std::string(field) + " is beyond 32 bits");
        return static_cast<int>(number);
    }
    void gather(const char* field, const Json& value, std::vector<double>& values, int levels) const {
        if (value.is_number()) {
            values.push_back(finite(field, value.get<double>()));
        } else if (value.is_array() && levels > 0) {
            for (const Json& element : value) gather(field, element, values, levels - 1);
        } else {
            throw wrong(field, value, "numbers");
        }
    }
};

inline std::string matrix_text(const std::vector<double>& m) {
    std::string text = "[";
    for (std::size_t i = 0; i < m.size(); ++i) text += (i == 0 ? "" : i % 3 ? ", " : "; ") + Json(m[i]).dump();
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
    const JsonObject object(json, where + (result.name.empty() ? "" : " '" + result.name + "'"));
    if (object.has("role")) {
        const std::string role = object.text("role");
        check_value(role == "train" || role == "test", object.where(),
                    "role is '" + role + "', expected train or test");
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
    for (std::size_t i = 0; i < list.size(); ++i) {
        const std::string where = name + ": cameras[" + std::to_string(i) + "]";
        NamedCamera camera = read_camera_entry(list[i], where);
        if (camera.name.empty()) throw IoError(where + ": name is missing");
        // The name is also the name of a folder.
        if (camera.name == "." || camera.name == ".." || camera.name.find('/') != std::string::npos)
            throw ValueError(where + ": name is '" + camera.name + "', expected a plain folder name");
        for (const NamedCamera& other : result.cameras)
            check_value(other.name != camera.name, where, "name '" + camera.name + "' stands there twice");
        result.cameras.push_back(std::move(camera));
    }
    if (bare) return result;
    const JsonObject object(json, name);
    if (object.has("fps")) {
        result.fps = object.number("fps");
        check_value(result.fps > 0, name, "fps is " + std::to_string(result.fps) + ", expected a positive number");
    }
    if (object.has("floor_y")) result.floor_y = object.number("floor_y");
    if (object.has("test_frames")) result.test_frames = object.integers("test_frames");
    for (const int frame : result.test_frames)
        check_value(frame >= 0, name, "test_frames holds " + std::to_string(frame) + ", expected frame numbers from 0");
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

inline CameraList read_cameras(const std::filesystem::path& path) {
    return detail::read_camera_list(detail::read_json(path), path.string());
}

inline NamedCamera read_camera(const std::filesystem::path& path, std::string_view name) {
    const detail::Json json = detail::read_json(path);
    if (json.is_object() && !json.contains("cameras")) {
        NamedCamera camera = detail::read_camera_entry(json, path.string());
        if (!name.empty() && camera.name != name)
            throw IoError(path.string() + ": holds the camera '" + camera.name + "', not '" + std::string(name) + "'");
        return camera;
    }
    CameraList list = detail::read_camera_list(json, path.string());
    if (name.empty() && list.cameras.size() == 1) return std::move(list.cameras[0]);
    std::string known;
    for (NamedCamera& camera : list.cameras) {
        if (camera.name == name) return std::move(camera);
        known += (known.empty() ? "" : ", ") + camera.name;
    }
    throw IoError(path.string() + ": holds " + std::to_string(list.cameras.size()) + " cameras, " +
                  (name.empty() ? std::string("name one of them") : "none called '" + std::string(name) + "'") + ": " +
                  known);
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
