// SPDX-License-Identifier: Apache-2.0
/// @file  Tiles of pixels, and which of them an ellipse touches.
#pragma once

#include <gsh/core/lane.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <cstdint>

namespace gsh {

/// An image cut into square tiles, numbered by rows.
struct TileGrid {
    static constexpr int tile_size = 16; ///< pixels
    int width = 0, height = 0;           ///< pixels

    [[nodiscard]] GSH_HD int columns() const { return (width + tile_size - 1) / tile_size; }
    [[nodiscard]] GSH_HD int rows() const { return (height + tile_size - 1) / tile_size; }
    [[nodiscard]] GSH_HD std::uint32_t size() const {
        return static_cast<std::uint32_t>(columns()) * static_cast<std::uint32_t>(rows());
    }
};

/// A linear map W of the image plane that turns a splat into a round one: with (u, v) = W (pixel - center),
///
///     opacity factor at a pixel = exp(-dᵀ Σ⁻¹ d / 2) = 2^-(u² + v²).
///
/// W is upper triangular, so v is constant along a row. Distances in (u, v) suffer no cancellation, however thin the
/// splat, where the usual conic A dx² + 2 B dx dy + C dy² loses digits by the square of its elongation.
template <class T>
struct Whitening {
    T ux, uy, vy; ///< u = ux dx + uy dy, v = vy dy
};

/// log2(e) / 2, which turns exp(-q / 2) into 2^-(…).
inline constexpr double half_log2_e = 0.72134752044448170368;

template <Lane T>
[[nodiscard]] GSH_HD Whitening<T> whiten(const sym2<T>& covariance) {
    using S = ScalarOf<T>;
    const T scale(S(0.84932180028801904272)); // sqrt(log2(e) / 2)
    const T root_yy = sqrt(covariance.yy), root_det = sqrt(determinant(covariance));
    const T inverse = scale / (root_yy * root_det);
    return {covariance.yy * inverse, -covariance.xy * inverse, root_det * inverse};
}

/// Where an ellipse u² + v² <= reach lies on the image, and the rows it spans.
template <class T>
struct Ellipse {
    T x, y; ///< centre, pixels
    Whitening<T> w;
    T reach;
};

/// Interval of x that the ellipse covers between the lines y0 <= y1 (y1 may equal y0); false if it does not get there.
template <class T>
[[nodiscard]] GSH_HD bool horizontal_extent(const Ellipse<T>& e, T y0, T y1, T& x0, T& x1) {
    const T radius = sqrt(e.reach);
    const T v0 = e.w.vy * (y0 - e.y), v1 = e.w.vy * (y1 - e.y);
    if (!(v0 <= radius && v1 >= -radius)) return false;
    // x = center + (u - shear v) / ux: on the circle u - shear v is largest at v = -shear radius / sqrt(1 + shear²),
    // and being concave in v, at the nearest v that the lines allow.
    const T shear = e.w.uy / e.w.vy;
    const T tip = radius * shear / sqrt(T(1) + shear * shear);
    const T right = clamp(-tip, v0, v1), left = clamp(tip, v0, v1);
    x1 = e.x + (sqrt(max(e.reach - right * right, T(0))) - shear * right) / e.w.ux;
    x0 = e.x - (sqrt(max(e.reach - left * left, T(0))) + shear * left) / e.w.ux;
    return true;
}

/// Half-open ranges of tile columns and rows.
struct TileRect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    [[nodiscard]] GSH_HD bool empty() const { return x0 >= x1 || y0 >= y1; }
};

namespace detail {

/// Pixels of [0, size) whose centres lie in [low, high], as a half-open range.
GSH_HD inline void pixel_range(double low, double high, int size, int& first, int& end) {
    const double last = static_cast<double>(size);
    first = static_cast<int>(clamp(-floor(0.5 - low), 0.0, last)); // ceil(low - 0.5)
    end = static_cast<int>(clamp(floor(high - 0.5) + 1, 0.0, last));
}

} // namespace detail

/// The tiles that hold the bounding box of the ellipse, given its dilated covariance. Half a millionth wider: it is
/// measured in single precision.
[[nodiscard]] GSH_HD inline TileRect tile_rect(const Ellipse<double>& e, const sym2<double>& covariance,
                                               const TileGrid& grid) {
    constexpr int size = TileGrid::tile_size;
    const double square = e.reach * ((1 + 1e-6) / half_log2_e);
    const double half_width = sqrt(static_cast<float>(square * covariance.xx));
    const double half_height = sqrt(static_cast<float>(square * covariance.yy));
    int px0, px1, py0, py1;
    detail::pixel_range(e.x - half_width, e.x + half_width, grid.width, px0, px1);
    detail::pixel_range(e.y - half_height, e.y + half_height, grid.height, py0, py1);
    if (px0 >= px1 || py0 >= py1) return {};
    return {px0 / size, py0 / size, (px1 - 1) / size + 1, (py1 - 1) / size + 1};
}

/// Tile columns of row `tile_y` with a pixel centre in reach of the ellipse's extent there, as a half-open range.
GSH_HD inline void tile_columns(const Ellipse<double>& e, int tile_y, const TileGrid& grid, int& first, int& end) {
    constexpr int size = TileGrid::tile_size;
    const int last_row = (tile_y + 1) * size < grid.height ? (tile_y + 1) * size - 1 : grid.height - 1;
    double x0, x1;
    first = end = 0;
    if (!horizontal_extent(e, tile_y * size + 0.5, last_row + 0.5, x0, x1)) return;
    int px0, px1;
    detail::pixel_range(x0, x1, grid.width, px0, px1);
    if (px0 >= px1) return;
    first = px0 / size;
    end = (px1 - 1) / size + 1;
}

} // namespace gsh
