// SPDX-License-Identifier: Apache-2.0
/// @file  A photograph over a background that is composited where it is read.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>

namespace gsh {

/// What composite_rgba8 would write, or its mask, without memory of its own: kernels on a device read bytes instead of
/// a picture that another kernel has to write first. It refers to its pixels and background.
///
/// Shapes  rgba [box.height, box.width, 4] in the backend's memory; α is 0 outside of the box. The background is a
///         colour, or an image [3, height, width].
/// Units   display-referred sRGB.
template <std::floating_point T>
struct CompositePicture {
    Span<const std::uint8_t> rgba;
    PixelBox box;
    vec3<T> color;
    ImageView<const T> image = {}; ///< replaces the colour unless it is empty
    int height = 0, width = 0;
    int channels = 3; ///< 1: the mask

    [[nodiscard]] CompositePicture mask() const {
        CompositePicture result = *this;
        result.channels = 1;
        return result;
    }
    [[nodiscard]] GSH_HD T at(int channel, int y, int x) const {
        const bool is_mask = channels == 1, inside = box.contains(x, y);
        const std::size_t pixel = inside ? 4 * box.index(x, y) : 0;
        const T alpha = inside ? T(rgba[pixel + 3]) / T(255) : T(0);
        if (is_mask) return alpha;
        const T background = image.data.empty() ? color[channel] : image.at(channel, y, x);
        if (!inside) return background;
        return detail::composite_over(T(rgba[pixel + static_cast<std::size_t>(channel)]) / T(255), alpha, background);
    }
};

/// Errors  ShapeError for an image that has not the given channels and size; MemoryError.
template <Backend B, class T>
void check_picture(const B& backend, std::string_view where, std::string_view name, const ImageView<T>& image,
                   int channels, int height, int width) {
    check_image(where, name, image, channels, height, width);
    check_memory(backend, where, name, image);
}
/// Errors  ShapeError for a picture that has not the given channels and size, or not the pixels of its box; ValueError
///         for a box that is not inside of the picture; MemoryError.
template <Backend B, class T>
void check_picture(const B& backend, std::string_view where, std::string_view name, const CompositePicture<T>& picture,
                   int channels, int height, int width) {
    detail::check_shape(where, name, picture, channels, height, width);
    check_box(where, "box", picture.box, height, width);
    check_size(where, name, picture.rgba.size(), 4 * picture.box.size(),
               "give four bytes a pixel: red, green, blue, alpha");
    check_memory(backend, where, name, picture.rgba);
    if (picture.image.data.empty()) return;
    check_image(where, "background", picture.image, 3, height, width);
    check_memory(backend, where, "background", picture.image);
}

} // namespace gsh
