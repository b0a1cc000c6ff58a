// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs of one moment, for a static scene: a frame of a capture, or a reconstruction of COLMAP.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/colmap_image.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/setup/static_start.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Photographs of one moment, and points that the scene starts from.
struct StaticPhotos {
    std::string name;
    std::vector<PixelImage> images; ///< the pixels of the photographs
    std::vector<Photo> training, test;
    std::vector<std::string> warnings;   ///< of the reader
    std::optional<ColoredPoints> points; ///< of structure from motion; else the masks' visual hull is filled

    StaticPhotos() = default;
    StaticPhotos(StaticPhotos&&) = default; // a move keeps the addresses of the pixels, a copy would not
    StaticPhotos& operator=(StaticPhotos&&) = default;
};

/// One frame of a capture in memory. Cameras with the role test are not used for training.
/// Errors  ValueError for a frame that the capture does not have.
[[nodiscard]] inline StaticPhotos static_photos_of(const Capture& capture, std::size_t frame);

/// Loads a folder. A folder with cameras.json is a capture, of which only the cameras and the images of one frame are
/// read; it needs neither a body nor poses. Any other folder is a reconstruction of COLMAP: FOLDER/sparse/0 (or FOLDER
/// itself), FOLDER/images, and FOLDER/masks if it exists. Every eighth image by name, beginning with the first one, is
/// a test image, and photographs whose mask is empty are left out.
///
/// Errors  IoError, ValueError that name the file.
template <HostExecutor E>
[[nodiscard]] StaticPhotos load_static_photos(E& executor, const std::filesystem::path& folder, std::size_t frame = 0);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline void add_photo(StaticPhotos& input, const std::string& name, const Camera<double>& camera, PixelImage image,
                      bool test, std::size_t frame = 0) {
    input.images.push_back(std::move(image)); // the addresses of the pixels do not change when the list grows
    (test ? input.test : input.training).push_back({name, camera, frame, input.images.back().data});
}

/// One frame of the capture in a folder.
template <HostExecutor E>
StaticPhotos load_capture_frame(E& executor, const std::filesystem::path& folder, std::size_t frame) {
    StaticPhotos input;
    input.name = full_path(folder).filename().string() + ", frame " + std::to_string(frame);
    Capture capture; // its frames are this one
    capture.cameras = read_cameras(folder / "cameras.json").cameras;
    capture.motion.transl.resize(1);
    const PhotoFiles all = list_photos(folder, capture.cameras, InputFile(folder / "masks").is_folder(), 0,
                                       "as many as the other cameras have");
    const std::size_t frames = all.images.size() / std::max<std::size_t>(1, capture.cameras.size());
    check_value(frame < frames, (folder / "images").string(),
                "has images of " + std::to_string(frames) + " frames, expected frame " + std::to_string(frame) +
                    " among them");
    PhotoFiles files; // of this frame
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        files.images.push_back(all.images[c * frames + frame]);
        if (!all.masks.empty()) files.masks.push_back(all.masks[c * frames + frame]);
    }
    load_photos(executor, std::move(files), 1, {}, folder, capture, &input.warnings);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const NamedCamera& camera = capture.cameras[c];
        if (capture.is_taken({c, 0}))
            add_photo(input, camera.name, camera.camera, std::move(capture.images[c]),
                      camera.role == NamedCamera::Role::test, frame);
    }
    return input;
}

/// A reconstruction of COLMAP.
inline StaticPhotos load_colmap_photos(const std::filesystem::path& folder) {
    constexpr std::size_t hold = 8; // as in 3DGS
    ColmapScene scene = read_colmap(folder);
    StaticPhotos input;
    input.name = full_path(folder).filename().string();
    const std::filesystem::path masks = InputFile(folder / "masks").is_folder() ? folder / "masks" : "";
    std::vector<std::string> empty;
    for (std::size_t i = 0; i < scene.images.size(); ++i) {
        StraightImage straight = read_colmap_image(scene.images[i], folder / "images", masks);
        std::string name = std::filesystem::path(scene.images[i].name).replace_extension().string();
        std::replace(name.begin(), name.end(), '/', '_');
        if (shows_person(straight.image))
            add_photo(input, name, straight.camera, std::move(straight.image), i % hold == 0);
        else
            empty.push_back(scene.images[i].name);
    }
    check_value(!input.training.empty(), folder.string(), "no photograph for training has a mask that shows something");
    if (!empty.empty())
        input.warnings.push_back(folder.string() + ": " + std::to_string(empty.size()) +
                                 " photographs have an empty mask and are left out: " +
                                 listing(empty.size(), 6, [&](std::size_t i) { return empty[i]; }));
    if (!scene.points.empty()) input.points = ColoredPoints{std::move(scene.points), std::move(scene.colors)};
    return input;
}

} // namespace detail

inline StaticPhotos static_photos_of(const Capture& capture, std::size_t frame) {
    check_value(frame < capture.frame_count(), capture.name,
                "has " + std::to_string(capture.frame_count()) + " frames, expected frame " + std::to_string(frame) +
                    " among them");
    StaticPhotos input;
    input.name = capture.name + ", frame " + std::to_string(frame);
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const NamedCamera& camera = capture.cameras[c];
        if (capture.is_taken({c, frame}))
            detail::add_photo(input, camera.name, camera.camera, capture.read_image({c, frame}),
                              camera.role == NamedCamera::Role::test, frame);
    }
    return input;
}

template <HostExecutor E>
StaticPhotos load_static_photos(E& executor, const std::filesystem::path& folder, std::size_t frame) {
    std::error_code ignored;
    return std::filesystem::exists(folder / "cameras.json", ignored)
               ? detail::load_capture_frame(executor, folder, frame)
               : detail::load_colmap_photos(folder);
}

} // namespace gsh
