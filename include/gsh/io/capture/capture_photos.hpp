// SPDX-License-Identifier: Apache-2.0
/// @file  The last steps of a reader of captures: photographs with their masks, motion that is held out, warnings.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_images.hpp>
#include <gsh/io/capture/capture_warnings.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Sets alpha from a mask: an array of 0 and 1 (or up to 255), or an image.
inline void apply_mask_file(const std::filesystem::path& path, PixelImage& image) {
    const auto fail = [&](const std::string& found) {
        throw ShapeError(path.string() + ": is " + found + " pixels, expected " + std::to_string(image.width) + " x " +
                         std::to_string(image.height));
    };
    if (path.extension() != ".npy") {
        const PixelImage mask = read_image(path);
        if (mask.width != image.width || mask.height != image.height)
            fail(std::to_string(mask.width) + " x " + std::to_string(mask.height));
        return apply_mask(mask, image);
    }
    const NpyArray<float> mask = read_npy<float>(path, Numbers::any);
    const std::size_t pixels = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
    const bool fits =
        mask.size() == pixels && mask.shape.size() >= 2 && mask.dim(0) == static_cast<std::size_t>(image.height);
    if (!fits) fail("an array " + shape_text(mask.shape) + " of");
    const auto [low, high] = std::minmax_element(mask.data.begin(), mask.data.end());
    check_value(*low >= 0 && *high <= 255, path.string(),
                "holds " + detail::number_text(*low < 0 ? *low : *high) + ", expected 0 to 1, or 0 to 255");
    const float scale = *high <= 1 ? 255.0f : 1.0f;
    for (std::size_t i = 0; i < pixels; ++i) image.data[4 * i + 3] = static_cast<std::uint8_t>(mask[i] * scale + 0.5f);
}

/// Fills capture.images from files [cameras * frames], undistorted and at 1/factor of their size. The capture's cameras
/// become those of these images. Masks are in files of their own [cameras * frames]; if there are none, the images'
/// alpha is the mask.
///
/// Errors  IoError, ShapeError, ValueError naming the file: sizes that are not the camera's, a mask that is empty
///         everywhere (unless options.empty_masks), a factor that does not divide the size.
template <HostExecutor E>
void load_photos(E& executor, const std::vector<std::filesystem::path>& images,
                 const std::vector<std::filesystem::path>& masks, int factor, const CaptureOptions& options,
                 const std::filesystem::path& folder, Capture& capture) {
    const std::vector<NamedCamera> full = capture.cameras;
    const std::size_t frames = capture.frame_count();
    for (NamedCamera& camera : capture.cameras) {
        camera.camera = shrink(camera.camera, factor, folder.string());
        camera.distortion.reset();
    }
    capture.images.resize(images.size());
    load_all(executor, images.size(), [&](std::size_t i) {
        const NamedCamera& camera = full[i / frames];
        PixelImage image = read_image(images[i]);
        check_image_size(images[i], image, camera);
        if (!masks.empty()) apply_mask_file(masks[i], image);
        if (!options.empty_masks) check_mask(masks.empty() ? images[i] : masks[i], image);
        if (camera.distortion) image = straighten(image, camera);
        capture.images[i] = factor == 1 ? std::move(image) : shrink(image, factor);
    });
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
