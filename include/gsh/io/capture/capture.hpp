// SPDX-License-Identifier: Apache-2.0
/// @file  Loads and writes captures: a folder with images, masks, cameras and poses of a person.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/camera_image.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Loads DIR/cameras.json, DIR/poses.npz (or other poses) and the images DIR/images/CAMERA/FRAME.png (or .jpg), in the
/// order of their names. The mask is the images' alpha, or DIR/masks/CAMERA/FRAME.png with a white person. A frame may
/// lack the image or the mask of a camera if its files are numbered (detail::assign_frames).
/// DIR/backgrounds/CAMERA.png (or .jpg), for all cameras or none, shows the scene without the person.
/// DIR/hidden/CAMERA/FRAME.png is white where something is in front of the person; any photograph may have one. Images
/// of cameras with distortion are undistorted. `body` is the body model of the poses.
///
/// Errors    IoError, ShapeError, ValueError naming the file: images, poses and cameras that do not match, masks whose
///           meaning is unclear, no view to train on, and all errors of the readers of the single files.
/// Warnings  photographs that are missing, or without a person, which count as not taken, and others of load_photos;
///           probable mistakes, one sentence each with the likely cause, see capture_warnings.
template <HostExecutor E>
[[nodiscard]] Capture load_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                                   const CaptureOptions& options = {}, std::vector<std::string>* warnings = nullptr);

/// Writes the same layout and creates the folder. An image that was not taken becomes one that is transparent
/// everywhere, which load_capture leaves out.
inline void save_capture(const std::filesystem::path& folder, const Capture& capture);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Fills capture.hidden from DIR/hidden/CAMERA/FRAME.png, named as the images. `cameras` are those of the files.
///
/// Errors  IoError for a folder of no camera and a file of no photograph; those of read_mask and fitted_mask.
template <HostExecutor E>
void load_hidden(E& executor, const std::filesystem::path& folder, const std::vector<NamedCamera>& cameras,
                 Capture& capture) {
    const std::size_t frames = capture.frame_count();
    std::vector<std::filesystem::path> files(cameras.size() * frames);
    for (const auto& place : list_folder(folder / "hidden", "a folder of each camera")) {
        const auto camera = std::find_if(cameras.begin(), cameras.end(), [&](const NamedCamera& known) {
            return known.name == place.filename().string();
        });
        if (camera == cameras.end())
            throw IoError(place.string() + ": there is no camera of this name in cameras.json");
        const std::size_t first = static_cast<std::size_t>(camera - cameras.begin()) * frames;
        for (const auto& path : list_images(place)) {
            const auto begin = capture.image_names.begin() + static_cast<std::ptrdiff_t>(first),
                       end = begin + static_cast<std::ptrdiff_t>(frames),
                       name = std::find(begin, end, path.stem().string());
            if (name == end)
                throw IoError(path.string() + ": there is no image of this name in images/" + camera->name);
            files[first + static_cast<std::size_t>(name - begin)] = path;
        }
    }
    capture.hidden.resize(files.size());
    load_all(executor, files.size(), [&](std::size_t i) {
        if (files[i].empty() || !capture.is_taken({i / frames, i % frames})) return;
        const NamedCamera& camera = cameras[i / frames];
        CameraImage photo; // the picture's own size and orientation must be the camera's
        photo.image = PixelImage(4, camera.camera.height, camera.camera.width);
        set_alpha(fitted_mask(files[i], read_mask(files[i]), photo, ", as camera '" + camera.name + "' says"),
                  photo.image);
        if (camera.distortion) photo.image = straighten(photo.image, camera);
        std::vector<std::uint8_t> white(photo.image.data.size() / 4);
        for (std::size_t k = 0; k < white.size(); ++k) white[k] = photo.image.data[4 * k + 3];
        capture.hidden[i] = hidden_pixels(white);
    });
}

} // namespace detail

template <HostExecutor E>
Capture load_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                     const CaptureOptions& options, std::vector<std::string>* warnings) {
    if (std::error_code ignored; !std::filesystem::is_directory(folder, ignored))
        throw IoError(folder.string() + ": is not a folder, expected one with cameras.json, poses.npz and images/");
    Capture capture;
    capture.name = full_path(folder).filename().string();
    CameraList list = read_cameras(folder / "cameras.json");
    capture.cameras = std::move(list.cameras);
    capture.test_frames = std::move(list.test_frames);
    capture.fps = list.fps;
    capture.floor_y = list.floor_y;

    const std::filesystem::path poses = folder / options.poses; // an absolute path replaces the folder
    MotionFileOptions motion_options{options.hands, list.fps};
    motion_options.person = options.person;
    motion_options.input_fps = options.input_fps;
    capture.motion = load_any_motion(poses, body, motion_options, warnings);
    const std::size_t frames = capture.frame_count();
    const bool masked = InputFile(folder / "masks").is_folder();
    detail::PhotoFiles files =
        detail::list_photos(folder, capture.cameras, masked, frames, "one per pose of " + poses.string());

    for (const int frame : capture.test_frames)
        check_value(static_cast<std::size_t>(frame) < frames, (folder / "cameras.json").string(),
                    "test_frames holds " + std::to_string(frame) + ", expected frames below " + std::to_string(frames));
    check_value(!capture.views(false).empty(), (folder / "cameras.json").string(),
                "no view is left for training; give a camera the role train, and leave frames out of test_frames");

    const std::vector<NamedCamera> distorted = capture.cameras;
    detail::load_photos(executor, std::move(files), 1, options, folder, capture, warnings);
    if (InputFile(folder / "backgrounds").is_folder())
        for (const NamedCamera& camera : distorted) {
            const auto path = detail::image_path(folder / "backgrounds", camera.name);
            PixelImage image = detail::read_camera_image(path, camera).image;
            detail::check_opaque(path, image);
            if (camera.distortion) {
                image = detail::straighten(image, camera);
                for (std::size_t i = 3; i < image.data.size(); i += 4)
                    image.data[i] = 255; // pixels outside the photograph become black
            }
            capture.backgrounds.push_back(std::move(image));
        }
    if (InputFile(folder / "hidden").is_folder()) detail::load_hidden(executor, folder, distorted, capture);
    detail::finish_capture(capture, body, options, folder, warnings);
    return capture;
}

inline void save_capture(const std::filesystem::path& folder, const Capture& capture) {
    const std::size_t frames = capture.frame_count();
    if (!capture.stored)
        check_size("save_capture", "images", capture.images.size(), capture.cameras.size() * frames,
                   "store one per camera and frame");
    std::error_code error;
    if (!capture.backgrounds.empty()) {
        check_size("save_capture", "backgrounds", capture.backgrounds.size(), capture.cameras.size(),
                   "store one per camera");
        std::filesystem::create_directories(folder / "backgrounds", error);
        if (error) throw IoError((folder / "backgrounds").string() + ": cannot be created: " + error.message());
        for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
            const auto path = folder / "backgrounds" / (capture.cameras[c].name + ".png");
            detail::check_image_size(path, capture.backgrounds[c], capture.cameras[c]);
            write_png(path, capture.backgrounds[c]);
        }
    }
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const auto images = folder / "images" / capture.cameras[c].name;
        std::filesystem::create_directories(images, error);
        if (error) throw IoError(images.string() + ": cannot be created: " + error.message());
        for (std::size_t f = 0; f < frames; ++f) {
            const std::string digits = std::to_string(f);
            const std::string name = std::string(digits.size() < 4 ? 4 - digits.size() : 0, '0') + digits + ".png";
            const Camera<double>& camera = capture.cameras[c].camera;
            const bool taken = capture.is_taken({c, f});
            const PixelImage image = taken ? capture.read_image({c, f}) : PixelImage(4, camera.height, camera.width);
            detail::check_image_size(images / name, image, capture.cameras[c]);
            write_png(images / name, image);
            const Span<const UnknownPixel> hidden = capture.hidden_in({c, f});
            if (hidden.empty()) continue;
            const auto place = folder / "hidden" / capture.cameras[c].name;
            std::filesystem::create_directories(place, error);
            if (error) throw IoError(place.string() + ": cannot be created: " + error.message());
            PixelImage white(1, camera.height, camera.width);
            for (const UnknownPixel& pixel : hidden) white.data[pixel.index] = 255;
            write_png(place / name, white);
        }
    }
    save_motion(folder / "poses.npz", capture.motion);
    write_cameras(folder / "cameras.json", {capture.cameras, capture.fps, capture.floor_y, capture.test_frames});
}

} // namespace gsh
