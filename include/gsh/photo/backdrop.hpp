// SPDX-License-Identifier: Apache-2.0
/// @file  The background of render and photograph: a plain colour, or a plate photographed without the person.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/composite_picture.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/target.hpp>

#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

namespace detail {

/// For how many pixels the kernels of unknown pixels run. Photographs with about as many have the same number, so that
/// a recorded step (RepeatedStep) stays the same.
[[nodiscard]] inline std::size_t unknown_slots(std::size_t unknown) { return unknown ? std::bit_ceil(unknown) : 0; }

/// Writes the background of unknown pixels that are not hidden.
template <class T>
struct UnknownBackground {
    Span<const UnknownPixel> unknown;
    Span<T> plate; // [3, plane]
    GSH_HD void operator()(std::size_t i) const {
        if (i >= unknown.size() || unknown[i].hidden) return;
        const UnknownPixel& pixel = unknown[i];
        for (std::size_t c = 0; c < 3; ++c)
            plate[c * (plate.size() / 3) + pixel.index] = T(pixel.background[c]) / T(255);
    }
};
/// Writes a photograph's own colours at unknown pixels.
template <class T>
struct UnknownColors {
    Span<const UnknownPixel> unknown;
    Span<const std::uint8_t> rgba;
    PixelBox box; // of rgba
    std::uint32_t width;
    Span<T> color; // [3, plane]
    GSH_HD void operator()(std::size_t i) const {
        if (i >= unknown.size()) return;
        const std::uint32_t at = unknown[i].index;
        const std::size_t pixel = box.index(static_cast<int>(at % width), static_cast<int>(at / width));
        for (std::size_t c = 0; c < 3; ++c) color[c * (color.size() / 3) + at] = T(rgba[4 * pixel + c]) / T(255);
    }
};

} // namespace detail

/// The background of a render and of the photograph that it is compared with. Both must have the same background.
///
/// Units   display-referred sRGB.
template <Backend B, std::floating_point T>
class Backdrop {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    explicit Backdrop(const std::array<double, 3>& color) { set_color(color); }

    void set_color(const std::array<double, 3>& color) { color_ = {T(color[0]), T(color[1]), T(color[2])}; }

    /// From now on, `plate` [height, width, 4] replaces the colour, and the estimated background of unknown pixels
    /// replaces both. Both are in the backend's memory; empty ones replace nothing.
    /// Errors  ShapeError for a plate of another size.
    void set_plate(B& backend, Span<const std::uint8_t> plate, Span<const UnknownPixel> unknown, int height,
                   int width) {
        height_ = height, width_ = width;
        if (plate.empty() && unknown.empty()) return plate_.resize(0);
        plate_.resize(3 * plane_size());
        const ImageView<T> image{plate_, 3, height, width};
        if (plate.empty()) {
            for (std::size_t c = 0; c < 3; ++c)
                backend.fill(image.data.subspan(c * plane_size(), plane_size()), color_[static_cast<int>(c)]);
        } else {
            check_size("Backdrop", "plate", plate.size(), 4 * plane_size(), "a plate is as large as its photograph");
            composite_rgba8(backend, plate, height, width, vec3<T>(T(0)), image);
        }
        check_memory(backend, "Backdrop", "unknown", unknown);
        backend.for_each(detail::unknown_slots(unknown.size()), detail::UnknownBackground<T>{unknown, image.data});
    }
    void clear_plate() { plate_.resize(0); }

    [[nodiscard]] Background<T> background() const {
        if (plate_.size() == 0) return {.color = color_};
        return {.color = color_, .image = {plate_, 3, height_, width_}};
    }

    /// The photograph over its plate or the colour, composited where it is read. It has no unknown pixels. All are in
    /// the backend's memory, and the plate's picture in this object.
    [[nodiscard]] CompositePicture<T> composite(B& backend, Span<const std::uint8_t> rgba, const PixelBox& box,
                                                Span<const std::uint8_t> plate, int height, int width) {
        set_plate(backend, plate, {}, height, width);
        return {.rgba = rgba, .box = box, .color = color_, .image = background().image, .height = height,
                .width = width};
    }
    /// Composites a photograph over its plate or the colour, into color [3, height, width]. rgba has the pixels of the
    /// box (Photo::pixels). At unknown pixels the photograph stays as it is. Its mask goes into alpha if that is given.
    /// All are in the backend's memory.
    /// Errors  ShapeError for pixels that are not those of the box, or a plate of another size than color.
    void photograph(B& backend, Span<const std::uint8_t> rgba, const PixelBox& box, Span<const std::uint8_t> plate,
                    Span<const UnknownPixel> unknown, const ImageView<T>& color, const ImageView<T>& alpha = {}) {
        set_plate(backend, plate, unknown, color.height, color.width);
        if (plate.empty()) composite_rgba8(backend, rgba, height_, width_, color_, color, alpha, box);
        else composite_rgba8(backend, rgba, height_, width_, background().image, color, alpha, box);
        backend.for_each(
            detail::unknown_slots(unknown.size()),
            detail::UnknownColors<T>{unknown, rgba, box, static_cast<std::uint32_t>(width_), color.data});
    }

private:
    vec3<T> color_ = vec3<T>(T(1));
    int height_ = 0, width_ = 0;
    Buffer<T> plate_; // [3, height, width] or empty

    [[nodiscard]] std::size_t plane_size() const {
        return static_cast<std::size_t>(height_) * static_cast<std::size_t>(width_);
    }
};

} // namespace gsh
