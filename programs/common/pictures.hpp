// SPDX-License-Identifier: Apache-2.0
/// @file  Pictures that compare a render with its photograph.
#pragma once

#include <gsh/image/image.hpp>
#include <gsh/image/pixel_box.hpp>

#include <algorithm>
#include <cmath>

namespace gsh::programs {

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

/// The part of a picture in a box.
[[nodiscard]] inline Image<float> cropped(const Image<float>& picture, const PixelBox& box) {
    Image<float> part(picture.channels, box.height, box.width);
    for (int c = 0; c < picture.channels; ++c)
        for (int y = 0; y < box.height; ++y)
            std::copy_n(picture.view().row(c, box.y + y) + box.x, box.width, part.view().row(c, y));
    return part;
}

/// Two pictures of the same size side by side, each at 1/factor of its size: a pixel is the mean of a square.
[[nodiscard]] inline Image<float> small_pair(const Image<float>& left, const Image<float>& right, int factor) {
    const int height = std::max(1, left.height / factor), width = std::max(1, left.width / factor);
    Image<float> pair(left.channels, height, 2 * width);
    for (int c = 0; c < left.channels; ++c)
        for (int y = 0; y < left.height; ++y)
            for (int x = 0; x < left.width; ++x) {
                if (y / factor >= height || x / factor >= width) continue; // what a square lacks
                const float share =
                    1 / static_cast<float>(std::min(factor, left.height) * std::min(factor, left.width));
                pair.at(c, y / factor, x / factor) += share * left.at(c, y, x);
                pair.at(c, y / factor, x / factor + width) += share * right.at(c, y, x);
            }
    return pair;
}

/// The box around the pixels whose alpha exceeds 1/2, with a margin of a twelfth of its height; the whole picture
/// without such pixels.
[[nodiscard]] inline PixelBox box_of_person(const Image<float>& alpha) {
    int left = alpha.width, right = -1, top = alpha.height, bottom = -1;
    for (int y = 0; y < alpha.height; ++y)
        for (int x = 0; x < alpha.width; ++x)
            if (alpha.at(0, y, x) > 0.5f) {
                left = std::min(left, x), right = std::max(right, x);
                top = std::min(top, y), bottom = std::max(bottom, y);
            }
    if (right < 0) return {0, 0, alpha.width, alpha.height};
    const int margin = (bottom - top + 1) / 12;
    left = std::max(0, left - margin), right = std::min(alpha.width - 1, right + margin);
    top = std::max(0, top - margin), bottom = std::min(alpha.height - 1, bottom + margin);
    return {left, top, right - left + 1, bottom - top + 1};
}

} // namespace gsh::programs
