// SPDX-License-Identifier: Apache-2.0
/// @file  A photograph for training or evaluation.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/trimap.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

/// One photograph of a scene: its camera, the frame of the motion that it shows, and its pixels.
///
/// Shapes  rgba [height, width, 4], straight alpha; alpha is the mask of what is learned. plate has the same shape and
///         is opaque: the camera's view without the person. It is empty for a plain background. The caller owns the
///         memory of all. At unknown pixels the mask is not believed: there the photograph is compared as it is, over
///         the background that is estimated there. With half_chroma, its colours have half the resolution of its
///         brightness, as in most JPEG files; the render is compared in the same way. Of the gradient of its loss,
///         the share `weight` counts: a photograph whose pose or mask is not believed weighs less.
struct Photo {
    std::string name;
    Camera<double> camera;
    std::size_t frame = 0; ///< of the motion
    Span<const std::uint8_t> rgba;
    std::size_t camera_index = 0; ///< among the capture's cameras
    Span<const std::uint8_t> plate = {};
    Span<const UnknownPixel> unknown = {};
    bool half_chroma = false;
    double weight = 1; ///< in [0, 1], in steps of 1/255
};

/// Checks a photograph before it is used.
///
/// Errors  ShapeError unless photograph and plate have their camera's size; ValueError unless the photograph's frame is
///         below frame_count and its weight in [0, 1].
inline void check_photo(std::string_view where, const Photo& photo, std::size_t frame_count) {
    check_camera(where, photo.name, photo.camera);
    check_value(photo.frame < frame_count, where,
                photo.name + " shows frame " + std::to_string(photo.frame) + ", which does not exist; the motion has " +
                    std::to_string(frame_count) + " frames");
    check_size(where, photo.name, photo.rgba.size(),
               4 * static_cast<std::size_t>(photo.camera.width) * static_cast<std::size_t>(photo.camera.height),
               "the image must have its camera's size");
    if (!photo.plate.empty())
        check_size(where, photo.name + "'s plate", photo.plate.size(), photo.rgba.size(),
                   "a plate is as large as its photograph");
    check_value(photo.weight >= 0 && photo.weight <= 1, where, photo.name + " has a weight outside of [0, 1]");
    for (const UnknownPixel& pixel : photo.unknown)
        check_value(pixel.index < photo.rgba.size() / 4, where, photo.name + " has an unknown pixel outside of it");
}

} // namespace gsh
