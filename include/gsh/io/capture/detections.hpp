// SPDX-License-Identifier: Apache-2.0
/// @file  Reads what a detector wrote of a video: cameras and times, keypoints, masks.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/frame_files.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// The folder of a detector.
struct Detections {
    std::vector<NamedCamera> cameras; // [C]
    bool calibrated = false;          ///< whether the cameras are those of a calibration
    std::vector<bool> known_focal;    // [C] whether calibration or metadata give the focal length
    std::vector<double> times;        // [T] ascending, seconds
    std::vector<PhotoKeypoints> keypoints;
    std::vector<std::vector<std::filesystem::path>> masks; // [C, T], or [C] of none; empty for a frame without one

    bool masks_by_body = false; ///< whether the detector can cut masks anew by fitted bodies (docs/detection.md)

    [[nodiscard]] bool has_mask(std::size_t camera, std::size_t frame) const {
        return !masks[camera].empty() && !masks[camera][frame].empty();
    }
};

/// Reads
///
///     FOLDER/video.json        cameras: a list of name, width, height, times (seconds), and focal (pixels) if known
///     FOLDER/keypoints.json    COCO-WholeBody or MediaPipe; or a folder keypoints/ of OpenPose
///     FOLDER/masks/CAMERA/     a mask for each frame, optional; read instead are masks_detected/CAMERA/, where masks/
///                              holds those that a fit has mended, and masks_by_body/CAMERA/, where there are some that
///                              were cut anew by fitted bodies
///     FOLDER/calibration.json  cameras as those of a capture, optional for a single camera
///
/// The times of all cameras must be the same within half a frame; those of the camera with the most frames count. The
/// others may end before it. A frame may lack its mask (assign_frames). Without a calibration the single camera stands
/// at the origin, looks along z, and has a focal length of 1.2 times the longer side if none is known.
///
/// Errors  IoError, ShapeError and ValueError naming file and field: missing files, several cameras without a
///         calibration, cameras of one file that the other lacks, times of different moments or that do not ascend,
///         masks that frames cannot be told of.
[[nodiscard]] inline Detections load_detections(const std::filesystem::path& folder);

/// The mask of a photograph that has one: one channel, 255 on the person.
///
/// Errors  those of read_mask; ShapeError for another size than the camera's.
[[nodiscard]] inline PixelImage load_detected_mask(const Detections& detections, std::size_t camera, std::size_t frame);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

struct FilmedCamera {
    NamedCamera camera;
    bool known_focal = false;
    std::vector<double> times;
};

inline FilmedCamera read_filmed_camera(const Json& json, const std::string& place) {
    const JsonObject unnamed(json, place);
    FilmedCamera result;
    result.camera.name = unnamed.text("name");
    const JsonObject object(json, place + " '" + shortened(result.camera.name) + "'");
    check_value(is_plain_name(result.camera.name), object.where(), "name is not a plain folder name");
    Camera<double>& camera = result.camera.camera;
    camera.width = object.integer("width"), camera.height = object.integer("height");
    constexpr int most = 1 << 14;
    check_value(camera.width > 0 && camera.height > 0 && camera.width <= most && camera.height <= most, object.where(),
                "width x height is " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    ", expected 1 to " + std::to_string(most) + " each");
    camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    const double longer = std::max(camera.width, camera.height);
    result.known_focal = object.has("focal");
    constexpr double usual = 1.2; // of the longer side: the main cameras of telephones lie between 1 and 1.4
    camera.fx = camera.fy = result.known_focal ? object.number("focal") : usual * longer;
    check_value(camera.fx > 0.2 * longer && camera.fx < 50 * longer, object.where(),
                "focal is " + number_text(camera.fx) + ", expected pixels of images of " +
                    std::to_string(camera.width) + " x " + std::to_string(camera.height));
    result.times = object.numbers("times");
    check_value(!result.times.empty(), object.where(), "times is empty, expected one number for each image");
    for (std::size_t t = 1; t < result.times.size(); ++t)
        check_value(result.times[t] > result.times[t - 1], object.where(),
                    "times[" + std::to_string(t) + "] is " + number_text(result.times[t]) +
                        ", expected more than the " + number_text(result.times[t - 1]) + " before it");
    return result;
}

/// Gives the cameras their calibration.
inline void calibrate(Detections& result, const std::filesystem::path& path) {
    const CameraList list = read_cameras(path);
    std::map<std::string, const NamedCamera*> by_name;
    for (const NamedCamera& camera : list.cameras) by_name[camera.name] = &camera;
    for (NamedCamera& camera : result.cameras) {
        const auto place = by_name.find(camera.name);
        if (place == by_name.end())
            throw IoError(path.string() + ": has no camera " + shortened(camera.name) + ", which video.json lists");
        const NamedCamera* const found = place->second;
        const std::string where = path.string() + ": camera " + shortened(camera.name);
        check_value(found->camera.width == camera.camera.width && found->camera.height == camera.camera.height, where,
                    "is of images of " + std::to_string(found->camera.width) + " x " +
                        std::to_string(found->camera.height) + ", but video.json states " +
                        std::to_string(camera.camera.width) + " x " + std::to_string(camera.camera.height));
        check_value(!found->distortion, where,
                    "has a distortion; detect on undistorted images, and leave it out (scripts/detect --calibration)");
        camera = *found;
    }
    result.calibrated = true;
    result.known_focal.assign(result.cameras.size(), true);
}

/// The masks of all cameras. The numbers of all of them tell which frames have none.
inline std::vector<std::vector<std::filesystem::path>>
mask_files(const std::filesystem::path& folder, const std::vector<NamedCamera>& cameras, std::size_t frames) {
    std::vector<std::filesystem::path> folders;
    std::vector<std::vector<std::filesystem::path>> lists;
    std::vector<std::size_t> of_list;
    std::error_code error;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        for (const char* of : {"masks_by_body", "masks_detected", "masks"}) {
            const std::filesystem::path place = folder / of / cameras[c].name;
            if (!std::filesystem::is_directory(place, error)) continue;
            lists.push_back(list_images(place)), folders.push_back(place), of_list.push_back(c);
            break;
        }
    }
    std::vector<std::vector<std::filesystem::path>> result(cameras.size());
    auto rows = assign_frames(std::move(lists), folders, frames, "one for each of the times in video.json").rows;
    for (std::size_t k = 0; k < rows.size(); ++k) result[of_list[k]] = std::move(rows[k]);
    return result;
}

} // namespace detail

inline Detections load_detections(const std::filesystem::path& folder) {
    namespace fs = std::filesystem;
    std::error_code error;
    const fs::path video = folder / "video.json";
    if (!fs::exists(video, error))
        throw IoError(video.string() + ": does not exist, expected the folder that scripts/detect wrote (" +
                      "video.json, keypoints.json, masks/)");
    const detail::Json json = detail::read_json(video, "video");
    const detail::Json& list = detail::JsonObject(json, video.string()).at("cameras");
    if (!list.is_array() || list.empty())
        throw IoError(video.string() + ": cameras must be a list with at least one camera");
    Detections result;
    if (const detail::JsonObject whole(json, video.string()); whole.has("masks_by_body"))
        result.masks_by_body = whole.boolean("masks_by_body");
    std::vector<std::vector<double>> times; // of each camera
    std::set<std::string> names;
    std::string longest;
    const auto place = [&](std::size_t c) { return video.string() + ": cameras[" + std::to_string(c) + "]"; };
    for (std::size_t c = 0; c < list.size(); ++c) {
        detail::FilmedCamera filmed = detail::read_filmed_camera(list[c], place(c));
        check_value(names.insert(filmed.camera.name).second, place(c), "name stands there twice");
        if (filmed.times.size() > result.times.size())
            result.times = filmed.times, longest = detail::shortened(filmed.camera.name);
        times.push_back(std::move(filmed.times));
        result.cameras.push_back(std::move(filmed.camera));
        result.known_focal.push_back(filmed.known_focal);
    }
    const std::size_t T = result.times.size();
    const double frame = T > 1 ? (result.times.back() - result.times.front()) / static_cast<double>(T - 1) : 1;
    for (std::size_t c = 0; c < times.size(); ++c)
        for (std::size_t t = 0; t < times[c].size(); ++t)
            check_value(std::abs(times[c][t] - result.times[t]) <= 0.5 * frame, place(c),
                        "times[" + std::to_string(t) + "] is " + detail::number_text(times[c][t]) +
                            ", expected at most half a frame from the " + detail::number_text(result.times[t]) +
                            " of camera " + longest + "; let all cameras' images be of the same times");
    if (const fs::path calibration = folder / "calibration.json"; fs::exists(calibration, error))
        detail::calibrate(result, calibration);
    else if (result.cameras.size() > 1)
        throw IoError(calibration.string() + ": does not exist; several cameras need a calibration " +
                      "(scripts/detect --calibration FILE)");
    fs::path keypoints = folder / "keypoints.json";
    if (!fs::exists(keypoints, error) && fs::is_directory(folder / "keypoints", error))
        keypoints = folder / "keypoints";
    result.keypoints = load_keypoints(keypoints, result.cameras, T);
    result.masks = detail::mask_files(folder, result.cameras, T);
    return result;
}

inline PixelImage load_detected_mask(const Detections& detections, std::size_t camera, std::size_t frame) {
    const std::filesystem::path& path = detections.masks.at(camera).at(frame);
    PixelImage mask = read_mask(path).values;
    const Camera<double>& of = detections.cameras[camera].camera;
    if (mask.width != of.width || mask.height != of.height)
        throw ShapeError(path.string() + ": is " + std::to_string(mask.width) + " x " + std::to_string(mask.height) +
                         ", but the images of camera " + detail::shortened(detections.cameras[camera].name) + " are " +
                         std::to_string(of.width) + " x " + std::to_string(of.height));
    return mask;
}

} // namespace gsh
