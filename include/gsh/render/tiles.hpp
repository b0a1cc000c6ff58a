// SPDX-License-Identifier: Apache-2.0
/// @file  Square tiles of pixels, and the tiles that an ellipse covers.
#pragma once

#include <gsh/core/lane.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/arithmetic.hpp>

#include <concepts>
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

/// A pixel by its column and row.
struct Pixel {
    int x = 0, y = 0;
};

/// A linear map W of the image plane in which a splat is round: with (u, v) = W (pixel - mean2d),
///
///     opacity factor at a pixel = exp(-dᵀ Σ⁻¹ d / 2) = 2^-(u² + v²).
///
/// W is upper triangular, so v is constant along a row of pixels. Distances in (u, v) suffer no cancellation, however
/// thin the splat. The usual conic A dx² + 2 B dx dy + C dy² loses digits with the square of the splat's elongation.
template <class T>
struct Whitening {
    T ux, uy, vy; ///< u = ux dx + uy dy, v = vy dy
};

/// log2(e) / 2: exp(-q / 2) = 2^-(half_log2_e q).
inline constexpr double half_log2_e = 0.72134752044448170368;

/// The map of a covariance, given 1 / sqrt of its yy and of its determinant: for callers with a faster way to compute
/// these.
template <Lane T>
[[nodiscard]] GSH_HD Whitening<T> whiten(const sym2<T>& covariance, T inverse_root_yy, T inverse_root_det) {
    const T vy = T(ScalarOf<T>(0.84932180028801904272)) * inverse_root_yy; // sqrt(log2(e) / 2)
    return {covariance.yy * vy * inverse_root_det, -covariance.xy * vy * inverse_root_det, vy};
}

template <Lane T>
[[nodiscard]] GSH_HD Whitening<T> whiten(const sym2<T>& covariance) {
    const T one(ScalarOf<T>(1));
    return whiten(covariance, one / sqrt(covariance.yy), one / sqrt(determinant(covariance)));
}

/// Three standard deviations along the longer axis of a splat on the screen, pixels.
template <Lane T>
[[nodiscard]] GSH_HD T screen_radius(const Whitening<T>& w) {
    using S = ScalarOf<T>;
    // u² + v² = log2(e)/2 dᵀ Σ⁻¹ d; the smaller eigenvalue of WᵀW is det / the larger one.
    const T trace = w.ux * w.ux + w.uy * w.uy + w.vy * w.vy, det = w.ux * w.ux * w.vy * w.vy;
    const T larger = T(S(0.5)) * (trace + sqrt(max(trace * trace - T(S(4)) * det, T(S(0)))));
    return T(S(3)) * sqrt(T(S(half_log2_e)) * larger / det);
}

/// The ellipse u² + v² <= reach around (x, y).
template <class T>
struct Ellipse {
    T x, y; ///< centre: mean2d of a splat, pixels from the corner of the pixel `origin`
    Whitening<T> w;
    T reach;
    Pixel origin = {}; ///< near the centre, where float would have too few digits for the whole image
};

/// Interval of x that the ellipse covers between the lines y0 <= y1 (y1 may equal y0); false if it does not reach them.
/// All are relative to its origin. Roundings are explicit: each pass that lists a splat's tiles must find the same.
template <std::floating_point T>
[[nodiscard]] GSH_HD bool horizontal_extent(const Ellipse<T>& e, T y0, T y1, T& x0, T& x1) {
    using detail::product;
    const T radius = sqrt(e.reach);
    const T v0 = product(e.w.vy, y0 - e.y), v1 = product(e.w.vy, y1 - e.y);
    if (!(v0 <= radius && v1 >= -radius)) return false;
    // x = e.x + (u - shear v) / ux. On the circle u² + v² = reach, u - shear v is largest at
    // v = -shear radius / sqrt(1 + shear²). It is concave in v: between the lines, its maximum is at the nearest v.
    const T shear = e.w.uy / e.w.vy;
    const T tip = product(radius, shear) / sqrt(T(1) + product(shear, shear));
    const T right = clamp(-tip, v0, v1), left = clamp(tip, v0, v1);
    x1 = e.x + (sqrt(max(e.reach - product(right, right), T(0))) - product(shear, right)) / e.w.ux;
    x0 = e.x - (sqrt(max(e.reach - product(left, left), T(0))) + product(shear, left)) / e.w.ux;
    return true;
}

/// Half-open ranges of tile columns and rows.
struct TileRect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    [[nodiscard]] GSH_HD bool empty() const { return x0 >= x1 || y0 >= y1; }
};

namespace detail {

/// x clamped to [low, high]; low if x is NaN.
template <std::floating_point T>
[[nodiscard]] GSH_HD T cut_to(T x, T low, T high) {
    const T above = x > low ? x : low;
    return above < high ? above : high;
}

/// Pixels of [0, size) whose centres lie in [low, high], as a half-open range; low and high count from the corner of
/// the pixel `origin`.
template <std::floating_point T>
GSH_HD void pixel_range(T low, T high, int origin, int size, int& first, int& end) {
    const T before = static_cast<T>(-origin), last = static_cast<T>(size - origin);
    const T from = cut_to(low - T(0.5), before, last) - before, to = cut_to(high + T(0.5), before, last) - before;
    first = static_cast<int>(from); // not negative: truncation equals floor
    first += from > static_cast<T>(first) ? 1 : 0;
    end = static_cast<int>(to);
}

} // namespace detail

/// The tiles with a pixel centre within half_width and half_height of (x, y), which count from the corner of `origin`.
template <std::floating_point T>
[[nodiscard]] GSH_HD TileRect tile_rect(T x, T y, T half_width, T half_height, const TileGrid& grid,
                                        const Pixel& origin = {}) {
    constexpr int size = TileGrid::tile_size;
    int px0, px1, py0, py1;
    detail::pixel_range(x - half_width, x + half_width, origin.x, grid.width, px0, px1);
    detail::pixel_range(y - half_height, y + half_height, origin.y, grid.height, py0, py1);
    const TileRect rect{px0 / size, py0 / size, (px1 + size - 1) / size, (py1 + size - 1) / size};
    return {rect.x0, rect.y0, px0 < px1 ? rect.x1 : rect.x0, py0 < py1 ? rect.y1 : rect.y0};
}

/// Square of half the extent of u² + v² <= reach along an axis with the given variance.
template <Lane T>
[[nodiscard]] GSH_HD T squared_extent(T reach, T variance) {
    return reach * variance * T(ScalarOf<T>(1 / half_log2_e));
}

/// Tile columns of row `tile_y` with a pixel centre in reach of the ellipse's extent there, as a half-open range.
template <std::floating_point T>
GSH_HD void tile_columns(const Ellipse<T>& e, int tile_y, const TileGrid& grid, int& first, int& end) {
    constexpr int size = TileGrid::tile_size;
    const int last_row = (tile_y + 1) * size < grid.height ? (tile_y + 1) * size - 1 : grid.height - 1;
    T x0, x1;
    first = end = 0;
    const T top = static_cast<T>(tile_y * size - e.origin.y) + T(0.5);
    const T bottom = static_cast<T>(last_row - e.origin.y) + T(0.5);
    if (!horizontal_extent(e, top, bottom, x0, x1)) return;
    int px0, px1;
    detail::pixel_range(x0, x1, e.origin.x, grid.width, px0, px1);
    if (px0 >= px1) return;
    first = px0 / size;
    end = (px1 - 1) / size + 1;
}

} // namespace gsh
