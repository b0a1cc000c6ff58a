// SPDX-License-Identifier: Apache-2.0
/// @file  A photograph for training or evaluation, whole or without its empty margins.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// One photograph of a scene: its camera, the frame of the motion that it shows, and its pixels.
///
/// Shapes  rgba [height, width, 4], straight alpha; alpha is the mask of what is learned. With a box, rgba has the
///         pixels of the box alone, and alpha is 0 outside (crop_photo). plate [height, width, 4] is opaque: the
///         camera's view without the person. It is empty for a plain background. The caller owns the memory of all. At
///         unknown pixels the mask is not believed: there the photograph is compared as it is, over the background that
///         is estimated there, or, if they are hidden, not compared. With half_chroma, its colours have half the
///         resolution of its brightness, as in most JPEG files; the render is compared in the same way. Of the gradient
///         of its loss, the share `weight` counts: a photograph whose pose or mask is not believed weighs less.
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
    std::optional<PixelBox> box = {};

    /// The pixels that rgba has.
    [[nodiscard]] PixelBox pixels() const { return box.value_or(whole_picture(camera.height, camera.width)); }
    /// Red, green, blue and alpha of a pixel of the picture.
    [[nodiscard]] const std::uint8_t* pixel(int column, int row) const {
        static constexpr std::uint8_t outside[4] = {};
        const PixelBox inside = pixels();
        return inside.contains(column, row) ? rgba.data() + 4 * inside.index(column, row) : outside;
    }
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
    const PixelBox whole = whole_picture(photo.camera.height, photo.camera.width);
    check_box(where, photo.name + "'s box", photo.pixels(), whole.height, whole.width);
    check_size(where, photo.name, photo.rgba.size(), 4 * photo.pixels().size(),
               photo.box ? "a cropped image must have its box's size" : "the image must have its camera's size");
    if (!photo.plate.empty())
        check_size(where, photo.name + "'s plate", photo.plate.size(), 4 * whole.size(),
                   "a plate is as large as its photograph");
    check_value(photo.weight >= 0 && photo.weight <= 1, where, photo.name + " has a weight outside of [0, 1]");
    const auto width = static_cast<std::uint32_t>(whole.width);
    for (const UnknownPixel& pixel : photo.unknown)
        check_value(pixel.index < whole.size() &&
                        photo.pixels().contains(static_cast<int>(pixel.index % width),
                                                static_cast<int>(pixel.index / width)),
                    where, photo.name + " has an unknown pixel outside of it");
}

/// The smallest box with the mask and the unknown pixels of a whole photograph.
///
/// Errors  ShapeError unless rgba is the whole photograph.
[[nodiscard]] inline PixelBox box_of_photo(const Photo& photo) {
    PixelBox box = box_of_mask(photo.rgba, photo.camera.height, photo.camera.width);
    for (const UnknownPixel& pixel : photo.unknown)
        box.include(static_cast<int>(pixel.index) % photo.camera.width,
                    static_cast<int>(pixel.index) / photo.camera.width);
    return box;
}

/// Reduces a photograph to the box of its mask and of its unknown pixels. Training and evaluation have the same bits as
/// with the whole. Returns the pixels of the box, which the photograph now refers to.
///
/// Errors  those of box_of_photo.
[[nodiscard]] inline std::vector<std::uint8_t> crop_photo(Photo& photo) {
    const PixelBox box = box_of_photo(photo);
    std::vector<std::uint8_t> pixels(4 * box.size());
    copy_pixels(box, photo.rgba, photo.pixels(), pixels, box);
    photo.rgba = Span<const std::uint8_t>(pixels);
    photo.box = box;
    return pixels;
}

/// The pixels [height, width, 4] of a photograph that may be cropped. What was cropped is black and transparent.
[[nodiscard]] inline std::vector<std::uint8_t> whole_photo(const Photo& photo) {
    const PixelBox whole = whole_picture(photo.camera.height, photo.camera.width), box = photo.pixels();
    std::vector<std::uint8_t> pixels(4 * whole.size(), 0);
    copy_pixels(box, photo.rgba, box, pixels, whole);
    return pixels;
}

} // namespace gsh
