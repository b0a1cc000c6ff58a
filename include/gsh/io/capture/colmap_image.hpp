// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the photographs of a COLMAP reconstruction and undistorts them.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/capture/camera_image.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh {

/// The pinhole camera of the undistorted image: the same pose and focal lengths, and the largest image rectangle inside
/// the undistorted borders, so that no pixel lies outside the photograph.
///
/// Errors  ValueError if the distortion has no inverse at the border, or the image would be empty.
[[nodiscard]] inline Camera<double> straight_camera(std::string_view name, const Camera<double>& camera,
                                                    const Distortion<double>& distortion);

/// An undistorted photograph for training, with its camera.
struct StraightImage {
    PixelImage image; ///< RGBA
    Camera<double> camera;
};

/// Reads an image of the reconstruction and undistorts it. The mask is the image's alpha or, if `masks` is given, the
/// image of the same name (NAME.png, or NAME with the extension .png) in that folder. White pixels are kept. COLMAP
/// ignores the orientation in Exif data, so pixels are taken as stored, unless only the turned picture has the size of
/// the camera.
///
/// Errors  those of read_stored_image, read_mask and mask_meaning; ShapeError unless image and mask have the camera's
///         size.
[[nodiscard]] inline StraightImage read_colmap_image(const ColmapImage& entry, const std::filesystem::path& images,
                                                     const std::filesystem::path& masks = {});

// -------------------------------------------------------------------------------------------------------------

inline Camera<double> straight_camera(std::string_view name, const Camera<double>& camera,
                                      const Distortion<double>& distortion) {
    const double width = camera.width, height = camera.height;
    const auto straight = [&](double x, double y) {
        try {
            return undistort_checked<double>(distortion, {(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy});
        } catch (const ValueError& error) {
            throw ValueError(std::string(name) + ": " + error.what());
        }
    };
    constexpr int steps = 256;
    double left = -1e300, right = 1e300, top = -1e300, bottom = 1e300; // normalised
    for (int i = 0; i <= steps; ++i) {
        const double x = width * i / steps, y = height * i / steps;
        left = std::max(left, straight(0, y).x), right = std::min(right, straight(width, y).x);
        top = std::max(top, straight(x, 0).y), bottom = std::min(bottom, straight(x, height).y);
    }
    Camera<double> result = camera;
    constexpr double inside = 1e-3; // pixels: tolerance for the border between the sampled points
    result.cx = -left * camera.fx - inside, result.cy = -top * camera.fy - inside;
    const double columns = std::floor((right - left) * camera.fx - 2 * inside);
    const double rows = std::floor((bottom - top) * camera.fy - 2 * inside);
    check_value(columns >= 1 && rows >= 1 && columns <= 4 * width && rows <= 4 * height, name,
                "its distortion leaves a straight image of " + detail::number_text(columns) + " x " +
                    detail::number_text(rows) + " pixels; check the coefficients");
    result.width = static_cast<int>(columns), result.height = static_cast<int>(rows);
    check_distortion(name, "its camera", result, distortion);
    return result;
}

inline StraightImage read_colmap_image(const ColmapImage& entry, const std::filesystem::path& images,
                                       const std::filesystem::path& masks) {
    const auto check = [&](const std::filesystem::path& path, const PixelImage& image) {
        if (image.width != entry.camera.width || image.height != entry.camera.height)
            throw ShapeError(path.string() + ": is " + std::to_string(image.width) + " x " +
                             std::to_string(image.height) + " pixels, expected " + std::to_string(entry.camera.width) +
                             " x " + std::to_string(entry.camera.height) +
                             " as its camera says; were the images resized?");
    };
    const auto path_of_photo = detail::named_path(images, entry.name, "the reconstruction");
    StoredImage stored = read_stored_image(path_of_photo);
    detail::CameraImage photo{{}, stored.orientation};
    photo.turned = stored.orientation >= 5 && stored.image.width != entry.camera.width &&
                   stored.image.height == entry.camera.width; // an image that was turned before COLMAP read it
    photo.image = upright(std::move(stored.image), photo.turned ? stored.orientation : 1);
    check(path_of_photo, photo.image);
    if (!masks.empty()) {
        std::error_code ignored;
        std::filesystem::path path = masks / (entry.name + ".png");
        if (!std::filesystem::exists(path, ignored)) path = (masks / entry.name).replace_extension(".png");
        const StoredMask mask = read_mask(path);
        detail::set_alpha(detail::fitted_mask(path, mask, photo), photo.image,
                          mask_meaning(path.string(), mask.levels, false));
    }
    StraightImage result{std::move(photo.image), entry.camera};
    if (!entry.distortion) return result;
    result.camera = straight_camera(path_of_photo.string(), entry.camera, *entry.distortion);
    PixelImage straight(4, result.camera.height, result.camera.width);
    cpu::Serial serial;
    resample_rgba8<double>(serial, Span<const std::uint8_t>(result.image.data), result.image.height, result.image.width,
                           UndistortMap<double>{result.camera, entry.camera, *entry.distortion},
                           Span<std::uint8_t>(straight.data), straight.height, straight.width);
    result.image = std::move(straight);
    return result;
}

} // namespace gsh
