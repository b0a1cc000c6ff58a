// SPDX-License-Identifier: Apache-2.0
/// @file  Reads keypoints of a capture's photographs: OpenPose's JSON files, or one JSON file of COCO-WholeBody.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads keypoints.
///
/// *OpenPose* (--write_json): `path` is a folder with a file for each photograph, CAMERA/FRAME_keypoints.json,
/// CAMERA_FRAME_keypoints.json, or, with a single camera, NAME_FRAME_keypoints.json. Each has `people`, a list of
/// objects with pose_keypoints_2d (25 points of BODY_25: x, y, confidence) and optionally hand_left_keypoints_2d and
/// hand_right_keypoints_2d (21 points).
///
/// *COCO-WholeBody*: `path` is a file with `images` (id, file_name) and `annotations` (image_id, keypoints of 17 points
/// and optionally lefthand_kpts and righthand_kpts of 21 points). file_name is named as above, with an image's
/// extension; folders above CAMERA are ignored.
///
/// FRAME is the number at the end of the name. Photographs without a file have no keypoints. A confidence above 1, as
/// COCO's visibility 2, counts as 1; points at confidence 0 are left out.
///
/// Shapes  the result has one element for each photograph with people, ordered by camera and frame.
/// Errors  IoError naming file and field: a path that does not exist, a folder without such files, a name of which
///         camera or frame do not exist, a photograph that occurs twice, lists of another length, numbers that are not
///         finite.
[[nodiscard]] inline std::vector<PhotoKeypoints> load_keypoints(const std::filesystem::path& path,
                                                                Span<const NamedCamera> cameras,
                                                                std::size_t frame_count);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Finds camera and frame in the name of a file.
struct PhotoNames {
    Span<const NamedCamera> cameras;
    std::size_t frame_count;

    /// `stem` is the file's name without extension.
    [[nodiscard]] std::pair<std::size_t, std::size_t> find(const std::string& where, const std::string& folder,
                                                           const std::string& stem) const {
        const std::size_t last = stem.find_last_not_of("0123456789");
        const std::size_t begin = last == std::string::npos ? 0 : last + 1;
        if (begin == stem.size() || stem.size() - begin > 9)
            throw IoError(where + ": its name does not end in a frame's number, expected CAMERA/FRAME or CAMERA_FRAME");
        const auto frame = static_cast<std::size_t>(std::stoul(stem.substr(begin)));
        if (frame >= frame_count)
            throw IoError(where + ": is of frame " + std::to_string(frame) + ", expected one below " +
                          std::to_string(frame_count) + ", the number of the capture's frames");
        std::string prefix = stem.substr(0, begin);
        if (!prefix.empty() && prefix.back() == '_') prefix.pop_back();
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (cameras[c].name == prefix || (prefix.empty() && cameras[c].name == folder)) return {c, frame};
        if (cameras.size() == 1) return {0, frame};
        std::vector<std::string> known;
        for (const NamedCamera& camera : cameras) known.push_back(camera.name);
        throw IoError(where + ": names no camera of the capture, expected one of " + listed(known, "none"));
    }
};

/// Appends the joints among a list of points, three numbers each.
inline void add_keypoints(const std::string& where, const Json& object, const char* field,
                          Span<const std::string_view> joints, std::string_view side, bool needed,
                          std::vector<Keypoint>& points) {
    const auto found = object.find(field);
    if (found == object.end() || (found->is_array() && found->empty() && !needed)) {
        if (!needed) return;
        throw IoError(where + ": has no " + field + ", expected " + std::to_string(3 * joints.size()) + " numbers");
    }
    if (!found->is_array() || found->size() != 3 * joints.size())
        throw IoError(where + ": " + field + " has " +
                      (found->is_array() ? std::to_string(found->size()) + " elements" : "no list") + ", expected " +
                      std::to_string(3 * joints.size()) + " numbers: x, y and confidence of " +
                      std::to_string(joints.size()) + " points");
    for (std::size_t k = 0; k < joints.size(); ++k) {
        double numbers[3];
        for (std::size_t i = 0; i < 3; ++i) {
            const Json& number = (*found)[3 * k + i];
            if (!number.is_number() || !std::isfinite(numbers[i] = number.get<double>()))
                throw IoError(where + ": " + field + " has at place " + std::to_string(3 * k + i) + " " +
                              shortened(number.dump()) + ", expected a finite number");
        }
        if (numbers[2] < 0) throw IoError(where + ": " + field + " has a negative confidence, expected 0 to 1");
        if (joints[k].empty() || numbers[2] == 0) continue;
        points.push_back({smplx_joint(std::string(side).append(joints[k])),
                          {numbers[0], numbers[1]},
                          std::min(numbers[2], 1.0)});
    }
}

inline const Json& list_of(const std::string& where, const Json& json, const char* field) {
    const auto found = json.is_object() ? json.find(field) : json.end();
    if (!json.is_object() || found == json.end() || !found->is_array())
        throw IoError(where + ": has no list " + field + ", expected " +
                      (std::string_view(field) == "people" ? "a file of OpenPose" : "a file of COCO-WholeBody"));
    return *found;
}

} // namespace detail

inline std::vector<PhotoKeypoints> load_keypoints(const std::filesystem::path& path, Span<const NamedCamera> cameras,
                                                  std::size_t frame_count) {
    using detail::Json;
    namespace fs = std::filesystem;
    const detail::PhotoNames names{cameras, frame_count};
    std::map<std::pair<std::size_t, std::size_t>, PhotoKeypoints> photos;
    std::error_code error;
    if (fs::is_directory(path, error)) {
        std::vector<fs::path> files;
        for (const auto& entry : fs::recursive_directory_iterator(path, error))
            if (entry.path().extension() == ".json") files.push_back(entry.path());
        if (error) throw IoError(path.string() + ": cannot be listed: " + error.message());
        if (files.empty()) throw IoError(path.string() + ": has no .json files, expected those of OpenPose");
        std::sort(files.begin(), files.end());
        for (const fs::path& file : files) {
            std::string stem = file.stem().string();
            constexpr std::string_view ending = "_keypoints";
            if (stem.ends_with(ending)) stem.resize(stem.size() - ending.size());
            const auto [camera, frame] = names.find(file.string(), file.parent_path().filename().string(), stem);
            const auto [place, is_new] = photos.try_emplace({camera, frame}, PhotoKeypoints{camera, frame, {}});
            if (!is_new)
                throw IoError(file.string() + ": is of camera " + detail::shortened(cameras[camera].name) +
                              " and frame " + std::to_string(frame) + ", which another file has, expected each once");
            const Json json = detail::read_json(file);
            for (const Json& person : detail::list_of(file.string(), json, "people")) {
                auto& points = place->second.people.emplace_back();
                detail::add_keypoints(file.string(), person, "pose_keypoints_2d", openpose_joints, "", true, points);
                detail::add_keypoints(file.string(), person, "hand_left_keypoints_2d", hand_joints, "left_", false,
                                      points);
                detail::add_keypoints(file.string(), person, "hand_right_keypoints_2d", hand_joints, "right_", false,
                                      points);
            }
        }
    } else {
        if (!fs::exists(path, error))
            throw IoError(path.string() +
                          ": does not exist, expected a folder of OpenPose or a file of COCO-WholeBody");
        const std::string where = path.string();
        const Json json = detail::read_json(path);
        std::map<std::string, std::pair<std::size_t, std::size_t>> image_of; // by id, as text
        for (const Json& image : detail::list_of(where, json, "images")) {
            if (!image.is_object() || !image.contains("id") || !image.contains("file_name") ||
                !image["file_name"].is_string())
                throw IoError(where + ": an element of images has no id or no file_name");
            const fs::path name = image["file_name"].get<std::string>();
            const auto of = names.find(where + ": " + detail::shortened(name.string()),
                                       name.parent_path().filename().string(), name.stem().string());
            if (!photos.try_emplace(of, PhotoKeypoints{of.first, of.second, {}}).second)
                throw IoError(where + ": images has camera " + detail::shortened(cameras[of.first].name) +
                              " and frame " + std::to_string(of.second) + " twice, expected each once");
            image_of[image["id"].dump()] = of;
        }
        for (const Json& person : detail::list_of(where, json, "annotations")) {
            const std::string id =
                person.is_object() && person.contains("image_id") ? person["image_id"].dump() : "none";
            const auto of = image_of.find(id);
            if (of == image_of.end())
                throw IoError(where + ": an annotation has image_id " + detail::shortened(id) +
                              ", which is no id of images");
            auto& points = photos.at(of->second).people.emplace_back();
            detail::add_keypoints(where, person, "keypoints", coco_joints, "", true, points);
            detail::add_keypoints(where, person, "lefthand_kpts", hand_joints, "left_", false, points);
            detail::add_keypoints(where, person, "righthand_kpts", hand_joints, "right_", false, points);
        }
    }
    std::vector<PhotoKeypoints> result;
    for (auto& [of, photo] : photos)
        if (!photo.people.empty()) result.push_back(std::move(photo));
    return result;
}

} // namespace gsh
