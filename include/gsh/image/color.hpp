// SPDX-License-Identifier: Apache-2.0
/// @file  The sRGB curve and its adjoint, and compositing of 8-bit RGBA pixels over a background.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <type_traits>

namespace gsh {

/// Display-referred sRGB in [0, 1] to linear light. The linear segment continues below 0.
///
/// Source  IEC 61966-2-1.
template <Lane T>
[[nodiscard]] GSH_HD T srgb_to_linear(T s) {
    const T base = (max(s, T(0.04045)) + T(0.055)) * T(1 / 1.055); // positive even where not selected
    return select(s <= T(0.04045), s * T(1 / 12.92), power(base, T(2.4)));
}
/// Adjoint of srgb_to_linear: adds to dL_ds.
template <Lane T>
GSH_HD void srgb_to_linear_backward(T s, T dL_dlinear, T& dL_ds) {
    const T base = (max(s, T(0.04045)) + T(0.055)) * T(1 / 1.055);
    dL_ds += dL_dlinear * select(s <= T(0.04045), T(1 / 12.92), T(2.4 / 1.055) * power(base, T(1.4)));
}
/// The same, given the result of srgb_to_linear: a division in place of a power.
template <Lane T>
GSH_HD void srgb_to_linear_backward(T s, T linear, T dL_dlinear, T& dL_ds) {
    dL_ds += dL_dlinear *
             select(s <= T(0.04045), T(1 / 12.92), T(2.4) * linear / (max(s, T(0.04045)) + T(0.055)));
}

/// Linear light to display-referred sRGB.
template <Lane T>
[[nodiscard]] GSH_HD T linear_to_srgb(T x) {
    const T root = power(max(x, T(0.0031308)), T(1 / 2.4));
    return select(x <= T(0.0031308), T(12.92) * x, T(1.055) * root - T(0.055));
}
/// Adjoint of linear_to_srgb: adds to dL_dx.
template <Lane T>
GSH_HD void linear_to_srgb_backward(T x, T dL_dsrgb, T& dL_dx) {
    const T slope = T(1.055 / 2.4) * power(max(x, T(0.0031308)), T(1 / 2.4 - 1));
    dL_dx += dL_dsrgb * select(x <= T(0.0031308), T(12.92), slope);
}

namespace detail {

template <class T>
struct PlainBackground {
    vec3<T> color;
    [[nodiscard]] GSH_HD T operator()(int channel, std::size_t) const { return color[channel]; }
};
template <class T>
struct ImageBackground {
    const T* data;
    std::size_t plane;
    [[nodiscard]] GSH_HD T operator()(int channel, std::size_t i) const {
        return data[static_cast<std::size_t>(channel) * plane + i];
    }
};

/// c α + background (1 - α). α = 0 gives exactly the background, α = 1 exactly the colour.
template <class T>
[[nodiscard]] GSH_HD T composite_over(T color, T alpha, T background) {
    return color * alpha + background * (T(1) - alpha);
}

/// One pixel. Outside of the box α = 0. Cropped: whether the box is a part of the picture. Loops over the pixels of a
/// whole picture are vectorised.
template <bool Cropped, class T, class Background>
struct CompositeRgba8 {
    const std::uint8_t* rgba;
    PixelBox box;
    Background background;
    T *color, *alpha; // alpha may be null
    std::size_t plane;
    std::uint32_t width;

    GSH_HD void operator()(std::size_t i) const {
        std::size_t at = i;
        if constexpr (Cropped) {
            const std::uint32_t row = static_cast<std::uint32_t>(i) / width;
            const int y = static_cast<int>(row), x = static_cast<int>(static_cast<std::uint32_t>(i) - row * width);
            if (!box.contains(x, y)) {
                for (int c = 0; c < 3; ++c) color[static_cast<std::size_t>(c) * plane + i] = background(c, i);
                if (alpha) alpha[i] = T(0);
                return;
            }
            at = box.index(x, y);
        }
        const T a = T(rgba[4 * at + 3]) / T(255);
        for (int c = 0; c < 3; ++c) {
            const T value = T(rgba[4 * at + static_cast<std::size_t>(c)]) / T(255);
            color[static_cast<std::size_t>(c) * plane + i] = composite_over(value, a, background(c, i));
        }
        if (alpha) alpha[i] = a;
    }
};

template <Backend B, class T, class Background>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width, const Background& background,
                     const ImageView<T>& out_color, const ImageView<T>& out_alpha, const PixelBox& box) {
    constexpr std::string_view where = "composite_rgba8";
    check_value(height >= 0 && width >= 0, where, "height and width must not be negative");
    check_box(where, "box", box, height, width);
    check_image(where, "out_color", out_color, 3, height, width);
    const bool with_alpha = out_alpha.channels != 0;
    if (with_alpha) check_image(where, "out_alpha", out_alpha, 1, height, width);
    check_memory(backend, where, "rgba", rgba);
    check_memory(backend, where, "out_color", out_color);
    check_memory(backend, where, "out_alpha", out_alpha);
    check_size(where, "rgba", rgba.size(), 4 * box.size(), "give four bytes a pixel: red, green, blue, alpha");
    const auto composite = [&]<bool Cropped>(std::bool_constant<Cropped>) {
        const std::size_t plane = out_color.plane_size();
        backend.for_each(plane, CompositeRgba8<Cropped, T, Background>{
                                    rgba.data(), box, background, out_color.data.data(),
                                    with_alpha ? out_alpha.data.data() : nullptr, plane,
                                    static_cast<std::uint32_t>(width)});
    };
    if (box == whole_picture(height, width)) composite(std::false_type());
    else composite(std::true_type());
}

} // namespace detail

/// Composites straight-alpha bytes over a plain background: color = c α + background (1 - α). All values are
/// display-referred sRGB, as in the renderer. With a box, the bytes are those of its pixels alone, and α is 0 outside.
///
/// Shapes  rgba [height, width, 4] in the backend's memory, or [box.height, box.width, 4]; out_color
///         [3, height, width]; out_alpha [1, height, width] or a default ImageView if it is not needed.
/// Errors  ShapeError; ValueError for a box that is not inside of the picture.
template <Backend B, std::floating_point T>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width,
                     const std::type_identity_t<vec3<T>>& background, const ImageView<T>& out_color,
                     const ImageView<T>& out_alpha = {}, const std::optional<PixelBox>& box = {}) {
    detail::composite_rgba8(backend, rgba, height, width, detail::PlainBackground<T>{background}, out_color, out_alpha,
                            box.value_or(whole_picture(height, width)));
}

/// Composites over a background image [3, height, width].
template <Backend B, std::floating_point T>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width,
                     const std::type_identity_t<ImageView<const T>>& background, const ImageView<T>& out_color,
                     const ImageView<T>& out_alpha = {}, const std::optional<PixelBox>& box = {}) {
    check_image("composite_rgba8", "background", background, 3, height, width);
    check_memory(backend, "composite_rgba8", "background", background);
    detail::composite_rgba8(backend, rgba, height, width,
                            detail::ImageBackground<T>{background.data.data(), background.plane_size()}, out_color,
                            out_alpha, box.value_or(whole_picture(height, width)));
}

} // namespace gsh
