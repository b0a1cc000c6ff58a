// SPDX-License-Identifier: Apache-2.0
/// @file  The last steps of a reader of captures: photographs with their masks, motion that is held out, warnings.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/pixel_box.hpp>
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
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Files of images and of their masks, [cameras * frames]; an empty path where a frame has none. Without any masks, the
/// images' alpha is the mask.
struct PhotoFiles {
    std::vector<std::filesystem::path> images, masks;
};

/// A photograph while a capture is read.
struct PhotoState {
    MaskLevels levels;
    bool pending = false;   ///< whether the masks of the whole camera decide what its numbers mean
    bool ambiguous = false; ///< CameraImage::ambiguous
};

/// Whether the masks of a camera that are not plain are binary: all but 0 is the person.
inline bool are_binary(const std::vector<std::filesystem::path>& files, const NamedCamera& camera, std::size_t first,
                       std::size_t frames, const std::vector<PhotoState>& states, const std::string& folder,
                       std::vector<std::string>* warnings) {
    MaskLevels all;
    bool plain = false;
    std::optional<std::size_t> pending; // the first one
    for (std::size_t i = first; i < first + frames; ++i) {
        all.add(states[i].levels);
        plain = plain || (states[i].levels.plain() && !states[i].levels.unit);
        if (states[i].pending && !pending) pending = i;
    }
    if (!pending) return false;
    const std::string others = frames > 1 ? " and the other masks of camera '" + shortened(camera.name) + "'" : "";
    if (mask_meaning(files[*pending].string() + others, all, plain) == MaskMeaning::soft) return false;
    if (warnings)
        warnings->push_back(folder + ": the masks of camera '" + shortened(camera.name) + "' hold " + level_text(all) +
                            " instead of 0 and 255, so all but 0 is taken for the person");
    return true;
}

/// Reads the photographs of a capture from their files: with their masks, undistorted, at 1/factor of their size.
class PhotoFileReader : public StoredImages {
public:
    /// `cameras`: those of the files, one for each `frames` of them.
    PhotoFileReader(PhotoFiles files, std::vector<NamedCamera> cameras, std::size_t frames, int factor)
        : files_(std::move(files)), cameras_(std::move(cameras)), frames_(frames), factor_(factor),
          binary_(files_.images.size(), 0) {}

    [[nodiscard]] const PhotoFiles& files() const { return files_; }
    [[nodiscard]] const std::vector<NamedCamera>& cameras() const { return cameras_; }
    [[nodiscard]] bool is_missing(std::size_t i) const {
        return files_.images[i].empty() || (!files_.masks.empty() && files_.masks[i].empty());
    }
    /// From now on, all but 0 of the photograph's mask is the person.
    void set_binary(std::size_t i) { binary_[i] = 1; }

    [[nodiscard]] PixelImage read(std::size_t i) const override {
        PhotoState state;
        return finished(i, as_stored(i, state));
    }
    /// A photograph and its mask as they are stored.
    [[nodiscard]] PixelImage as_stored(std::size_t i, PhotoState& state) const {
        CameraImage photo = read_camera_image(files_.images[i], cameras_[i / frames_]);
        state.ambiguous = photo.ambiguous;
        if (files_.masks.empty()) {
            state.levels = alpha_levels(photo.image);
        } else {
            const StoredMask mask = read_mask(files_.masks[i]);
            set_alpha(fitted_mask(files_.masks[i], mask, photo), photo.image);
            state.levels = mask.levels;
        }
        state.pending = !state.levels.plain() && !state.levels.empty();
        return std::move(photo.image);
    }
    /// What read() makes of it.
    [[nodiscard]] PixelImage finished(std::size_t i, PixelImage image) const {
        if (binary_[i] != 0)
            for (std::size_t n = 3; n < image.data.size(); n += 4) image.data[n] = image.data[n] != 0 ? 255 : 0;
        const NamedCamera& camera = cameras_[i / frames_];
        if (camera.distortion) image = straighten(image, camera);
        if (factor_ != 1) image = shrink(image, factor_);
        return image;
    }

private:
    PhotoFiles files_;
    std::vector<NamedCamera> cameras_;
    std::size_t frames_;
    int factor_;
    std::vector<std::uint8_t> binary_; // of each photograph: set_binary
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

/// Fills capture.images from files, undistorted and at 1/factor of their size; or capture.stored, if they take more
/// than options.image_memory. The capture's cameras become those of these images. A photograph counts as not taken if
/// its image or its mask is missing, or if its mask nowhere exceeds 1/2, unless options.empty_masks.
///
/// Errors    IoError, ShapeError, ValueError naming the file: sizes that are not the camera's, masks whose meaning is
///           unclear, no training photograph with a person, a factor that does not divide the size.
/// Warnings  photographs that are not taken, masks of small numbers, orientations that sizes do not confirm.
template <HostExecutor E>
void load_photos(E& executor, PhotoFiles photo_files, int factor, const CaptureOptions& options,
                 const std::filesystem::path& folder, Capture& capture, std::vector<std::string>* warnings) {
    const std::size_t frames = capture.frame_count(), count = photo_files.images.size();
    const auto reader = std::make_shared<PhotoFileReader>(std::move(photo_files), capture.cameras, frames, factor);
    const std::vector<std::filesystem::path>&images = reader->files().images, &masks = reader->files().masks;
    const std::vector<NamedCamera>& full = reader->cameras();
    for (NamedCamera& camera : capture.cameras) {
        camera.camera = shrink(camera.camera, factor, folder.string());
        camera.distortion.reset();
    }
    capture.image_names.clear();
    for (const auto& path : images) capture.image_names.push_back(path.stem().string());
    std::uint64_t bytes = 0;
    for (std::size_t i = 0; i < count; ++i) {
        const Camera<double>& camera = capture.cameras[i / frames].camera;
        if (!reader->is_missing(i)) bytes += 4 * whole_picture(camera.height, camera.width).size();
    }
    const bool holds = options.image_memory == 0 || bytes <= options.image_memory;
    if (holds) capture.images.resize(count);

    std::vector<PhotoState> states(count);
    reader->facts.resize(count);
    reader->memory = options.image_memory;
    const auto finish = [&](std::size_t i, PixelImage image) {
        image = reader->finished(i, std::move(image));
        StoredImages::Facts& facts = reader->facts[i];
        if (holds) { // the other facts are asked of the image
            facts.taken = true, facts.shows_person = shows_person(image);
            capture.images[i] = std::move(image);
        } else {
            facts = StoredImages::facts_of(image);
        }
    };
    load_all(executor, count, [&](std::size_t i) {
        if (reader->is_missing(i)) return;
        PixelImage image = reader->as_stored(i, states[i]);
        if (!states[i].pending)
            finish(i, std::move(image));
        else if (holds)
            capture.images[i] = std::move(image);
    });
    for (std::size_t c = 0; c < full.size(); ++c)
        if (are_binary(masks.empty() ? images : masks, full[c], c * frames, frames, states, folder.string(), warnings))
            for (std::size_t i = c * frames; i < (c + 1) * frames; ++i)
                if (states[i].pending) reader->set_binary(i);
    load_all(executor, count, [&](std::size_t i) {
        PhotoState again;
        if (states[i].pending) finish(i, holds ? std::move(capture.images[i]) : reader->as_stored(i, again));
    });
    if (!holds) capture.stored = reader;

    std::vector<std::size_t> missing, unmasked, empty, ambiguous;
    for (std::size_t i = 0; i < count; ++i) {
        if (states[i].ambiguous) ambiguous.push_back(i);
        if (reader->is_missing(i)) {
            (images[i].empty() ? missing : unmasked).push_back(i);
        } else if (!options.empty_masks && !reader->facts[i].shows_person) {
            empty.push_back(i);
            if (holds) capture.images[i] = {};
            reader->facts[i].taken = false;
        }
    }
    const auto name = [&](std::size_t i) {
        return images[i].empty()
                   ? "camera '" + shortened(full[i / frames].name) + "' frame " + std::to_string(i % frames)
                   : images[i].lexically_relative(folder).string();
    };
    const auto warn = [&](const std::vector<std::size_t>& which, const std::string& before, const std::string& after) {
        if (!which.empty() && warnings)
            warnings->push_back(folder.string() + ": " + std::to_string(which.size()) + " of " + std::to_string(count) +
                                " photographs " + before +
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
