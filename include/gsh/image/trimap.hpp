// SPDX-License-Identifier: Apache-2.0
/// @file  Pixels whose mask is not believed: along its outline, with the background that is estimated there, and hidden
///        ones.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/pixel_box.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

namespace gsh {

/// A pixel that may show the foreground, the background or both; or, if it is hidden, something in front of both, of
/// which the foreground has nothing to learn.
struct UnknownPixel {
    std::uint32_t index;        ///< row-major
    std::uint8_t background[3]; ///< estimated, display-referred sRGB
    std::uint8_t hidden = 0;    ///< 1: the pixel is not compared at all
};

/// Whether every pixel without alpha is black, or every one white: then the background was removed from the image.
[[nodiscard]] inline bool background_is_removed(Span<const std::uint8_t> rgba) {
    bool black = true, white = true;
    for (std::size_t i = 0; i < rgba.size() && (black || white); i += 4) {
        if (rgba[i + 3] != 0) continue;
        for (std::size_t c = 0; c < 3; ++c) black &= rgba[i + c] == 0, white &= rgba[i + c] == 255;
    }
    return black || white;
}

namespace detail {

/// Pixels at most `radius` from one on the other side of the mask's outline: 1, all others 0.
[[nodiscard]] inline std::vector<std::uint8_t> pixels_near_outline(Span<const std::uint8_t> rgba, int height, int width,
                                                                   double radius) {
    const auto at = [whole = whole_picture(height, width)](int y, int x) { return whole.index(x, y); };
    const auto inside = [&](int y, int x) { return rgba[4 * at(y, x) + 3] >= 128; };
    std::vector<std::uint8_t> near(rgba.size() / 4, 0);
    const int reach = static_cast<int>(radius);
    const auto mark = [&](int y, int x) { // the disc around a pixel beside the outline
        for (int v = std::max(y - reach, 0); v <= std::min(y + reach, height - 1); ++v)
            for (int u = std::max(x - reach, 0); u <= std::min(x + reach, width - 1); ++u)
                if ((v - y) * (v - y) + (u - x) * (u - x) <= radius * radius) near[at(v, u)] = 1;
    };
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            if (x + 1 < width && inside(y, x) != inside(y, x + 1)) mark(y, x), mark(y, x + 1);
            if (y + 1 < height && inside(y, x) != inside(y + 1, x)) mark(y, x), mark(y + 1, x);
        }
    return near;
}

/// The range of the background's colours that a pixel was continued from.
struct ColorRange {
    std::array<std::uint8_t, 3> low{255, 255, 255}, high{0, 0, 0};

    void add(const ColorRange& other) {
        for (std::size_t c = 0; c < 3; ++c) {
            low[c] = std::min(low[c], other.low[c]);
            high[c] = std::max(high[c], other.high[c]);
        }
    }
    /// Whether a channel of the colour lies outside of the range by more than the tolerance.
    [[nodiscard]] bool excludes(const std::uint8_t* color, int tolerance) const {
        for (std::size_t c = 0; c < 3; ++c)
            if (color[c] + tolerance < low[c] || color[c] > high[c] + tolerance) return true;
        return false;
    }
};

} // namespace detail

/// The unknown region of a trimap: pixels within `radius` of the mask's outline. Their background is continued from
/// outside: layer by layer, each pixel takes the mean of its neighbours that have one.
///
/// A pixel inside of the mask is known after all if its colour differs from all the background that it was continued
/// from, by over 24 of 255 in a channel, and if the same is true of its eight neighbours or they are deeper inside.
/// Without this, parts of a person that are narrower than the region (soles of shoes) would have no known pixel, so
/// nothing would keep them opaque. The condition on the neighbours excludes pixels that are mixed of both, or blurred
/// by a JPEG file.
///
/// With it, a photograph can be compared where its mask is wrong by a few pixels: there it is compared as it is, and
/// the render lies over the estimated background.
///
/// Shapes  rgba [height, width, 4], straight alpha, with the photograph's own colours outside of the mask.
/// Units   radius in pixels; 0 gives no pixels.
/// Returns no pixels if the background was removed from the photograph, so that it is black or white wherever alpha is
///         0. A mask with such a background is believed.
/// Errors  ShapeError, ValueError.
[[nodiscard]] inline std::vector<UnknownPixel> unknown_pixels(Span<const std::uint8_t> rgba, int height, int width,
                                                              double radius) {
    constexpr const char* where = "unknown_pixels";
    check_value(height >= 0 && width >= 0 && radius >= 0 && radius <= 256, where,
                "height and width must not be negative, and the radius lie in [0, 256]");
    check_size(where, "rgba", rgba.size(), 4 * static_cast<std::size_t>(height) * static_cast<std::size_t>(width));
    if (radius == 0 || background_is_removed(rgba)) return {};
    std::vector<std::uint8_t> near = detail::pixels_near_outline(rgba, height, width, radius);
    enum : std::uint8_t { known, unknown, foreground };
    constexpr int clear_difference = 24;
    std::vector<std::array<float, 3>> background(near.size());
    std::vector<detail::ColorRange> range(near.size());
    std::vector<std::uint32_t> open;
    for (std::size_t i = 0; i < near.size(); ++i) {
        if (near[i]) {
            near[i] = unknown;
            open.push_back(static_cast<std::uint32_t>(i));
        } else if (rgba[4 * i + 3] >= 128) {
            near[i] = foreground;
        } else {
            for (std::size_t c = 0; c < 3; ++c) {
                background[i][c] = rgba[4 * i + c];
                range[i].low[c] = range[i].high[c] = rgba[4 * i + c];
            }
        }
    }
    const auto for_each_near = [&](std::uint32_t i, const auto& visit) { // a pixel and its neighbours, at most nine
        const int y = static_cast<int>(i) / width, x = static_cast<int>(i) % width;
        for (int v = std::max(y - 1, 0); v <= std::min(y + 1, height - 1); ++v)
            for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width - 1); ++u)
                visit(whole_picture(height, width).index(u, v));
    };
    std::vector<UnknownPixel> result;
    result.reserve(open.size());
    while (!open.empty()) {
        std::vector<std::uint32_t> layer, rest;
        for (const std::uint32_t i : open) {
            std::array<float, 3> sum{};
            int count = 0;
            for_each_near(i, [&](std::size_t k) {
                if (near[k] != known) return;
                for (std::size_t c = 0; c < 3; ++c) sum[c] += background[k][c];
                range[i].add(range[k]);
                ++count;
            });
            if (count == 0) {
                rest.push_back(i);
                continue;
            }
            for (std::size_t c = 0; c < 3; ++c) background[i][c] = sum[c] / static_cast<float>(count);
            layer.push_back(i);
        }
        if (layer.empty()) break; // no background beside the rest: its mask is believed
        for (const std::uint32_t i : layer) {
            near[i] = known;
            UnknownPixel& pixel = result.emplace_back(UnknownPixel{i, {}});
            for (std::size_t c = 0; c < 3; ++c)
                pixel.background[c] = static_cast<std::uint8_t>(std::lround(background[i][c]));
        }
        open = std::move(rest);
    }
    std::sort(result.begin(), result.end(), [](const auto& a, const auto& b) { return a.index < b.index; });
    for (const UnknownPixel& pixel : result)
        if (rgba[4 * pixel.index + 3] == 255 && range[pixel.index].excludes(&rgba[4 * pixel.index], clear_difference))
            near[pixel.index] = foreground;
    std::erase_if(result, [&](const UnknownPixel& pixel) {
        bool surrounded = true;
        for_each_near(pixel.index, [&](std::size_t k) { surrounded &= near[k] == foreground; });
        return surrounded;
    });
    return result;
}

/// The pixels that are hidden: those above half of 255 in a picture of one byte a pixel, row-major.
[[nodiscard]] inline std::vector<UnknownPixel> hidden_pixels(Span<const std::uint8_t> picture) {
    std::vector<UnknownPixel> result;
    for (std::size_t i = 0; i < picture.size(); ++i)
        if (picture[i] >= 128) result.push_back({static_cast<std::uint32_t>(i), {}, 1});
    return result;
}

/// Both lists as one; hidden pixels count where a pixel is in both.
///
/// Shapes  both ascending, as unknown_pixels and hidden_pixels give them; so is the result.
[[nodiscard]] inline std::vector<UnknownPixel> with_hidden(Span<const UnknownPixel> unknown,
                                                           Span<const UnknownPixel> hidden) {
    std::vector<UnknownPixel> result;
    result.reserve(unknown.size() + hidden.size());
    const auto earlier = [](const UnknownPixel& a, const UnknownPixel& b) { return a.index < b.index; };
    std::set_union(hidden.begin(), hidden.end(), unknown.begin(), unknown.end(), std::back_inserter(result), earlier);
    return result;
}

} // namespace gsh
