// SPDX-License-Identifier: Apache-2.0
/// @file  A view of the mask of one person, read between its pixels.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// The mask of one person in one photograph: [height, width], 255 on the person.
struct MaskView {
    int height = 0, width = 0;
    const std::uint8_t* pixels = nullptr;
    int stride = 1; ///< bytes from one pixel to the next

    [[nodiscard]] explicit operator bool() const { return pixels; }
    /// In [0, 1], between pixels' centres linear; 0 outside of the image.
    [[nodiscard]] double at(double x, double y) const {
        const double left = std::floor(x - 0.5), top = std::floor(y - 0.5), u = x - 0.5 - left, v = y - 0.5 - top;
        const auto pixel = [&](double column, double row) {
            if (column < 0 || row < 0 || column >= width || row >= height) return 0.0;
            const std::size_t index =
                static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column);
            return pixels[index * static_cast<std::size_t>(stride)] / 255.0;
        };
        return (pixel(left, top) * (1 - u) + pixel(left + 1, top) * u) * (1 - v) +
               (pixel(left, top + 1) * (1 - u) + pixel(left + 1, top + 1) * u) * v;
    }
};

} // namespace gsh
