// SPDX-License-Identifier: Apache-2.0
/// @file  The sRGB curve and its adjoint, and compositing of 8-bit RGBA pixels over a background.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
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

/// One pixel: c α + background (1 - α). α = 0 gives exactly the background, α = 1 exactly the colour.
template <class T, class Background>
struct CompositeRgba8 {
    const std::uint8_t* rgba;
    Background background;
    T *color, *alpha; // alpha may be null
    std::size_t plane;

    GSH_HD void operator()(std::size_t i) const {
        const T a = T(rgba[4 * i + 3]) / T(255);
        for (int c = 0; c < 3; ++c) {
            const T value = T(rgba[4 * i + static_cast<std::size_t>(c)]) / T(255);
            color[static_cast<std::size_t>(c) * plane + i] = value * a + background(c, i) * (T(1) - a);
        }
        if (alpha) alpha[i] = a;
    }
};

template <Backend B, class T, class Background>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width, const Background& background,
                     const ImageView<T>& out_color, const ImageView<T>& out_alpha) {
    constexpr std::string_view where = "composite_rgba8";
    check_value(height >= 0 && width >= 0, where, "height and width must not be negative");
    check_image(where, "out_color", out_color, 3, height, width);
    const bool with_alpha = out_alpha.channels != 0;
    if (with_alpha) check_image(where, "out_alpha", out_alpha, 1, height, width);
    check_memory(backend, where, "rgba", rgba);
    check_memory(backend, where, "out_color", out_color);
    check_memory(backend, where, "out_alpha", out_alpha);
    const std::size_t plane = out_color.plane_size();
    check_size(where, "rgba", rgba.size(), 4 * plane, "give four bytes a pixel: red, green, blue, alpha");
    backend.for_each(plane, CompositeRgba8<T, Background>{rgba.data(), background, out_color.data.data(),
                                                          with_alpha ? out_alpha.data.data() : nullptr, plane});
}

} // namespace detail

/// Composites straight-alpha bytes over a plain background: color = c α + background (1 - α). All values are
/// display-referred sRGB, as in the renderer.
///
/// Shapes  rgba [height, width, 4] in the backend's memory; out_color [3, height, width]; out_alpha [1, height, width]
///         or a default ImageView if it is not needed.
/// Errors  ShapeError.
template <Backend B, std::floating_point T>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width,
                     const std::type_identity_t<vec3<T>>& background, const ImageView<T>& out_color,
                     const ImageView<T>& out_alpha = {}) {
    detail::composite_rgba8(backend, rgba, height, width, detail::PlainBackground<T>{background}, out_color,
                            out_alpha);
}

/// Composites over a background image [3, height, width].
template <Backend B, std::floating_point T>
void composite_rgba8(B& backend, Span<const std::uint8_t> rgba, int height, int width,
                     const std::type_identity_t<ImageView<const T>>& background, const ImageView<T>& out_color,
                     const ImageView<T>& out_alpha = {}) {
    check_image("composite_rgba8", "background", background, 3, height, width);
    check_memory(backend, "composite_rgba8", "background", background);
    detail::composite_rgba8(backend, rgba, height, width,
                            detail::ImageBackground<T>{background.data.data(), background.plane_size()}, out_color,
                            out_alpha);
}

} // namespace gsh
