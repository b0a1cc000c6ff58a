// SPDX-License-Identifier: Apache-2.0
/// @file  A photograph for training or evaluation: whole or without its empty margins, in memory or read when needed.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// What a source has of a photograph.
struct PhotoContents {
    std::vector<std::uint8_t> rgba; ///< Photo::rgba of the box
    PixelBox box;
    std::vector<UnknownPixel> unknown;
};

/// Where photographs come from that do not stay in memory, for instance files.
class PhotoSource {
public:
    PhotoSource() = default;
    PhotoSource(const PhotoSource&) = delete;
    PhotoSource& operator=(const PhotoSource&) = delete;
    virtual ~PhotoSource() = default;

    /// Reads a photograph, the same each time. Several threads may call this at a time.
    /// Errors  the source's own, IoError for instance.
    [[nodiscard]] virtual PhotoContents read(std::size_t index) const = 0;
};

/// One photograph of a scene: its camera, the frame of the motion that it shows, and its pixels.
///
/// Shapes  rgba [height, width, 4], straight alpha; alpha is the mask of what is learned. With a box, rgba has the
///         pixels of the box alone, and alpha is 0 outside (crop_photo). plate [height, width, 4] is opaque: the
///         camera's view without the person. It is empty for a plain background. The caller owns the memory of all. At
///         unknown pixels the mask is not believed: there the photograph is compared as it is, over the background that
///         is estimated there, or, if they are hidden, not compared. With half_chroma, its colours have half the
///         resolution of its brightness, as in most JPEG files; the render is compared in the same way. Of the gradient
///         of its loss, the share `weight` counts: a photograph whose pose or mask is not believed weighs less. With a
///         source, rgba, unknown and box are empty here; HeldPhoto and PhotoPixels read them.
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
    std::shared_ptr<const PhotoSource> source = {}; ///< null: the pixels are in memory
    std::size_t source_index = 0;                   ///< the source's number of the photograph

    /// The pixels that rgba has.
    [[nodiscard]] PixelBox pixels() const { return box.value_or(whole_picture(camera.height, camera.width)); }
    /// Red, green, blue and alpha of a pixel of the picture.
    [[nodiscard]] const std::uint8_t* pixel(int column, int row) const {
        static constexpr std::uint8_t outside[4] = {};
        const PixelBox inside = pixels();
        return inside.contains(column, row) ? rgba.data() + 4 * inside.index(column, row) : outside;
    }
};

namespace detail {

inline void check_unknown(std::string_view where, std::string_view name, Span<const UnknownPixel> unknown,
                          const PixelBox& box, const PixelBox& whole) {
    const auto width = static_cast<std::uint32_t>(whole.width);
    for (const UnknownPixel& pixel : unknown)
        check_value(pixel.index < whole.size() &&
                        box.contains(static_cast<int>(pixel.index % width), static_cast<int>(pixel.index / width)),
                    where, std::string(name) + " has an unknown pixel outside of it");
}

/// What a source has of a photograph of this size, checked.
inline PhotoContents read_photo(const PhotoSource& source, std::size_t index, int height, int width) {
    constexpr std::string_view where = "PhotoSource";
    const std::string name = "photograph " + std::to_string(index);
    PhotoContents contents = source.read(index);
    check_box(where, name + "'s box", contents.box, height, width);
    check_size(where, name, contents.rgba.size(), 4 * contents.box.size(), "rgba must have its box's size");
    check_unknown(where, name, contents.unknown, contents.box, whole_picture(height, width));
    return contents;
}

} // namespace detail

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
    if (!photo.source)
        check_size(where, photo.name, photo.rgba.size(), 4 * photo.pixels().size(),
                   photo.box ? "a cropped image must have its box's size" : "the image must have its camera's size");
    if (!photo.plate.empty())
        check_size(where, photo.name + "'s plate", photo.plate.size(), 4 * whole.size(),
                   "a plate is as large as its photograph");
    check_value(photo.weight >= 0 && photo.weight <= 1, where, photo.name + " has a weight outside of [0, 1]");
    detail::check_unknown(where, photo.name, photo.unknown, photo.pixels(), whole);
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

/// A photograph whose pixels are in memory while this object lives: its own, or what its source has.
class HeldPhoto {
public:
    /// The photograph's own pixels must outlive this object.
    /// Errors  those of PhotoSource::read; ShapeError, ValueError if what it returns does not fit the photograph.
    explicit HeldPhoto(const Photo& photo) : photo_(photo) {
        const std::shared_ptr<const PhotoSource> source = std::exchange(photo_.source, nullptr);
        if (!source) return;
        contents_ = detail::read_photo(*source, photo_.source_index, photo_.camera.height, photo_.camera.width);
        photo_.rgba = Span<const std::uint8_t>(contents_.rgba);
        photo_.box = contents_.box;
        photo_.unknown = Span<const UnknownPixel>(contents_.unknown);
    }
    HeldPhoto(HeldPhoto&&) = default; // vectors that move keep their elements' addresses
    HeldPhoto& operator=(HeldPhoto&&) = default;

    [[nodiscard]] const Photo& operator*() const { return photo_; }
    [[nodiscard]] const Photo* operator->() const { return &photo_; }

private:
    Photo photo_;
    PhotoContents contents_;
};

} // namespace gsh
