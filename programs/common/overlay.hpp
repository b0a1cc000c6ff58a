// SPDX-License-Identifier: Apache-2.0
/// @file  Drawing a projected rig onto photographs: outlines, bones, joints.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::programs {

using Rgb = std::array<std::uint8_t, 3>;

/// The colours of overlays, as listed in docs/programs.md.
struct OverlayColors {
    Rgb mask{255, 214, 10};    ///< yellow
    Rgb body{0, 229, 255};     ///< cyan
    Rgb left{255, 64, 64};     ///< red, as the port light of a ship
    Rgb right{48, 224, 80};    ///< green
    Rgb middle{255, 255, 255}; ///< white
};

/// The photograph, dimmed and composited over grey, so that lines are easy to see.
[[nodiscard]] inline PixelImage overlay_canvas(const PixelImage& photograph) {
    PixelImage canvas(3, photograph.height, photograph.width);
    for (int y = 0; y < canvas.height; ++y)
        for (int x = 0; x < canvas.width; ++x)
            for (int c = 0; c < 3; ++c) {
                const int alpha = photograph.pixel(y, x)[3], colour = photograph.pixel(y, x)[c];
                canvas.pixel(y, x)[c] = static_cast<std::uint8_t>((colour * 3 / 4 * alpha + 96 * (255 - alpha)) / 255);
            }
    return canvas;
}

inline void draw_dot(PixelImage& canvas, int x, int y, int half, const Rgb& color) {
    for (int v = std::max(0, y - half); v <= std::min(canvas.height - 1, y + half); ++v)
        for (int u = std::max(0, x - half); u <= std::min(canvas.width - 1, x + half); ++u)
            std::copy(color.begin(), color.end(), canvas.pixel(v, u));
}

/// Draws a straight line between two points, in pixels. Parts outside the image are left out.
inline void draw_line(PixelImage& canvas, vec2<double> a, vec2<double> b, int half, const Rgb& color) {
    // First clip the line to a frame around the image: the end of a bone beside the camera may be very far away.
    double begin = 0, end = 1;
    const vec2<double> d = b - a;
    const double low = -8, high[2] = {canvas.width + 8.0, canvas.height + 8.0};
    for (int axis = 0; axis < 2; ++axis) {
        if (d[axis] == 0) {
            if (a[axis] < low || a[axis] > high[axis]) return;
            continue;
        }
        const double p = (low - a[axis]) / d[axis], q = (high[axis] - a[axis]) / d[axis];
        begin = std::max(begin, std::min(p, q)), end = std::min(end, std::max(p, q));
    }
    if (!(begin <= end)) return; // also for NaN
    const vec2<double> first = a + d * begin, last = a + d * end;
    const int steps = 1 + static_cast<int>(std::max(std::abs(last.x - first.x), std::abs(last.y - first.y)));
    for (int i = 0; i <= steps; ++i) {
        const vec2<double> p = first + (last - first) * (static_cast<double>(i) / steps);
        draw_dot(canvas, static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y)), half, color);
    }
}

/// Draws the pixels of a silhouette that have a neighbour outside. The border of the image counts as outside. A
/// silhouette of 1/reduction of the canvas size is drawn in blocks.
inline void draw_outline(PixelImage& canvas, const Silhouette& silhouette, const Rgb& color, int reduction = 1) {
    const auto inside = [&](int y, int x) {
        return y >= 0 && x >= 0 && y < silhouette.height && x < silhouette.width && silhouette.row(y)[x] != 0;
    };
    for (int y = 0; y < silhouette.height; ++y)
        for (int x = 0; x < silhouette.width; ++x) {
            if (!inside(y, x) || (inside(y - 1, x) && inside(y + 1, x) && inside(y, x - 1) && inside(y, x + 1)))
                continue;
            for (int v = 0; v < reduction; ++v)
                for (int u = 0; u < reduction; ++u) draw_dot(canvas, x * reduction + u, y * reduction + v, 0, color);
        }
}

/// Draws a line from each joint to its parent, in the colour of the joint's side, and a dot at each joint.
///
/// Shapes  joints [J] in the world; parents [J]; sides [J]: positive left, negative right, 0 in the middle.
inline void draw_skeleton(PixelImage& canvas, const Camera<double>& camera, Span<const vec3<double>> joints,
                          Span<const int> parents, const std::vector<int>& sides, const OverlayColors& colors = {}) {
    constexpr double near = 1e-3; // metres; points behind the camera are not drawn
    const int thick = std::max(canvas.width, canvas.height) >= 720 ? 1 : 0;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        const vec3<double> p = to_camera(camera, joints[j]);
        if (!(p.z > near)) continue;
        const Rgb& color = sides[j] > 0 ? colors.left : sides[j] < 0 ? colors.right : colors.middle;
        const vec2<double> pixel = to_pixel(camera, p);
        if (parents[j] >= 0)
            if (const vec3<double> q = to_camera(camera, joints[static_cast<std::size_t>(parents[j])]); q.z > near)
                draw_line(canvas, to_pixel(camera, q), pixel, thick, color);
        if (std::abs(pixel.x) < 1e6 && std::abs(pixel.y) < 1e6)
            draw_dot(canvas, static_cast<int>(std::floor(pixel.x)), static_cast<int>(std::floor(pixel.y)), 1 + thick,
                     color);
    }
}

} // namespace gsh::programs
