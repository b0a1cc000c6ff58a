// SPDX-License-Identifier: Apache-2.0
/// @file  Loads a capture of several cameras in EasyMocap's layout.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/easymocap_cameras.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/easymocap_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/smplx_json_file.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Loads intri.yml and extri.yml, images/CAMERA/NUMBER.jpg (or .png), masks/CAMERA/NUMBER.png (or mask/…; the person is
/// white), and a person's poses, NUMBER.json. The capture's frames are those of the poses. options.poses names their
/// folder; the default is that of easymocap_pose_folder, SMPL-X before SMPL-H and SMPL. It may also name any other
/// input of load_any_motion. Poses without numbers belong to the first camera's images, in order. Images and masks that
/// are missing count as not taken.
///
/// options.test_cameras and test_frames (counted from the first pose file) are used for evaluation. Without these
/// options the last camera is the test camera if there are at least three. Images are undistorted.
///
/// Errors  those of load_capture and load_easymocap_motion.
template <HostExecutor E>
[[nodiscard]] Capture load_easymocap_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                                             const CaptureOptions& options = {},
                                             std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The folder of poses in an EasyMocap capture.
inline std::filesystem::path easymocap_poses(const std::filesystem::path& folder, const std::string& named) {
    if (named != "poses.npz") return folder / named;
    const std::filesystem::path found = easymocap_pose_folder(folder);
    if (found.empty())
        throw IoError(folder.string() +
                      ": no folder of poses (output/smplx/smpl, output/smpl/smpl, …) is there; name it");
    return found;
}

/// Images of a folder by number.
inline std::map<long, std::filesystem::path> images_by_number(const std::filesystem::path& folder) {
    std::map<long, std::filesystem::path> files;
    for (const auto& path : list_images(folder))
        if (const long number = number_of(path); number >= 0) files[number] = path;
    return files;
}

/// The image number of each of `count` poses: the pose file's number, or else its position in the sequence of images.
inline std::vector<long> pose_numbers(const std::filesystem::path& poses, const std::filesystem::path& images,
                                      std::size_t count) {
    std::vector<long> numbers;
    if (std::error_code ignored; std::filesystem::is_directory(poses, ignored)) {
        if (const auto place = json_frames_folder(poses); !place.empty())
            for (const NumberedFile& file : list_numbered(place, ".json")) numbers.push_back(file.number);
        else
            for (const NpzFrame& frame : npz_frames(poses)) // of all people
                if (numbers.empty() || numbers.back() != frame.number) numbers.push_back(frame.number);
    }
    if (numbers.empty())
        for (const auto& [number, path] : images_by_number(images)) numbers.push_back(number);
    check_size(poses.string(), "poses", count, numbers.size(), "one per image of " + images.string());
    return numbers;
}

} // namespace detail

template <HostExecutor E>
Capture load_easymocap_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                               const CaptureOptions& options, std::vector<std::string>* warnings) {
    std::error_code ignored;
    Capture capture;
    capture.name = full_path(folder).filename().string();
    capture.cameras = read_easymocap_cameras(folder).cameras;
    const auto poses = detail::easymocap_poses(folder, options.poses);
    MotionFileOptions motion_options{options.hands, 30};
    motion_options.person = options.person;
    motion_options.input_fps = options.input_fps;
    capture.motion = load_any_motion(poses, body, motion_options, warnings);
    const std::size_t C = capture.cameras.size(), F = capture.frame_count();
    const std::vector<long> numbers = detail::pose_numbers(poses, folder / "images" / capture.cameras[0].name, F);

    std::vector<std::string> test = options.test_cameras;
    if (test.empty() && !options.test_frames && C > 2) test.push_back(capture.cameras.back().name);
    for (const std::string& name : test) {
        const auto camera = std::find_if(capture.cameras.begin(), capture.cameras.end(),
                                         [&](const NamedCamera& c) { return c.name == name; });
        if (camera == capture.cameras.end())
            throw IoError((folder / "intri.yml").string() + ": there is no camera '" + detail::shortened(name) +
                          "' to judge by");
        camera->role = NamedCamera::Role::test;
    }
    for (std::size_t f = 0; f < F; ++f)
        if (options.test_frames && options.test_frames->contains(static_cast<int>(f)))
            capture.test_frames.push_back(static_cast<int>(f));
    check_value(!capture.views(false).empty(), folder.string(), "no view is left for training");

    const auto mask_folder =
        std::filesystem::is_directory(folder / "masks", ignored) ? folder / "masks" : folder / "mask";
    const bool masked = std::filesystem::is_directory(mask_folder, ignored);
    detail::PhotoFiles files;
    for (NamedCamera& camera : capture.cameras) {
        const auto append = [&](const std::filesystem::path& place, std::vector<std::filesystem::path>& list) {
            const auto by_number = detail::images_by_number(place / camera.name);
            std::filesystem::path first;
            for (const long number : numbers) {
                const auto file = by_number.find(number);
                list.push_back(file != by_number.end() ? file->second : std::filesystem::path());
                if (first.empty()) first = list.back();
            }
            if (first.empty())
                throw IoError((place / camera.name).string() + ": has no image of the frames " +
                              std::to_string(numbers.front()) + " to " + std::to_string(numbers.back()) + " of " +
                              poses.string());
            return first;
        };
        const auto first = append(folder / "images", files.images);
        if (masked) append(mask_folder, files.masks);
        if (camera.camera.width == 0) {
            const PixelImage image = read_image(first);
            camera.camera.width = image.width, camera.camera.height = image.height;
        }
        if (camera.distortion)
            check_distortion((folder / "intri.yml").string(), camera.name, camera.camera, *camera.distortion);
    }
    detail::load_photos(executor, std::move(files), std::max(1, options.downscale), options, folder, capture, warnings);
    detail::finish_capture(capture, body, options, folder, warnings);
    return capture;
}

} // namespace gsh
