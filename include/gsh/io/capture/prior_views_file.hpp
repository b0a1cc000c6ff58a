// SPDX-License-Identifier: Apache-2.0
/// @file  Reads a JSON list that assigns an estimator's maps to frames, cameras and people of a capture.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/image/depth_map_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/image/normal_map_file.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/prior/orthographic_camera.hpp>
#include <gsh/prior/prior_view.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace gsh {

/// Reads {"views": [...]}, or the list alone. The fields of a view are
///
///   normals    a normal map, PNG or npy as accepted by read_normal_map; with it "encoding" (y_up by default, y_down,
///              opencv, x_left), "facing" (viewer, away) and "integrate": true for a depth view from these normals
///   depth      an .npy of (height, width) real numbers, camera z in metres; NaN, 0 and points behind a pinhole camera
///              are invalid. A view has normals or depth, or both
///   mask       an image of the map's size; the map is valid where it is white (or opaque, if it has alpha)
///   frame      a number from 0, or "canonical" (the default)
///   camera     a name out of `cameras`; or as in cameras.json (width, height, K, R, t); or orthographic (width,
///              height, scale in pixels per metre, cx, cy, R, t)
///   crop       [x, y, width, height] in the camera's pixels: the part that the map shows, at any resolution; by
///              default the map shows the whole image at its size
///   person     a name out of `people`, or a number from 0 (the default)
///
/// Paths are relative to the file's folder. Cameras have no distortion, so a map of a distorted photograph must be
/// undistorted first.
///
/// Shapes  result [max(1, people)], in their order.
/// Errors  IoError, ShapeError, ValueError naming file, view and field: a missing file, an unknown field, word, camera,
///         person or frame, fields that exclude each other, sizes that do not match, a map without a valid pixel; those
///         of the readers of the maps.
[[nodiscard]] inline std::vector<EstimatedPriors> read_prior_views(const std::filesystem::path& path,
                                                                   Span<const NamedCamera> cameras,
                                                                   std::size_t frame_count,
                                                                   Span<const std::string> people = {});

/// CRC-32 of the file and of all files that it names, to detect changes.
///
/// Errors  the IoErrors of read_prior_views.
[[nodiscard]] inline std::uint32_t prior_views_checksum(const std::filesystem::path& path);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::array<const char*, 3> prior_view_files = {"normals", "depth", "mask"};

/// The list of views in a file.
inline const Json& prior_view_list(const Json& json, const std::string& name) {
    if (json.is_object()) JsonObject(json, name).expect_only({"views"});
    const Json& list = json.is_array() ? json : JsonObject(json, name).at("views");
    if (!list.is_array() || list.empty()) throw IoError(name + ": views must be a list with at least one view");
    return list;
}

inline std::string prior_view_name(const std::filesystem::path& path, std::size_t view) {
    return path.string() + ": views[" + std::to_string(view) + "]";
}

/// The value of a word; the first value if the field is missing.
template <class Value>
Value prior_word(const JsonObject& object, const char* field,
                 std::initializer_list<std::pair<const char*, Value>> values) {
    if (!object.has(field)) return values.begin()->second;
    const std::string word = object.text(field);
    std::string known;
    for (const auto& [name, value] : values) {
        if (word == name) return value;
        known += (known.empty() ? "" : ", ") + std::string(name);
    }
    throw ValueError(object.where() + ": " + field + " is '" + shortened(word) + "', expected one of " + known);
}

inline PriorCamera read_prior_camera(const JsonObject& view, Span<const NamedCamera> cameras) {
    const Json& json = view.at("camera");
    const std::string where = view.where() + ": camera";
    if (json.is_string()) {
        const auto name = json.get<std::string>();
        std::vector<std::string> known;
        for (const NamedCamera& camera : cameras) {
            if (camera.name == name) return camera.camera;
            known.push_back(camera.name);
        }
        throw ValueError(where + " is '" + shortened(name) + "', expected one of the capture's, " +
                         listed(known, "none") + ", or an object");
    }
    const JsonObject object(json, where);
    if (!object.has("scale")) {
        const NamedCamera camera = read_camera_entry(json, where);
        check_value(!camera.distortion, where,
                    "has distortion, expected a camera without distortion; undistort the map");
        return camera.camera;
    }
    object.expect_only({"width", "height", "scale", "cx", "cy", "R", "t"});
    Camera<double> placed;
    read_extrinsics(object, placed);
    const OrthographicCamera camera{placed.R,
                                    placed.t,
                                    object.number("scale"),
                                    object.number("cx"),
                                    object.number("cy"),
                                    object.integer("width"),
                                    object.integer("height")};
    check_camera(view.where(), "camera", camera);
    return camera;
}

/// The camera of a map of width x height pixels that shows a crop of another camera's image.
inline PriorCamera crop_camera(const PriorCamera& whole, const std::vector<double>& crop, int width, int height,
                               const std::string& where) {
    const double across = width / crop[2], down = height / crop[3]; // pixels of the map in one of the camera
    return std::visit(
        [&](auto camera) -> PriorCamera {
            if constexpr (requires { camera.scale; }) {
                check_value(std::abs(across / down - 1) < 0.01, where,
                            "crop is " + Json(crop[2]).dump() + " x " + Json(crop[3]).dump() + ", the map " +
                                std::to_string(width) + " x " + std::to_string(height) +
                                " pixels, expected one shape: an orthographic camera has one scale");
                camera.scale *= across;
            } else {
                camera.fx *= across, camera.fy *= down;
            }
            camera.cx = (camera.cx - crop[0]) * across, camera.cy = (camera.cy - crop[1]) * down;
            camera.width = width, camera.height = height;
            return camera;
        },
        whole);
}

/// Removes the pixels outside the mask of a file.
inline void restrict_prior(PriorMap& map, const std::filesystem::path& path) {
    const StoredMask stored = read_mask(path);
    const PixelImage mask = upright(stored.values, stored.orientation);
    if (mask.width != map.mask.width || mask.height != map.mask.height)
        throw ShapeError(path.string() + " is " + std::to_string(mask.width) + " x " + std::to_string(mask.height) +
                         " pixels, its map " + std::to_string(map.mask.width) + " x " +
                         std::to_string(map.mask.height));
    const int least = mask_meaning(path.string(), stored.levels, false) == MaskMeaning::binary ? 1 : 128;
    for (std::size_t i = 0; i < map.mask.data.size(); ++i)
        if (mask.data[i] < least) {
            map.mask.data[i] = 0;
            for (int c = 0; c < map.values.channels; ++c) map.values.view().row(c, 0)[i] = 0;
        }
}

/// Calls f. If it throws, the entry's name is prepended to the message.
template <class F>
auto read_for(const std::string& entry, const F& f) {
    try {
        return f();
    } catch (const ShapeError& error) {
        throw ShapeError(entry + ": " + error.what());
    } catch (const ValueError& error) {
        throw ValueError(entry + ": " + error.what());
    } catch (const IoError& error) {
        throw IoError(entry + ": " + error.what());
    }
}

/// One entry of the list.
class PriorViewEntry {
public:
    PriorViewEntry(const Json& json, std::string where, std::filesystem::path folder, Span<const NamedCamera> cameras,
                   std::size_t frame_count, Span<const std::string> people)
        : object_(json, std::move(where)), folder_(std::move(folder)) {
        object_.expect_only(
            {"normals", "encoding", "facing", "integrate", "depth", "mask", "frame", "camera", "crop", "person"});
        if (!object_.has("normals") && !object_.has("depth"))
            throw IoError(object_.where() + ": names neither normals nor depth");
        for (const char* field : {"encoding", "facing", "integrate"})
            if (object_.has(field) && !object_.has("normals"))
                throw IoError(object_.where() + ": " + field + " belongs to normals, which are missing");
        camera_ = read_prior_camera(object_, cameras);
        if (object_.has("crop")) {
            crop_ = object_.numbers("crop", 4);
            check_value(crop_[2] > 0 && crop_[3] > 0, object_.where(),
                        "crop has no extent, expected [x, y, width, height] in the camera's pixels");
        }
        read_frame(frame_count);
        read_person(people);
    }

    /// Counts the views of each map, because a list that names one map many times would exhaust memory.
    void count_uses(std::map<std::string, int>& views_of) const {
        constexpr int most = 16;
        for (const char* field : {"normals", "depth"})
            if (object_.has(field))
                check_value(++views_of[object_.text(field)] <= most, object_.where(),
                            std::string(field) + " is a map that " + std::to_string(most) +
                                " views before it name, expected a map of its own");
    }
    void add_to(std::vector<EstimatedPriors>& people) const {
        EstimatedPriors& priors = people[person_];
        if (object_.has("normals")) {
            const NormalMapParams params{
                .encoding = prior_word<NormalEncoding>(object_, "encoding",
                                                       {{"y_up", NormalEncoding::y_up},
                                                        {"y_down", NormalEncoding::y_down},
                                                        {"opencv", NormalEncoding::opencv},
                                                        {"x_left", NormalEncoding::x_left}}),
                .facing = prior_word<NormalFacing>(object_, "facing",
                                                   {{"viewer", NormalFacing::viewer}, {"away", NormalFacing::away}})};
            const bool integrate = read_integrate(params.facing);
            const auto file = named_path(folder_, object_.text("normals"), object_.where());
            PriorMap map = read_for(object_.where(), [&] { return read_normal_map(file, params); });
            priors.normals.emplace_back(view(std::move(map), file), frame_, object_.where(), integrate);
        }
        if (object_.has("depth")) {
            const auto file = named_path(folder_, object_.text("depth"), object_.where());
            const bool orthographic = std::holds_alternative<OrthographicCamera>(camera_);
            PriorMap map = read_for(object_.where(), [&] { return read_depth_map(file, orthographic); });
            priors.depths.emplace_back(view(std::move(map), file), frame_, object_.where());
        }
    }

private:
    JsonObject object_;
    std::filesystem::path folder_;
    PriorCamera camera_;
    std::vector<double> crop_;
    std::optional<std::size_t> frame_;
    std::size_t person_ = 0;

    void read_frame(std::size_t count) {
        if (!object_.has("frame")) return;
        if (const Json& json = object_.at("frame"); json.is_string()) {
            check_value(json.get<std::string>() == "canonical", object_.where(),
                        "frame is '" + shortened(json.get<std::string>()) + "', expected a number or canonical");
            return;
        }
        frame_ = index("frame", count, "frames");
    }
    void read_person(Span<const std::string> people) {
        if (!object_.has("person")) return;
        const Json& json = object_.at("person");
        if (!json.is_string()) {
            person_ = index("person", std::max<std::size_t>(1, people.size()), "people");
            return;
        }
        const auto name = json.get<std::string>();
        for (std::size_t p = 0; p < people.size(); ++p)
            if (people[p] == name) {
                person_ = p;
                return;
            }
        throw ValueError(object_.where() + ": person is '" + shortened(name) + "', expected one of " +
                         listed(people, "none"));
    }
    [[nodiscard]] std::size_t index(const char* field, std::size_t count, const char* things) const {
        const int number = object_.integer(field);
        check_value(number >= 0 && static_cast<std::size_t>(number) < count, object_.where(),
                    std::string(field) + " is " + std::to_string(number) + ", the capture has " +
                        std::to_string(count) + " " + things + ", counted from 0");
        return static_cast<std::size_t>(number);
    }
    [[nodiscard]] bool read_integrate(NormalFacing facing) const {
        if (!object_.has("integrate")) return false;
        const bool integrate = object_.boolean("integrate");
        check_value(!integrate || !object_.has("depth"), object_.where(),
                    "integrate makes a depth of the normals; leave out depth");
        check_value(!integrate || facing == NormalFacing::viewer, object_.where(),
                    "integrate needs normals that face the viewer: the mesh's depth beside them is of the near side");
        return integrate;
    }
    /// The view of a map with its camera, restricted to the mask.
    [[nodiscard]] PriorView view(PriorMap map, const std::filesystem::path& file) const {
        const int width = map.mask.width, height = map.mask.height;
        PriorView result{crop_.empty() ? camera_ : crop_camera(camera_, crop_, width, height, object_.where()), {}, {}};
        std::visit([&](const auto& c) { check_camera(object_.where(), "the camera of the crop", c); }, result.camera);
        const auto [across, down] =
            std::visit([](const auto& c) { return std::array{c.width, c.height}; }, result.camera);
        if (across != width || down != height)
            throw ShapeError(object_.where() + ": " + file.string() + " is " + std::to_string(width) + " x " +
                             std::to_string(height) + " pixels, its camera " + std::to_string(across) + " x " +
                             std::to_string(down) + "; give the part of the image that it shows as crop");
        std::string counting = file.string();
        if (object_.has("mask")) {
            const auto mask = named_path(folder_, object_.text("mask"), object_.where());
            read_for(object_.where(), [&] { restrict_prior(map, mask); });
            counting += " within " + mask.string();
        }
        check_value(std::any_of(map.mask.data.begin(), map.mask.data.end(), [](auto m) { return m != 0; }),
                    object_.where(), "no pixel counts of " + counting);
        result.map = std::move(map);
        return result;
    }
};

} // namespace detail

inline std::vector<EstimatedPriors> read_prior_views(const std::filesystem::path& path, Span<const NamedCamera> cameras,
                                                     std::size_t frame_count, Span<const std::string> people) {
    const detail::Json json = detail::read_json(path, "priors");
    const detail::Json& list = detail::prior_view_list(json, path.string());
    std::vector<EstimatedPriors> result(std::max<std::size_t>(1, people.size()));
    std::map<std::string, int> views_of;
    for (std::size_t v = 0; v < list.size(); ++v) {
        const detail::PriorViewEntry entry(list[v], detail::prior_view_name(path, v), path.parent_path(), cameras,
                                           frame_count, people);
        entry.count_uses(views_of);
        entry.add_to(result);
    }
    return result;
}

inline std::uint32_t prior_views_checksum(const std::filesystem::path& path) {
    Crc32 crc;
    const auto add = [&](const std::filesystem::path& file) {
        const std::string bytes = read_file(file);
        crc.add(bytes.data(), bytes.size());
    };
    add(path);
    const detail::Json json = detail::read_json(path, "priors");
    const detail::Json& list = detail::prior_view_list(json, path.string());
    for (std::size_t v = 0; v < list.size(); ++v) {
        const detail::JsonObject object(list[v], detail::prior_view_name(path, v));
        for (const char* field : detail::prior_view_files)
            if (object.has(field)) add(detail::named_path(path.parent_path(), object.text(field), object.where()));
    }
    return crc.value();
}

} // namespace gsh
