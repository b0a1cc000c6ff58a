// SPDX-License-Identifier: Apache-2.0
/// @file  Silhouettes of masks and of posed meshes, and their overlap.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

struct Silhouette {
    int height = 0, width = 0;
    std::vector<std::uint8_t> inside; // [height, width] 1 inside the silhouette, else 0

    [[nodiscard]] const std::uint8_t* row(int y) const {
        return inside.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
    }
    [[nodiscard]] std::size_t area() const {
        std::size_t sum = 0;
        for (const std::uint8_t pixel : inside) sum += pixel;
        return sum;
    }
    /// Fraction of all pixels that are inside.
    [[nodiscard]] double share() const {
        return static_cast<double>(area()) / static_cast<double>(std::max<std::size_t>(1, inside.size()));
    }
    /// Fraction of the pixels on the image's border that are inside.
    [[nodiscard]] double border_share() const {
        double sum = 0, count = 0;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; x += y == 0 || y == height - 1 ? 1 : std::max(1, width - 1))
                sum += row(y)[x], count += 1;
        return sum / std::max(1.0, count);
    }
    /// Mean position of the pixels inside; zero if there are none.
    [[nodiscard]] vec2<double> centroid() const {
        vec2<double> sum(0);
        double count = 0;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                if (row(y)[x]) sum += vec2<double>(x + 0.5, y + 0.5), count += 1;
        return sum / std::max(1.0, count);
    }
    void invert() {
        for (std::uint8_t& pixel : inside) pixel ^= 1;
    }
    /// Mirrors the silhouette in x.
    void mirror() {
        for (int y = 0; y < height; ++y) {
            const auto first = inside.begin() + static_cast<std::ptrdiff_t>(y) * width;
            std::reverse(first, first + width);
        }
    }
};

/// The pixels at which the mean alpha of reduction x reduction pixels is at least 1/2.
///
/// Shapes  image RGBA.
[[nodiscard]] inline Silhouette mask_silhouette(const PixelImage& image, int reduction = 1) {
    check_value(image.channels == 4, "mask_silhouette",
                "the image has " + std::to_string(image.channels) + " channels, expected 4 (RGBA)");
    check_value(reduction >= 1, "mask_silhouette", "reduction must be at least 1");
    Silhouette result{image.height / reduction, image.width / reduction, {}};
    result.inside.reserve(static_cast<std::size_t>(result.height) * static_cast<std::size_t>(result.width));
    const int half = 128 * reduction * reduction;
    for (int y = 0; y < result.height; ++y)
        for (int x = 0; x < result.width; ++x) {
            int sum = 0;
            for (int v = 0; v < reduction; ++v)
                for (int u = 0; u < reduction; ++u) sum += image.pixel(y * reduction + v, x * reduction + u)[3];
            result.inside.push_back(sum >= half);
        }
    return result;
}

/// The pixels whose centres a mesh covers.
[[nodiscard]] inline Silhouette mesh_silhouette(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                                                const Camera<double>& camera) {
    cpu::Serial serial;
    auto mask = rasterize_mesh(serial, vertices, faces, camera).mask();
    return {mask.height, mask.width, std::move(mask.data)};
}

/// The union of several silhouettes of the same size.
[[nodiscard]] inline Silhouette united(const std::vector<Silhouette>& silhouettes) {
    Silhouette result = silhouettes.front();
    for (const Silhouette& other : silhouettes)
        for (std::size_t i = 0; i < result.inside.size(); ++i) result.inside[i] |= other.inside[i];
    return result;
}

/// The pixels of a silhouette that are farther than `radius` pixels, along rows and columns, from all pixels outside.
/// Beyond the image there is nothing outside.
[[nodiscard]] inline Silhouette eroded(const Silhouette& silhouette, int radius) {
    Silhouette result = silhouette;
    const auto pass = [&](int lines, int length, std::size_t line_step, std::size_t step) {
        for (int line = 0; line < lines; ++line) {
            std::uint8_t* first = result.inside.data() + static_cast<std::size_t>(line) * line_step;
            const auto at = [&](int k) -> std::uint8_t& { return first[static_cast<std::size_t>(k) * step]; };
            int outside = -radius - 1; // the last pixel outside
            std::vector<int> reached(static_cast<std::size_t>(length));
            for (int k = 0; k < length; ++k) {
                if (!at(k)) outside = k;
                reached[static_cast<std::size_t>(k)] = k - outside;
            }
            outside = length + radius;
            for (int k = length - 1; k >= 0; --k) {
                if (!at(k)) outside = k;
                at(k) = reached[static_cast<std::size_t>(k)] > radius && outside - k > radius;
            }
        }
    };
    const auto width = static_cast<std::size_t>(silhouette.width);
    pass(silhouette.height, silhouette.width, width, 1);
    pass(silhouette.width, silhouette.height, 1, width);
    return result;
}

/// Intersection over union, stored as two counts, so that overlaps can be summed.
struct Overlap {
    std::size_t both = 0, either = 0;

    Overlap& operator+=(const Overlap& o) {
        both += o.both, either += o.either;
        return *this;
    }
    [[nodiscard]] double iou() const { return either ? static_cast<double>(both) / static_cast<double>(either) : 0.0; }
};

/// Overlap of `a`, shifted by (dx, dy) pixels within its image, with `b`.
///
/// Errors  ShapeError if their sizes differ.
[[nodiscard]] inline Overlap overlap(const Silhouette& a, const Silhouette& b, int dx = 0, int dy = 0) {
    check_size("overlap", "rows of the second silhouette", static_cast<std::size_t>(b.height),
               static_cast<std::size_t>(a.height));
    check_size("overlap", "columns of the second silhouette", static_cast<std::size_t>(b.width),
               static_cast<std::size_t>(a.width));
    std::size_t both = 0, moved = 0;
    const int x0 = std::max(0, dx), x1 = std::min(a.width, a.width + dx);
    for (int y = std::max(0, dy); y < std::min(a.height, a.height + dy); ++y) {
        const std::uint8_t *p = a.row(y - dy), *q = b.row(y);
        for (int x = x0; x < x1; ++x) both += p[x - dx] & q[x], moved += p[x - dx];
    }
    return {both, moved + b.area() - both};
}

} // namespace gsh
