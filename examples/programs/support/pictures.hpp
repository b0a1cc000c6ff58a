// SPDX-License-Identifier: Apache-2.0
/// @file  Pictures that compare a render with its photograph.
#pragma once

#include <gsh/image/image.hpp>

#include <algorithm>
#include <cmath>

namespace gsh::examples {

/// Render, truth and five times their absolute difference, side by side.
template <class T>
[[nodiscard]] Image<T> comparison_picture(const Image<T>& render, const Image<T>& truth) {
    constexpr T gain = 5;
    const int width = render.width;
    Image<T> picture(3, render.height, 3 * width);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < render.height; ++y)
            for (int x = 0; x < width; ++x) {
                const T a = render.at(c, y, x), b = truth.at(c, y, x);
                picture.at(c, y, x) = a;
                picture.at(c, y, x + width) = b;
                picture.at(c, y, x + 2 * width) = std::min(T(1), gain * std::abs(a - b));
            }
    return picture;
}

} // namespace gsh::examples
