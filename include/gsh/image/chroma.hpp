// SPDX-License-Identifier: Apache-2.0
/// @file  Colour at half the resolution of brightness, as JPEG and video store it; with adjoint, and its detection.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

namespace detail {

/// Weights of the brightness Y = 0.299 R + 0.587 G + 0.114 B (BT.601, as in JPEG). Colour is (R - Y, B - Y).
template <class T>
struct Luma {
    static constexpr T red = T(0.299), green = T(0.587), blue = T(0.114);
    [[nodiscard]] GSH_HD static T of(T r, T g, T b) { return red * r + green * g + blue * b; }
};

/// Rows and columns of an image and of its colours.
struct HalfGrid {
    int width, height;
    [[nodiscard]] GSH_HD int half_width() const { return (width + 1) / 2; }
    [[nodiscard]] GSH_HD int half_height() const { return (height + 1) / 2; }
    [[nodiscard]] GSH_HD std::size_t half_size() const {
        return static_cast<std::size_t>(half_width()) * static_cast<std::size_t>(half_height());
    }
    [[nodiscard]] GSH_HD std::size_t pixel(int x, int y) const {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    }
    [[nodiscard]] GSH_HD std::size_t half_pixel(int x, int y) const {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(half_width()) + static_cast<std::size_t>(x);
    }
    /// The colour on the other side of a pixel's nearest one, x / 2, which counts a quarter: at the border the nearest.
    [[nodiscard]] GSH_HD static int other(int x, int half_size) {
        const int k = x / 2 + (x % 2 ? 1 : -1);
        return k < 0 ? 0 : (k < half_size ? k : half_size - 1);
    }
};

/// Colour i of the half grid: the mean of its four pixels. At an odd border, pixels are repeated.
template <class T>
struct AverageChroma {
    HalfGrid grid;
    Span<const T> rgb; // [3, plane]
    Span<T> half;      // [2, half_size]
    GSH_HD void operator()(std::size_t i) const {
        const int x = 2 * (static_cast<int>(i) % grid.half_width()), y = 2 * (static_cast<int>(i) / grid.half_width());
        const std::size_t plane = rgb.size() / 3;
        T red(0), blue(0);
        for (int dy = 0; dy < 2; ++dy)
            for (int dx = 0; dx < 2; ++dx) {
                const std::size_t p = grid.pixel(x + dx < grid.width ? x + dx : x, y + dy < grid.height ? y + dy : y);
                const T r = rgb[p], g = rgb[plane + p], b = rgb[2 * plane + p], luma = Luma<T>::of(r, g, b);
                red += r - luma, blue += b - luma;
            }
        half[i] = red / T(4), half[grid.half_size() + i] = blue / T(4);
    }
};

/// The half grid's number at a pixel: linear between the four nearest.
template <class T>
[[nodiscard]] GSH_HD T interpolated(const HalfGrid& grid, const T* half, int x, int y) {
    const int near_x = x / 2, near_y = y / 2, far_x = HalfGrid::other(x, grid.half_width()),
              far_y = HalfGrid::other(y, grid.half_height());
    const T near = T(0.75) * half[grid.half_pixel(near_x, near_y)] + T(0.25) * half[grid.half_pixel(far_x, near_y)];
    const T far = T(0.75) * half[grid.half_pixel(near_x, far_y)] + T(0.25) * half[grid.half_pixel(far_x, far_y)];
    return T(0.75) * near + T(0.25) * far;
}

/// Pixel p: its own brightness, with the colour that is interpolated from the half grid.
template <class T>
struct InterpolateChroma {
    HalfGrid grid;
    Span<const T> rgb, half;
    Span<T> result; // [3, plane]
    GSH_HD void operator()(std::size_t p) const {
        const int x = static_cast<int>(p) % grid.width, y = static_cast<int>(p) / grid.width;
        const std::size_t plane = rgb.size() / 3;
        const T red = interpolated(grid, half.data(), x, y),
                blue = interpolated(grid, half.data() + grid.half_size(), x, y);
        const T luma = Luma<T>::of(rgb[p], rgb[plane + p], rgb[2 * plane + p]);
        result[p] = luma + red;
        result[2 * plane + p] = luma + blue;
        result[plane + p] = luma - (Luma<T>::red * red + Luma<T>::blue * blue) / Luma<T>::green;
    }
};

/// Adjoint of InterpolateChroma to colour i of the half grid: a gather over the pixels that read it.
template <class T>
struct InterpolateChromaBackward {
    HalfGrid grid;
    Span<const T> dL_dresult; // [3, plane]
    Span<T> dL_dhalf;         // [2, half_size]
    GSH_HD void operator()(std::size_t i) const {
        const int hx = static_cast<int>(i) % grid.half_width(), hy = static_cast<int>(i) / grid.half_width();
        const std::size_t plane = dL_dresult.size() / 3;
        T red(0), blue(0);
        for (int y = 2 * hy - 1; y <= 2 * hy + 2; ++y) {
            if (y < 0 || y >= grid.height) continue;
            const T of_row = weight(y, hy, grid.half_height());
            for (int x = 2 * hx - 1; x <= 2 * hx + 2; ++x) {
                if (x < 0 || x >= grid.width) continue;
                const T share = of_row * weight(x, hx, grid.half_width());
                const std::size_t p = grid.pixel(x, y);
                const T green = dL_dresult[plane + p] / Luma<T>::green;
                red += share * (dL_dresult[p] - Luma<T>::red * green);
                blue += share * (dL_dresult[2 * plane + p] - Luma<T>::blue * green);
            }
        }
        dL_dhalf[i] = red, dL_dhalf[grid.half_size() + i] = blue;
    }

private:
    [[nodiscard]] GSH_HD static T weight(int x, int half, int half_size) {
        return (x / 2 == half ? T(0.75) : T(0)) + (HalfGrid::other(x, half_size) == half ? T(0.25) : T(0));
    }
};

/// Adjoint with respect to pixel p, in place: dL/dresult becomes dL/drgb.
template <class T>
struct AverageChromaBackward {
    HalfGrid grid;
    Span<const T> dL_dhalf;
    Span<T> dL_drgb; // [3, plane]
    GSH_HD void operator()(std::size_t p) const {
        const int x = static_cast<int>(p) % grid.width, y = static_cast<int>(p) / grid.width;
        const std::size_t plane = dL_drgb.size() / 3, i = grid.half_pixel(x / 2, y / 2);
        // A pixel at an odd border stands for itself and for those that repeat it.
        const T share = (x % 2 == 0 && x + 1 == grid.width ? T(0.5) : T(0.25)) *
                        (y % 2 == 0 && y + 1 == grid.height ? T(2) : T(1));
        const T red = share * dL_dhalf[i], blue = share * dL_dhalf[grid.half_size() + i];
        const T luma = dL_drgb[p] + dL_drgb[plane + p] + dL_drgb[2 * plane + p] - red - blue;
        dL_drgb[p] = Luma<T>::red * luma + red;
        dL_drgb[plane + p] = Luma<T>::green * luma;
        dL_drgb[2 * plane + p] = Luma<T>::blue * luma + blue;
    }
};

} // namespace detail

/// Whether a photograph's colours have half the resolution of its brightness. Its pixels differ from means of 2x2 of
/// them, interpolated, by far less in colour than in brightness; natural images have a quarter of the square there,
/// images from JPEG or video with 4:2:0 some percent.
///
/// Shapes  rgba [height, width, 4]; pixels with alpha below 128 are not read.
/// Errors  ShapeError.
[[nodiscard]] inline bool has_half_chroma(Span<const std::uint8_t> rgba, int height, int width) {
    check_size("has_half_chroma", "rgba", rgba.size(),
               4 * static_cast<std::size_t>(height) * static_cast<std::size_t>(width));
    constexpr double limit = 0.07; // measured: at most 0.04 with 4:2:0, at least 0.11 without
    const detail::HalfGrid grid{width, height};
    const std::size_t plane = rgba.size() / 4;
    const auto squared_rest = [&](auto number) {
        std::vector<float> half(grid.half_size()), values(plane);
        for (std::size_t p = 0; p < plane; ++p) values[p] = number(rgba.data() + 4 * p);
        for (std::size_t i = 0; i < half.size(); ++i) {
            const int x = 2 * (static_cast<int>(i) % grid.half_width());
            const int y = 2 * (static_cast<int>(i) / grid.half_width());
            const int right = std::min(x + 1, width - 1), below = std::min(y + 1, height - 1);
            half[i] = (values[grid.pixel(x, y)] + values[grid.pixel(right, y)] + values[grid.pixel(x, below)] +
                       values[grid.pixel(right, below)]) / 4;
        }
        double sum = 0;
        for (std::size_t p = 0; p < plane; ++p) {
            if (rgba[4 * p + 3] < 128) continue;
            const int x = static_cast<int>(p) % width, y = static_cast<int>(p) / width;
            const double rest = values[p] - detail::interpolated(grid, half.data(), x, y);
            sum += rest * rest;
        }
        return sum;
    };
    const auto luma = [](const std::uint8_t* c) { return detail::Luma<float>::of(c[0], c[1], c[2]); };
    const double brightness = squared_rest(luma);
    const double red = squared_rest([&](const std::uint8_t* c) { return c[0] - luma(c); });
    const double blue = squared_rest([&](const std::uint8_t* c) { return c[2] - luma(c); });
    return brightness > 0 && (red + blue) / 2 < limit * brightness;
}

/// A picture as a codec with chroma at half resolution (4:2:0) reproduces it: every pixel keeps its brightness; colours
/// are means of 2x2 pixels, interpolated linearly between their centres.
///
/// A render that is compared with such a photograph goes through it first. What the codec has blurred in the photograph
/// is then blurred in the render, and does not become the colour of the scene.
///
/// Shapes  rgb, result [3, height, width], which may be the same memory.
/// Units   display-referred sRGB.
/// Source  ITU-T T.81 and JFIF; the interpolation is that of libjpeg.
template <Backend B, std::floating_point T>
class HalfChroma {
public:
    explicit HalfChroma(B& backend) : backend_(&backend) {}

    void forward(const std::type_identity_t<ImageView<const T>>& rgb, const ImageView<T>& result) {
        check("HalfChroma::forward", rgb, result);
        const detail::HalfGrid grid{rgb.width, rgb.height};
        half_.resize(2 * grid.half_size());
        backend_->for_each(grid.half_size(), detail::AverageChroma<T>{grid, rgb.data, half_});
        backend_->for_each(rgb.plane_size(), detail::InterpolateChroma<T>{grid, rgb.data, half_, result.data});
    }
    /// Adjoint, in place: the gradient of forward's result becomes that of its argument.
    void backward(const ImageView<T>& gradient) {
        check("HalfChroma::backward", gradient, gradient);
        const detail::HalfGrid grid{gradient.width, gradient.height};
        half_.resize(2 * grid.half_size());
        const Span<const T> dL_dresult = gradient.data;
        backend_->for_each(grid.half_size(), detail::InterpolateChromaBackward<T>{grid, dL_dresult, half_});
        backend_->for_each(gradient.plane_size(), detail::AverageChromaBackward<T>{grid, half_, gradient.data});
    }

private:
    void check(std::string_view where, const ImageView<const T>& a, const ImageView<T>& b) const {
        check_image(where, "rgb", a, 3, a.height, a.width);
        check_image(where, "result", b, 3, a.height, a.width);
        check_memory(*backend_, where, "rgb", a);
        check_memory(*backend_, where, "result", b);
    }

    B* backend_;
    typename B::template Buffer<T> half_; // [2, half_size]: R - Y and B - Y
};

} // namespace gsh
