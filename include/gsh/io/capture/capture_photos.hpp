// SPDX-License-Identifier: Apache-2.0
/// @file  The last steps of a reader of captures: photographs with their masks, motion that is held out, warnings.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_image.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_warnings.hpp>
#include <gsh/io/capture/frame_files.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::detail {

/// A photograph while a capture is read.
struct PhotoState {
    MaskLevels levels;
    bool pending = false;   ///< whether the masks of the whole camera decide what its numbers mean
    bool ambiguous = false; ///< CameraImage::ambiguous
};

/// Decides what the masks of a camera mean that are not plain, and sets the alpha of binary ones.
template <HostExecutor E>
void settle_masks(E& executor, const std::vector<std::filesystem::path>& files, const NamedCamera& camera,
                  std::size_t first, std::size_t frames, const std::vector<PhotoState>& states, Capture& capture,
                  const std::string& folder, std::vector<std::string>* warnings) {
    MaskLevels all;
    bool plain = false;
    std::vector<std::size_t> pending;
    for (std::size_t i = first; i < first + frames; ++i) {
        all.add(states[i].levels);
        plain = plain || (states[i].levels.plain() && !states[i].levels.unit);
        if (states[i].pending) pending.push_back(i);
    }
    if (pending.empty()) return;
    const std::string others = frames > 1 ? " and the other masks of camera '" + shortened(camera.name) + "'" : "";
    if (mask_meaning(files[pending[0]].string() + others, all, plain) == MaskMeaning::soft) return;
    if (warnings)
        warnings->push_back(folder + ": the masks of camera '" + shortened(camera.name) + "' hold " + level_text(all) +
                            " instead of 0 and 255, so all but 0 is taken for the person");
    executor.for_chunks(pending.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t k = begin; k < end; ++k) {
            PixelImage& image = capture.images[pending[k]];
            for (std::size_t n = 3; n < image.data.size(); n += 4) image.data[n] = image.data[n] != 0 ? 255 : 0;
        }
    });
}

/// Files of images and of their masks, [cameras * frames]; an empty path where a frame has none. Without any masks, the
/// images' alpha is the mask.
struct PhotoFiles {
    std::vector<std::filesystem::path> images, masks;
};

/// The files FOLDER/images/CAMERA/FRAME, and FOLDER/masks/CAMERA/FRAME if there are `masks`.
///
/// @param frames, reason  as in assign_frames.
/// Errors  those of list_images and assign_frames.
inline PhotoFiles list_photos(const std::filesystem::path& folder, const std::vector<NamedCamera>& cameras, bool masks,
                              std::size_t frames, const std::string& reason) {
    std::vector<std::filesystem::path> folders;
    std::vector<std::vector<std::filesystem::path>> lists;
    for (const char* kind : {"images", "masks"})
        for (const NamedCamera& camera : cameras)
            if (kind[0] == 'i' || masks) {
                folders.push_back(folder / kind / camera.name);
                lists.push_back(list_images(folders.back()));
            }
    PhotoFiles files;
    for (auto& row : assign_frames(std::move(lists), folders, frames, reason).rows) {
        auto& of_kind = files.images.size() < cameras.size() * row.size() ? files.images : files.masks;
        of_kind.insert(of_kind.end(), row.begin(), row.end());
    }
    return files;
}

/// Fills capture.images from files, undistorted and at 1/factor of their size. The capture's cameras become those of
/// these images. A photograph counts as not taken if its image or its mask is missing, or if its mask nowhere exceeds
/// 1/2, unless options.empty_masks.
///
/// Errors    IoError, ShapeError, ValueError naming the file: sizes that are not the camera's, masks whose meaning is
///           unclear, no training photograph with a person, a factor that does not divide the size.
/// Warnings  photographs that are not taken, masks of small numbers, orientations that sizes do not confirm.
template <HostExecutor E>
void load_photos(E& executor, const PhotoFiles& files, int factor, const CaptureOptions& options,
                 const std::filesystem::path& folder, Capture& capture, std::vector<std::string>* warnings) {
    const std::vector<std::filesystem::path>& images = files.images;
    const std::vector<std::filesystem::path>& masks = files.masks;
    const std::vector<NamedCamera> full = capture.cameras;
    const std::size_t frames = capture.frame_count();
    for (NamedCamera& camera : capture.cameras) {
        camera.camera = shrink(camera.camera, factor, folder.string());
        camera.distortion.reset();
    }
    capture.images.resize(images.size());
    capture.image_names.clear();
    for (const auto& path : images) capture.image_names.push_back(path.stem().string());
    std::vector<PhotoState> states(images.size());
    const auto finish = [&](std::size_t i) {
        PixelImage& image = capture.images[i];
        const NamedCamera& camera = full[i / frames];
        if (camera.distortion) image = straighten(image, camera);
        if (factor != 1) image = shrink(image, factor);
    };
    const auto is_missing = [&](std::size_t i) { return images[i].empty() || (!masks.empty() && masks[i].empty()); };
    load_all(executor, images.size(), [&](std::size_t i) {
        if (is_missing(i)) return;
        PhotoState& state = states[i];
        CameraImage photo = read_camera_image(images[i], full[i / frames]);
        state.ambiguous = photo.ambiguous;
        if (masks.empty()) {
            state.levels = alpha_levels(photo.image);
        } else {
            const StoredMask mask = read_mask(masks[i]);
            set_alpha(fitted_mask(masks[i], mask, photo), photo.image);
            state.levels = mask.levels;
        }
        state.pending = !state.levels.plain() && !state.levels.empty();
        capture.images[i] = std::move(photo.image);
        if (!state.pending) finish(i);
    });
    for (std::size_t c = 0; c < full.size(); ++c)
        settle_masks(executor, masks.empty() ? images : masks, full[c], c * frames, frames, states, capture,
                     folder.string(), warnings);
    load_all(executor, images.size(), [&](std::size_t i) {
        if (states[i].pending) finish(i);
    });

    std::vector<std::size_t> missing, unmasked, empty, ambiguous;
    for (std::size_t i = 0; i < images.size(); ++i) {
        if (states[i].ambiguous) ambiguous.push_back(i);
        if (is_missing(i))
            (images[i].empty() ? missing : unmasked).push_back(i);
        else if (!options.empty_masks && !shows_person(capture.images[i]))
            empty.push_back(i), capture.images[i] = {};
    }
    const auto name = [&](std::size_t i) {
        return images[i].empty()
                   ? "camera '" + shortened(full[i / frames].name) + "' frame " + std::to_string(i % frames)
                   : images[i].lexically_relative(folder).string();
    };
    const auto warn = [&](const std::vector<std::size_t>& which, const std::string& before, const std::string& after) {
        if (!which.empty() && warnings)
            warnings->push_back(folder.string() + ": " + std::to_string(which.size()) + " of " +
                                std::to_string(images.size()) + " photographs " + before +
                                listing(which.size(), 6, [&](std::size_t k) { return name(which[k]); }) + after);
    };
    if (!empty.empty())
        check_value(!capture.views(false).empty(), (masks.empty() ? images : masks)[empty[0]].string(),
                    "its mask (alpha) is empty, as are those of all photographs for training; expected a person");
    check_value(!capture.views(false).empty(), folder.string(),
                "no photograph for training has both its image and its mask");
    warn(missing, "are missing and are left out: ", "");
    warn(unmasked, "have no mask and are left out: ", "");
    warn(empty, "have an empty mask and are left out: ", "");
    warn(ambiguous, "were turned as their Exif orientation states: ",
         "; their cameras, poses and masks must be those of the turned pictures, as OpenCV reads them");
}

/// Holds out the motion that options name, and appends the capture's warnings.
inline void finish_capture(Capture& capture, const BodyModel& body, const CaptureOptions& options,
                           const std::filesystem::path& folder, std::vector<std::string>* warnings) {
    if (options.hold_out) hold_out_motion(capture, *options.hold_out);
    if (warnings)
        for (const std::string& text : capture_warnings(capture, body))
            warnings->push_back(folder.string() + ": " + text);
}

} // namespace gsh::detail
