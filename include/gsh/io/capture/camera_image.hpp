// SPDX-License-Identifier: Apache-2.0
/// @file  The photographs of a capture in the orientation of their cameras, and the masks that belong to them.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>

namespace gsh::detail {

inline void check_image_size(const std::filesystem::path& path, const PixelImage& image, const NamedCamera& camera,
                             const std::string& how = {}) {
    if (image.width != camera.camera.width || image.height != camera.camera.height)
        throw ShapeError(path.string() + ": is " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                         " pixels" + how + ", expected " + std::to_string(camera.camera.width) + " x " +
                         std::to_string(camera.camera.height) + " as camera '" + camera.name + "' says");
}

/// A photograph or a background, in the orientation of its camera.
struct CameraImage {
    PixelImage image;
    int orientation = 1;    ///< what its Exif data state
    bool turned = false;    ///< whether it was turned so
    bool ambiguous = false; ///< whether its size would also fit the other way, as for half a turn
};

/// Reads an image of a camera. An orientation in its Exif data is applied, as OpenCV and viewers do, unless only the
/// picture as stored has the camera's size: then the camera was calibrated on pixels as they are stored.
///
/// Errors  those of read_stored_image; ShapeError for another size.
inline CameraImage read_camera_image(const std::filesystem::path& path, const NamedCamera& named) {
    const Camera<double>& camera = named.camera;
    StoredImage stored = read_stored_image(path);
    CameraImage result{{}, stored.orientation};
    const bool as_stored = stored.image.width == camera.width && stored.image.height == camera.height;
    const bool on_its_side = stored.orientation >= 5, square = stored.image.width == stored.image.height;
    result.turned = stored.orientation != 1 && !(on_its_side && !square && as_stored);
    result.ambiguous = stored.orientation != 1 && (!on_its_side || square);
    result.image = upright(std::move(stored.image), result.turned ? stored.orientation : 1);
    check_image_size(path, result.image, named,
                     result.turned && on_its_side ? ", turned as its Exif orientation states" : "");
    return result;
}

/// A mask in the orientation of its photograph: it is turned by its own Exif data, or as the photograph is if its size
/// shows that it was made of the picture as stored.
///
/// Errors  ShapeError for another size; `whose` ends the message.
inline PixelImage fitted_mask(const std::filesystem::path& path, const StoredMask& mask, const CameraImage& photo,
                              const std::string& whose = {}) {
    const PixelImage& image = photo.image;
    const auto fits = [&](int width, int height) { return width == image.width && height == image.height; };
    const bool square = mask.values.width == mask.values.height;
    int turn = mask.orientation;
    if (turn >= 5 && !square && fits(mask.values.width, mask.values.height)) turn = 1;
    if (turn == 1 && photo.orientation >= 5 && !square && fits(mask.values.height, mask.values.width)) {
        constexpr std::array<int, 9> back{1, 1, 2, 3, 4, 5, 8, 7, 6};
        turn = photo.turned ? photo.orientation : back[static_cast<std::size_t>(photo.orientation)];
    }
    PixelImage result = upright(mask.values, turn);
    if (!fits(result.width, result.height))
        throw ShapeError(path.string() + ": is " + std::to_string(mask.values.width) + " x " +
                         std::to_string(mask.values.height) + " pixels, expected " + std::to_string(image.width) +
                         " x " + std::to_string(image.height) + whose);
    return result;
}

/// Sets an image's alpha to a mask of its size; 255 for every number but 0 if the mask is binary.
inline void set_alpha(const PixelImage& mask, PixelImage& image, MaskMeaning meaning = MaskMeaning::soft) {
    for (std::size_t i = 0; i < mask.data.size(); ++i) {
        const std::uint8_t value = mask.data[i];
        image.data[4 * i + 3] = meaning == MaskMeaning::binary && value != 0 ? 255 : value;
    }
}

} // namespace gsh::detail
