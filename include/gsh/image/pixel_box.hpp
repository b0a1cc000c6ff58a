// SPDX-License-Identifier: Apache-2.0
/// @file  A rectangle of a picture's pixels, and the smallest one around a mask.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace gsh {

/// The pixels in columns [x, x + width) and rows [y, y + height) of a picture.
struct PixelBox {
    int x = 0, y = 0, width = 0, height = 0;

    /// Number of pixels.
    [[nodiscard]] GSH_HD std::size_t size() const {
        return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    }
    [[nodiscard]] GSH_HD bool contains(int column, int row) const {
        return column >= x && column < x + width && row >= y && row < y + height;
    }
    /// The index of one of the box's pixels among them, row by row.
    [[nodiscard]] GSH_HD std::size_t index(int column, int row) const {
        return static_cast<std::size_t>(row - y) * static_cast<std::size_t>(width) +
               static_cast<std::size_t>(column - x);
    }
    /// Extends the box by a pixel.
    void include(int column, int row) {
        if (size() == 0) {
            *this = {column, row, 1, 1};
            return;
        }
        const int right = std::max(x + width, column + 1), bottom = std::max(y + height, row + 1);
        x = std::min(x, column), y = std::min(y, row);
        width = right - x, height = bottom - y;
    }
    friend bool operator==(const PixelBox&, const PixelBox&) = default;
};

[[nodiscard]] inline PixelBox whole_picture(int height, int width) { return {0, 0, width, height}; }

/// Throws ValueError unless a box is inside of a picture. It may be empty.
inline void check_box(std::string_view where, std::string_view name, const PixelBox& box, int height, int width) {
    const auto fits = [](int first, int count, int size) { return first >= 0 && count >= 0 && count <= size - first; };
    if (fits(box.x, box.width, width) && fits(box.y, box.height, height)) return;
    const auto span = [](int first, int count) {
        return std::to_string(first) + " to " + std::to_string(std::int64_t(first) + count);
    };
    check_value(false, where,
                std::string(name) + " has columns " + span(box.x, box.width) + " and rows " + span(box.y, box.height) +
                    ", expected some of a picture of " + std::to_string(width) + " x " + std::to_string(height));
}

/// Copies a box's pixels, four bytes each, between two pictures that have the pixels of from_box and of to_box. Both
/// contain `box`.
inline void copy_pixels(const PixelBox& box, Span<const std::uint8_t> from, const PixelBox& from_box,
                        Span<std::uint8_t> to, const PixelBox& to_box) {
    if (box.size() == 0) return;
    for (int row = box.y; row < box.y + box.height; ++row)
        std::copy_n(from.data() + 4 * from_box.index(box.x, row), 4 * static_cast<std::size_t>(box.width),
                    to.data() + 4 * to_box.index(box.x, row));
}

/// The smallest box with all pixels whose alpha is not 0; without any, an empty one.
///
/// Shapes  rgba [height, width, 4].
/// Errors  ShapeError.
[[nodiscard]] inline PixelBox box_of_mask(Span<const std::uint8_t> rgba, int height, int width) {
    check_size("box_of_mask", "rgba", rgba.size(),
               4 * static_cast<std::size_t>(height) * static_cast<std::size_t>(width), "give four bytes a pixel");
    PixelBox box;
    for (int y = 0; y < height; ++y) {
        const auto at = [&](int x) { return rgba[4 * whole_picture(height, width).index(x, y) + 3]; };
        int first = 0, last = width - 1;
        while (first < width && at(first) == 0) ++first;
        if (first == width) continue;
        while (at(last) == 0) --last;
        box.include(first, y), box.include(last, y);
    }
    return box;
}

} // namespace gsh
