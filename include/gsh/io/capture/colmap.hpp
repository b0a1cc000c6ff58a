// SPDX-License-Identifier: Apache-2.0
/// @file  Reads reconstructions of COLMAP: cameras, images and points, binary or text.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
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

/// The pinhole camera of the undistorted image: the same pose and focal lengths, and the largest image rectangle inside
/// the undistorted borders, so that no pixel lies outside the photograph.
///
/// Errors  ValueError if the distortion has no inverse at the border, or the image would be empty.
[[nodiscard]] inline Camera<double> straight_camera(std::string_view name, const Camera<double>& camera,
                                                    const Distortion<double>& distortion);

/// An undistorted photograph for training, with its camera.
struct StraightImage {
    PixelImage image; ///< RGBA
    Camera<double> camera;
};

/// Reads an image of the reconstruction and undistorts it. The mask is the image's alpha or, if `masks` is given, the
/// image of the same name (NAME.png, or NAME with the extension .png) in that folder. White pixels are kept.
///
/// Errors  those of read_image; ShapeError unless image and mask have the camera's size.
[[nodiscard]] inline StraightImage read_colmap_image(const ColmapImage& entry, const std::filesystem::path& images,
                                                     const std::filesystem::path& masks = {});

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
    check_value(dot(q, q) > 1e-12, where, "has a quaternion of length 0");
    camera.R = rotation_matrix(normalize(q));
    camera.t = {v[4], v[5], v[6]};
}

/// Sequential reader of a binary file.
class ColmapBytes {
public:
    explicit ColmapBytes(std::filesystem::path path)
        : path_(std::move(path)), bytes_(read_file(path_, std::size_t(1) << 34)) {}

    template <class Number>
    Number next() {
        static_assert(std::endian::native == std::endian::little);
        Number number;
        need(sizeof number);
        std::memcpy(&number, bytes_.data() + at_, sizeof number);
        at_ += sizeof number;
        return number;
    }
    std::string text() {
        const std::size_t end = bytes_.find('\0', at_);
        if (end == std::string::npos) fail("is truncated");
        std::string result = bytes_.substr(at_, end - at_);
        at_ = end + 1;
        return result;
    }
    /// Skips `count` entries of `size` bytes.
    void skip(std::uint64_t count, std::size_t size) {
        if (count > (bytes_.size() - at_) / size) fail("is truncated");
        at_ += static_cast<std::size_t>(count) * size;
    }
    /// Reads the number of entries that follow. Each takes at least `size` bytes, which is checked before any
    /// allocation.
    std::uint64_t count(std::size_t size) {
        const auto n = next<std::uint64_t>();
        if (n > (bytes_.size() - at_) / size)
            fail("claims " + std::to_string(n) + " entries of at least " + std::to_string(size) + " bytes, but " +
                 std::to_string(bytes_.size() - at_) + " bytes follow; is it truncated?");
        return n;
    }
    void finish() const {
        if (at_ != bytes_.size()) fail("goes on after its last entry; is it a file of COLMAP?");
    }
    [[nodiscard]] std::string where(const std::string& entry) const { return path_.string() + ": " + entry; }
    [[noreturn]] void fail(const std::string& what) const { throw IoError(path_.string() + ": " + what); }

private:
    void need(std::size_t size) const {
        if (size > bytes_.size() - at_) fail("is truncated");
    }
    std::filesystem::path path_;
    std::string bytes_;
    std::size_t at_ = 0;
};

/// Reads a text file line by line and word by word, without comments.
class ColmapLines {
public:
    explicit ColmapLines(std::filesystem::path path)
        : path_(std::move(path)), text_(read_file(path_, std::size_t(1) << 34)) {}

    /// Advances to the next line that is not empty; false at the end of the file.
    bool next() {
        do
            if (!advance()) return false;
        while (line_.find_first_not_of(" \t\r") == std::string_view::npos ||
               line_[line_.find_first_not_of(" \t\r")] == '#');
        rest_ = line_;
        return true;
    }
    /// Skips the next line, even if it is empty.
    void skip() { advance(); }

    std::string_view word() {
        const std::size_t begin = std::min(rest_.find_first_not_of(" \t\r"), rest_.size());
        const std::size_t end = std::min(rest_.find_first_of(" \t\r", begin), rest_.size());
        if (begin == end) fail("ends too early");
        const std::string_view result = rest_.substr(begin, end - begin);
        rest_.remove_prefix(end);
        return result;
    }
    /// The rest of the line; names of images may contain blanks.
    std::string remainder() {
        const std::size_t begin = rest_.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) fail("ends too early");
        return std::string(rest_.substr(begin, rest_.find_last_not_of(" \t\r") + 1 - begin));
    }
    [[nodiscard]] bool has_more() const { return rest_.find_first_not_of(" \t\r") != std::string_view::npos; }
    template <class Number>
    Number number() {
        const std::string_view text = word();
        Number value{};
        const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (code != std::errc() || end != text.data() + text.size())
            fail("has '" + std::string(text) + "' where a number should be");
        return value;
    }
    [[nodiscard]] std::string where() const { return path_.string() + ": line " + std::to_string(line_number_); }
    [[noreturn]] void fail(const std::string& what) const { throw IoError(where() + " " + what); }

private:
    bool advance() {
        if (at_ >= text_.size()) return false;
        const std::size_t end = std::min(text_.find('\n', at_), text_.size());
        line_ = std::string_view(text_).substr(at_, end - at_);
        at_ = end + 1;
        ++line_number_;
        return true;
    }
    std::filesystem::path path_;
    std::string text_;
    std::string_view line_, rest_;
    std::size_t at_ = 0, line_number_ = 0;
};

using ColmapCameras = std::map<std::uint32_t, ColmapCamera>;

inline ColmapImage colmap_image(const std::string& where, const ColmapCameras& cameras, std::uint32_t camera_id,
                                std::string name, const std::array<double, 7>& pose) {
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
                "has model " + std::string(name) +
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
        const std::string where = image_file.where("image " + std::to_string(id) + " (" + name + ")");
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
        return scene;
    }
    throw IoError(folder.string() + ": holds neither cameras.bin nor cameras.txt, nor does its sparse/0 or sparse; "
                                    "expected a reconstruction of COLMAP");
}

inline Camera<double> straight_camera(std::string_view name, const Camera<double>& camera,
                                      const Distortion<double>& distortion) {
    const double width = camera.width, height = camera.height;
    const auto straight = [&](double x, double y) {
        try {
            return undistort_checked<double>(distortion, {(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy});
        } catch (const ValueError& error) {
            throw ValueError(std::string(name) + ": " + error.what());
        }
    };
    constexpr int steps = 256;
    double left = -1e300, right = 1e300, top = -1e300, bottom = 1e300; // normalised
    for (int i = 0; i <= steps; ++i) {
        const double x = width * i / steps, y = height * i / steps;
        left = std::max(left, straight(0, y).x), right = std::min(right, straight(width, y).x);
        top = std::max(top, straight(x, 0).y), bottom = std::min(bottom, straight(x, height).y);
    }
    Camera<double> result = camera;
    constexpr double inside = 1e-3; // pixels: tolerance for the border between the sampled points
    result.cx = -left * camera.fx - inside, result.cy = -top * camera.fy - inside;
    const double columns = std::floor((right - left) * camera.fx - 2 * inside);
    const double rows = std::floor((bottom - top) * camera.fy - 2 * inside);
    check_value(columns >= 1 && rows >= 1 && columns <= 4 * width && rows <= 4 * height, name,
                "its distortion leaves a straight image of " + std::to_string(columns) + " x " + std::to_string(rows) +
                    " pixels; check the coefficients");
    result.width = static_cast<int>(columns), result.height = static_cast<int>(rows);
    check_distortion("straight_camera", name, result, distortion);
    return result;
}

inline StraightImage read_colmap_image(const ColmapImage& entry, const std::filesystem::path& images,
                                       const std::filesystem::path& masks) {
    const auto check = [&](const std::filesystem::path& path, const PixelImage& image) {
        if (image.width != entry.camera.width || image.height != entry.camera.height)
            throw ShapeError(path.string() + ": is " + std::to_string(image.width) + " x " +
                             std::to_string(image.height) + " pixels, expected " + std::to_string(entry.camera.width) +
                             " x " + std::to_string(entry.camera.height) +
                             " as its camera says; were the images resized?");
    };
    StraightImage result{read_image(images / entry.name), entry.camera};
    check(images / entry.name, result.image);
    if (!masks.empty()) {
        std::error_code ignored;
        std::filesystem::path path = masks / (entry.name + ".png");
        if (!std::filesystem::exists(path, ignored)) path = (masks / entry.name).replace_extension(".png");
        const PixelImage mask = read_image(path);
        check(path, mask);
        for (std::size_t i = 0; i < mask.data.size(); i += 4) result.image.data[i + 3] = mask.data[i];
    }
    if (!entry.distortion) return result;
    result.camera = straight_camera(entry.name, entry.camera, *entry.distortion);
    PixelImage straight(4, result.camera.height, result.camera.width);
    cpu::Serial serial;
    resample_rgba8<double>(serial, Span<const std::uint8_t>(result.image.data), result.image.height, result.image.width,
                           UndistortMap<double>{result.camera, entry.camera, *entry.distortion},
                           Span<std::uint8_t>(straight.data), straight.height, straight.width);
    result.image = std::move(straight);
    return result;
}

} // namespace gsh
