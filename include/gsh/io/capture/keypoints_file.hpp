// SPDX-License-Identifier: Apache-2.0
/// @file  Reads keypoints of photographs: files of OpenPose, or one file of COCO-WholeBody or MediaPipe.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads keypoints, as landmarks (body/landmarks.hpp).
///
/// *OpenPose* (--write_json): `path` is a folder with a file for each photograph, CAMERA/FRAME_keypoints.json,
/// CAMERA_FRAME_keypoints.json, or, with a single camera, NAME_FRAME_keypoints.json. Each has `people`, a list of
/// objects with pose_keypoints_2d (25 points of BODY_25: x, y, confidence) and optionally face_keypoints_2d (70
/// points), hand_left_keypoints_2d and hand_right_keypoints_2d (21 points).
///
/// *COCO-WholeBody*: `path` is a file with `images` (id, file_name) and `annotations` (image_id, keypoints of 17 points
/// and optionally foot_kpts of 6, face_kpts of 68, lefthand_kpts and righthand_kpts of 21 points). file_name is named
/// as above, with an image's extension; folders above CAMERA are ignored.
///
/// *MediaPipe*: the same file, but an annotation has mediapipe_pose (33 points: x, y, visibility) and optionally
/// mediapipe_left_hand, mediapipe_right_hand (21 points: x, y, confidence), mediapipe_face (478 points) and
/// mediapipe_world (33 points: x, y, z in metres, axes of the camera, origin between the hips).
///
/// FRAME is the number at the end of the name, with any number of zeros, counted from 0. If `images`, the names of the
/// photographs, are given and fit, they count instead: a file for each photograph, or a photograph for each file, of
/// the same name. Endings as "_keypoints", ".predictions" or ".jpg" do not count. Photographs without a file have no
/// keypoints. A confidence above 1, as COCO's visibility 2, counts as 1; points at confidence 0 are left out.
///
/// Shapes  the result has one element for each photograph with people, ordered by camera and frame. images are those of
///         Capture::image_names, [cameras * frames] or none.
/// Units   pixels of the cameras' images.
/// Errors  IoError naming file and field: a path that does not exist, a folder without such files, a name of which
///         camera or frame do not exist, a photograph that occurs twice, lists of another length, numbers that are not
///         finite. ValueError for keypoints that are no pixels of a camera's images: scaled to 0…1 or -1…1, or for more
///         than a third outside.
[[nodiscard]] inline std::vector<PhotoKeypoints> load_keypoints(const std::filesystem::path& path,
                                                                Span<const NamedCamera> cameras,
                                                                std::size_t frame_count,
                                                                Span<const std::string> images = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A file's name without what detectors append to that of the photograph.
inline std::string photo_stem(std::string stem) {
    constexpr std::array<std::string_view, 8> endings{"_keypoints", "_openpose", "_predictions", ".predictions",
                                                      "_pose",      ".png",      ".jpg",         ".jpeg"};
    for (bool found = true; found;) {
        found = false;
        for (const std::string_view ending : endings)
            if (stem.size() > ending.size() && stem.ends_with(ending))
                stem.resize(stem.size() - ending.size()), found = true;
    }
    return stem;
}

/// A name of a file split into what names a camera, and the number at its end.
struct PhotoName {
    std::string where;            ///< for messages
    std::string stem, camera;     ///< camera is empty if it is not part of the name
    std::string digits;           ///< at the end
    std::optional<std::size_t> c; ///< the camera, if the name or a folder names one

    PhotoName(std::string place, const std::filesystem::path& path, Span<const NamedCamera> cameras)
        : where(std::move(place)), stem(photo_stem(path.stem().string())) {
        const std::size_t last = stem.find_last_not_of("0123456789");
        const std::size_t begin = last == std::string::npos ? 0 : last + 1;
        digits = stem.substr(begin);
        camera = stem.substr(0, begin);
        if (!camera.empty() && std::string_view("_-. ").find(camera.back()) != std::string_view::npos)
            camera.pop_back();
        const auto find = [&](const std::string& name) {
            for (std::size_t k = 0; k < cameras.size() && !c; ++k)
                if (cameras[k].name == name) c = k;
        };
        find(camera);
        for (auto folder = path.parent_path(); !c && folder.has_filename(); folder = folder.parent_path())
            find(folder.filename().string());
        if (!c && cameras.size() == 1) c = 0;
    }
};

/// Finds camera and frame of each file, in their order; no value for a file of a photograph that the capture does not
/// hold.
class PhotoNames {
public:
    PhotoNames(Span<const NamedCamera> cameras, std::size_t frame_count, Span<const std::string> images)
        : cameras_(cameras), frame_count_(frame_count) {
        for (std::size_t i = 0; i < images.size(); ++i)
            if (!images[i].empty()) by_name_[{i / frame_count, images[i]}] = i % frame_count;
    }

    using Place = std::optional<std::pair<std::size_t, std::size_t>>;
    [[nodiscard]] std::vector<Place> find(const std::vector<PhotoName>& names) const {
        std::vector<Place> places;
        std::set<std::pair<std::size_t, std::size_t>> found;
        for (const PhotoName& name : names) {
            if (!name.c) throw unknown_camera(name);
            const auto image = by_name_.find({*name.c, name.stem});
            const auto without = by_name_.find({*name.c, name.digits}); // CAMERA_FRAME
            places.push_back(image != by_name_.end()     ? Place({*name.c, image->second})
                             : without != by_name_.end() ? Place({*name.c, without->second})
                                                         : std::nullopt);
            if (places.back()) found.insert(*places.back());
        }
        const bool every_file = std::all_of(places.begin(), places.end(), [](const Place& p) { return p.has_value(); });
        if (every_file || (!by_name_.empty() && found.size() == by_name_.size())) return places;
        for (std::size_t i = 0; i < names.size(); ++i) places[i] = {*names[i].c, frame(names[i])};
        return places;
    }

private:
    Span<const NamedCamera> cameras_;
    std::size_t frame_count_;
    std::map<std::pair<std::size_t, std::string>, std::size_t> by_name_;

    [[nodiscard]] std::size_t frame(const PhotoName& name) const {
        if (name.digits.empty())
            throw IoError(name.where + ": its name does not end in a frame's number, expected CAMERA/FRAME or "
                                       "CAMERA_FRAME");
        const long number = number_of_digits(name.digits);
        if (number < 0 || static_cast<std::size_t>(number) >= frame_count_)
            throw IoError(name.where + ": is of frame " +
                          (number < 0 ? shortened(name.digits) : std::to_string(number)) + ", expected one below " +
                          std::to_string(frame_count_) +
                          ", the number of the capture's frames, or the name of a photograph");
        return static_cast<std::size_t>(number);
    }
    [[nodiscard]] IoError unknown_camera(const PhotoName& name) const {
        return IoError(name.where + ": names no camera of the capture, expected one of " +
                       listing(cameras_.size(), 8, [&](std::size_t c) { return shortened(cameras_[c].name); }));
    }
};

/// Throws ValueError if the keypoints of a camera cannot be pixels of its images.
inline void check_pixels(const std::string& path, Span<const NamedCamera> cameras,
                         const std::vector<PhotoKeypoints>& photos) {
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const double width = cameras[c].camera.width, height = cameras[c].camera.height;
        vec2<double> low(1e300), high(-1e300);
        std::size_t count = 0, outside = 0;
        for (const PhotoKeypoints& photo : photos) {
            if (photo.camera != c) continue;
            for (const auto& person : photo.people)
                for (const Keypoint& point : person.points) {
                    const auto [x, y] = std::pair(point.pixel.x, point.pixel.y);
                    low = {std::min(low.x, x), std::min(low.y, y)};
                    high = {std::max(high.x, x), std::max(high.y, y)};
                    constexpr double margin = 0.05; // detectors complete a person who is cut off
                    outside += x < -margin * width || x > (1 + margin) * width || y < -margin * height ||
                               y > (1 + margin) * height;
                    ++count;
                }
        }
        if (count < 4 || width < 16 || height < 16) continue; // tests of pieces name no size
        const auto point = [](const vec2<double>& p) { return "(" + number_text(p.x) + ", " + number_text(p.y) + ")"; };
        const std::string found = "the keypoints of camera '" + cameras[c].name + "' lie between " + point(low) +
                                  " and " + point(high) + ", expected pixels of images of " + number_text(width) +
                                  " x " + number_text(height);
        constexpr double unit = 1.5;
        check_value(std::max({-low.x, -low.y, high.x, high.y}) > unit, path,
                    found + "; they are not pixels, but scaled to " + (std::min(low.x, low.y) < -0.1 ? "-1" : "0") +
                        "…1: let the detector write pixels (OpenPose: leave out --keypoint_scale)");
        check_value(3 * outside <= count, path,
                    found + "; " + std::to_string(outside) + " of " + std::to_string(count) +
                        " lie outside, so they are not pixels of these images: detect on images in the size in which "
                        "gsh reads them");
    }
}

/// The numbers of a field: `count` points of `width` each, in one list. Nothing if the field is absent and not needed.
inline std::vector<double> point_numbers(const std::string& where, const Json& object, const char* field,
                                         std::size_t count, std::size_t width, bool needed, const char* hint = "") {
    const auto found = object.find(field);
    if (found == object.end() || (found->is_array() && found->empty() && !needed)) {
        if (!needed) return {};
        throw IoError(where + ": has no " + field + ", expected " + std::to_string(width * count) + " numbers");
    }
    if (!found->is_array() || found->size() != width * count)
        throw IoError(where + ": " + field + " has " +
                      (found->is_array() ? std::to_string(found->size()) + " elements" : "no list") + ", expected " +
                      std::to_string(width * count) + " numbers: " + std::to_string(width) + " of each of " +
                      std::to_string(count) + " points" + hint);
    std::vector<double> numbers;
    for (std::size_t i = 0; i < found->size(); ++i) {
        const Json& number = (*found)[i];
        numbers.push_back(number.is_number() ? number.get<double>() : std::nan(""));
        if (!std::isfinite(numbers.back()))
            throw IoError(where + ": " + field + " has at place " + std::to_string(i) + " " + shortened(number.dump()) +
                          ", expected a finite number");
    }
    return numbers;
}

/// Appends the landmarks among a list of points: x, y and confidence each.
inline void add_keypoints(const std::string& where, const Json& object, const char* field, Span<const int> landmarks,
                          bool mirrored, bool needed, std::vector<Keypoint>& points) {
    const std::string_view name = field;
    const std::vector<double> numbers =
        point_numbers(where, object, field, landmarks.size(), 3, needed,
                      name == "pose_keypoints_2d" && object.contains(field) && object[field].size() == 54
                          ? "; these are the 18 of OpenPose's model COCO, choose --model_pose BODY_25"
                          : "");
    for (std::size_t k = 0; 3 * k < numbers.size(); ++k) {
        const double confidence = numbers[3 * k + 2];
        if (confidence < 0) throw IoError(where + ": " + field + " has a negative confidence, expected 0 to 1");
        if (landmarks[k] < 0 || confidence == 0) continue;
        const int landmark = mirrored ? mirrored_landmark(landmarks[k]) : landmarks[k];
        points.push_back({landmark, {numbers[3 * k], numbers[3 * k + 1]}, std::min(confidence, 1.0)});
    }
}

/// Appends the landmarks among the points of a face, if the field is there.
inline void add_face(const std::string& where, const Json& object, const char* field, std::size_t count,
                     Span<const FacePoint> landmarks, std::vector<Keypoint>& points) {
    std::vector<int> numbers(count, -1);
    for (const auto& [point, landmark] : landmarks) numbers[point] = landmark;
    add_keypoints(where, object, field, numbers, false, false, points);
}

/// The people of MediaPipe: its 33 points of the pose, and what else there is of hands, face and metres.
inline Detection mediapipe_detection(const std::string& where, const Json& person) {
    Detection result;
    add_keypoints(where, person, "mediapipe_pose", mediapipe_pose_landmarks, false, true, result.points);
    add_keypoints(where, person, "mediapipe_left_hand", left_hand_landmarks, false, false, result.points);
    add_keypoints(where, person, "mediapipe_right_hand", left_hand_landmarks, true, false, result.points);
    add_face(where, person, "mediapipe_face", 478, mediapipe_face_landmarks, result.points);
    const std::vector<double> world = point_numbers(where, person, "mediapipe_world", 33, 3, false);
    for (std::size_t k = 0; 3 * k < world.size(); ++k)
        result.metric.push_back({mediapipe_pose_landmarks[k], {world[3 * k], world[3 * k + 1], world[3 * k + 2]}});
    return result;
}

inline const Json& list_of(const std::string& where, const Json& json, const char* field) {
    const auto found = json.is_object() ? json.find(field) : json.end();
    if (!json.is_object() || found == json.end() || !found->is_array()) {
        const char* other = json.is_array()                                      ? "AlphaPose, OpenPifPaf and MMPose"
                            : json.is_object() && json.contains("instance_info") ? "MMPose and Sapiens"
                                                                                 : nullptr;
        throw IoError(where + ": has no list " + field +
                      (other ? " (it is as " + std::string(other) + " write it)" : "") + ", expected a file of " +
                      (std::string_view(field) == "people" ? "OpenPose: people, pose_keypoints_2d of 25 points"
                                                           : "COCO-WholeBody: images and annotations"));
    }
    return *found;
}

} // namespace detail

inline std::vector<PhotoKeypoints> load_keypoints(const std::filesystem::path& path, Span<const NamedCamera> cameras,
                                                  std::size_t frame_count, Span<const std::string> images) {
    using detail::Json;
    namespace fs = std::filesystem;
    const detail::PhotoNames finder(cameras, frame_count, images);
    std::vector<detail::PhotoName> names;
    std::map<std::pair<std::size_t, std::size_t>, PhotoKeypoints> photos;
    std::error_code error;
    if (fs::is_directory(path, error)) {
        std::vector<fs::path> files = list_files_below(path, "a folder of keypoints");
        std::erase_if(files, [](const fs::path& file) { return file.extension() != ".json"; });
        if (files.empty()) throw IoError(path.string() + ": has no .json files, expected those of OpenPose");
        for (const fs::path& file : files) names.emplace_back(file.string(), file.lexically_relative(path), cameras);
        const auto places = finder.find(names);
        for (std::size_t i = 0; i < files.size(); ++i) {
            if (!places[i]) continue; // of a photograph that the capture does not use
            const fs::path& file = files[i];
            const auto [camera, frame] = *places[i];
            const auto [place, is_new] = photos.try_emplace({camera, frame}, PhotoKeypoints{camera, frame, {}});
            if (!is_new)
                throw IoError(file.string() + ": is of camera " + detail::shortened(cameras[camera].name) +
                              " and frame " + std::to_string(frame) + ", which another file has, expected each once");
            const Json json = detail::read_json(file);
            for (const Json& person : detail::list_of(file.string(), json, "people")) {
                auto& points = place->second.people.emplace_back().points;
                detail::add_keypoints(file.string(), person, "pose_keypoints_2d", openpose_landmarks, false, true,
                                      points);
                detail::add_face(file.string(), person, "face_keypoints_2d", 70, face68_landmarks, points);
                detail::add_keypoints(file.string(), person, "hand_left_keypoints_2d", left_hand_landmarks, false,
                                      false, points);
                detail::add_keypoints(file.string(), person, "hand_right_keypoints_2d", left_hand_landmarks, true,
                                      false, points);
            }
        }
    } else {
        if (!fs::exists(path, error))
            throw IoError(path.string() +
                          ": does not exist, expected a folder of OpenPose or a file of COCO-WholeBody");
        const std::string where = path.string();
        const Json json = detail::read_json(path, "keypoints");
        const Json& listed = detail::list_of(where, json, "images");
        for (const Json& image : listed) {
            if (!image.is_object() || !image.contains("id") || !image.contains("file_name") ||
                !image["file_name"].is_string())
                throw IoError(where + ": an element of images has no id or no file_name");
            const fs::path name = image["file_name"].get<std::string>();
            names.emplace_back(where + ": " + detail::shortened(name.string()), name, cameras);
        }
        const auto places = finder.find(names);
        std::map<std::string, detail::PhotoNames::Place> image_of; // by id, as text
        for (std::size_t i = 0; i < places.size(); ++i) {
            image_of[listed[i]["id"].dump()] = places[i];
            if (!places[i]) continue;
            const auto [camera, frame] = *places[i];
            if (!photos.try_emplace({camera, frame}, PhotoKeypoints{camera, frame, {}}).second)
                throw IoError(where + ": images has camera " + detail::shortened(cameras[camera].name) + " and frame " +
                              std::to_string(frame) + " twice, expected each once");
        }
        for (const Json& person : detail::list_of(where, json, "annotations")) {
            const std::string id =
                person.is_object() && person.contains("image_id") ? person["image_id"].dump() : "none";
            const auto of = image_of.find(id);
            if (of == image_of.end())
                throw IoError(where + ": an annotation has image_id " + detail::shortened(id) +
                              ", which is no id of images");
            if (!of->second) continue;
            auto& people = photos.at(*of->second).people;
            if (person.contains("mediapipe_pose")) {
                people.push_back(detail::mediapipe_detection(where, person));
                continue;
            }
            auto& points = people.emplace_back().points;
            detail::add_keypoints(where, person, "keypoints", coco_landmarks, false, true, points);
            detail::add_keypoints(where, person, "foot_kpts", coco_foot_landmarks, false, false, points);
            detail::add_face(where, person, "face_kpts", 68, face68_landmarks, points);
            detail::add_keypoints(where, person, "lefthand_kpts", left_hand_landmarks, false, false, points);
            detail::add_keypoints(where, person, "righthand_kpts", left_hand_landmarks, true, false, points);
        }
    }
    std::vector<PhotoKeypoints> result;
    for (auto& [of, photo] : photos)
        if (!photo.people.empty()) result.push_back(std::move(photo));
    detail::check_pixels(path.string(), cameras, result);
    return result;
}

} // namespace gsh
