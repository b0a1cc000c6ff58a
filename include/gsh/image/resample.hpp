// SPDX-License-Identifier: Apache-2.0
/// @file  Bilinear resampling of an image through a pixel map, for undistorting photographs and changing their size.
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

/// Maps pixel coordinates of the output to pixel coordinates of the source; the first pixel's centre is (0.5, 0.5).
template <class M, class T>
concept PixelMap = requires(const M& map, vec2<T> pixel) {
    { map(pixel) } -> std::convertible_to<vec2<T>>;
};

/// Scales about the image's corner. A reduction by more than 2 skips source pixels; reduce in steps of 2 instead.
template <class T>
struct ScaleMap {
    T x = T(1), y = T(1);
    [[nodiscard]] GSH_HD vec2<T> operator()(const vec2<T>& pixel) const { return {x * pixel.x, y * pixel.y}; }
};

namespace detail {

/// The four source pixels around a point and their weights. Pixels outside the source have weight 0.
template <class T>
struct BilinearTaps {
    std::size_t index[4] = {};
    T weight[4] = {};

    GSH_HD BilinearTaps(const vec2<T>& point, int height, int width) {
        const T x = point.x - T(0.5), y = point.y - T(0.5);
        if (!(x > T(-1) && y > T(-1) && x < T(width) && y < T(height))) return; // also for NaN
        const T floor_x = floor(x), floor_y = floor(y), u = x - floor_x, v = y - floor_y;
        const int x0 = static_cast<int>(floor_x), y0 = static_cast<int>(floor_y);
        for (int k = 0; k < 4; ++k) {
            const int xk = x0 + (k & 1), yk = y0 + (k >> 1);
            if (xk < 0 || yk < 0 || xk >= width || yk >= height) continue;
            index[k] = static_cast<std::size_t>(yk) * static_cast<std::size_t>(width) + static_cast<std::size_t>(xk);
            weight[k] = ((k & 1) ? u : T(1) - u) * ((k >> 1) ? v : T(1) - v);
        }
    }
};

/// Centre of pixel i in an image of this width.
template <class T>
[[nodiscard]] GSH_HD vec2<T> pixel_center(std::size_t i, int width) {
    const auto w = static_cast<std::size_t>(width);
    return {static_cast<T>(i % w) + T(0.5), static_cast<T>(i / w) + T(0.5)};
}

template <class T, class Map>
struct ResamplePlanes {
    ImageView<const T> source;
    Map map;
    ImageView<T> out;

    GSH_HD void operator()(std::size_t i) const {
        const BilinearTaps<T> taps(map(pixel_center<T>(i, out.width)), source.height, source.width);
        for (int c = 0; c < out.channels; ++c) {
            const T* plane = source.row(c, 0);
            T sum = T(0);
            for (int k = 0; k < 4; ++k) sum += taps.weight[k] * plane[taps.index[k]];
            out.row(c, 0)[i] = sum;
        }
    }
};

template <class T, class Map>
struct ResampleRgba8 {
    const std::uint8_t* source;
    int source_height, source_width;
    Map map;
    std::uint8_t* out;
    int out_width;

    GSH_HD void operator()(std::size_t i) const {
        const BilinearTaps<T> taps(map(pixel_center<T>(i, out_width)), source_height, source_width);
        T color[3] = {}, alpha = T(0); // premultiplied
        for (int k = 0; k < 4; ++k) {
            const std::uint8_t* pixel = source + 4 * taps.index[k];
            const T weight = taps.weight[k] * T(pixel[3]);
            alpha += weight;
            for (int c = 0; c < 3; ++c) color[c] += weight * T(pixel[c]);
        }
        const T straight = alpha > T(0) ? T(1) / alpha : T(0);
        for (int c = 0; c < 3; ++c) out[4 * i + static_cast<std::size_t>(c)] = to_byte(color[c] * straight);
        out[4 * i + 3] = to_byte(alpha);
    }

private:
    [[nodiscard]] GSH_HD static std::uint8_t to_byte(T value) {
        return static_cast<std::uint8_t>(clamp(value + T(0.5), T(0), T(255)));
    }
};

} // namespace detail

/// out(p) = source(map(p)), bilinear; pixels outside the source count as 0.
///
/// Shapes  source [channels, h, w]; out [channels, height, width] of any size.
/// Errors  ShapeError if the numbers of channels differ or a view is too short.
template <Backend B, std::floating_point T, PixelMap<T> Map>
void resample(B& backend, const std::type_identity_t<ImageView<const T>>& source, const Map& map,
              const ImageView<T>& out) {
    check_image("resample", "source", source, out.channels, source.height, source.width);
    check_image("resample", "out", out, out.channels, out.height, out.width);
    check_memory(backend, "resample", "source", source);
    check_memory(backend, "resample", "out", out);
    if (source.empty()) {
        backend.fill(out.data, T(0));
        return;
    }
    backend.for_each(out.plane_size(), detail::ResamplePlanes<T, Map>{source, map, out});
}

/// The same for RGBA bytes with straight alpha. The filter weights colours by alpha, so the colour of transparent
/// pixels does not affect the result, and converts back to straight alpha. Outside the source alpha is 0.
///
/// Shapes  source [source_height, source_width, 4], out [height, width, 4], in the backend's memory.
/// Errors  ShapeError.
template <std::floating_point T = float, Backend B, PixelMap<T> Map>
void resample_rgba8(B& backend, Span<const std::uint8_t> source, int source_height, int source_width, const Map& map,
                    Span<std::uint8_t> out, int height, int width) {
    constexpr std::string_view where = "resample_rgba8";
    check_value(source_height >= 0 && source_width >= 0 && height >= 0 && width >= 0, where,
                "heights and widths must not be negative");
    const auto bytes = [](int h, int w) { return 4 * static_cast<std::size_t>(h) * static_cast<std::size_t>(w); };
    check_size(where, "source", source.size(), bytes(source_height, source_width), "give four bytes a pixel");
    check_size(where, "out", out.size(), bytes(height, width), "give four bytes a pixel");
    check_memory(backend, where, "source", source);
    check_memory(backend, where, "out", out);
    if (source.empty()) {
        backend.fill(out, std::uint8_t(0));
        return;
    }
    backend.for_each(out.size() / 4, detail::ResampleRgba8<T, Map>{source.data(), source_height, source_width, map,
                                                                   out.data(), width});
}

} // namespace gsh
