// SPDX-License-Identifier: Apache-2.0
/// @file  The tiles of a splat, and the 4x4 blocks of a tile's pixels that it may touch.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/render/arithmetic.hpp>
#include <gsh/render/tiles.hpp>

#include <concepts>
#include <cstdint>

namespace gsh {

/// The tiles of one splat. For a rectangle of up to 8x8 tiles, the mask has one bit for each tile, eight to a row. For
/// a larger rectangle it is 0, and the tiles follow from the shape of the splat.
struct TileCover {
    std::uint64_t mask = 0;
    std::uint16_t x0 = 0, y0 = 0, columns = 0, rows = 0;
};

namespace detail {

/// The cover of a rectangle, still without its mask.
[[nodiscard]] GSH_HD inline TileCover cover_of(const TileRect& rect) {
    return {0, static_cast<std::uint16_t>(rect.x0), static_cast<std::uint16_t>(rect.y0),
            static_cast<std::uint16_t>(rect.x1 - rect.x0), static_cast<std::uint16_t>(rect.y1 - rect.y0)};
}

[[nodiscard]] GSH_HD inline bool fits_mask(const TileCover& cover) {
    return cover.columns <= 8 && cover.rows <= 8;
}

/// Columns of tiles, as a half-open range, that the ellipse meets in a row of its rectangle.
template <class T>
GSH_HD void cover_columns(const Ellipse<T>& ellipse, const TileCover& cover, int row, const TileGrid& grid, int& first,
                          int& end) {
    tile_columns(ellipse, row, grid, first, end);
    const int left = cover.x0, right = cover.x0 + cover.columns;
    first = first < left ? left : first; // the rectangle was rounded differently
    end = right < end ? right : end;
    end = end < first ? first : end;
}

/// The mask of a cover's whole rectangle, of up to 8x8 tiles.
[[nodiscard]] GSH_HD inline std::uint64_t whole_mask(const TileCover& cover) {
    constexpr std::uint64_t first_column = 0x0101010101010101ull;
    return ((1ull << cover.columns) - 1) * (first_column >> (64 - 8 * cover.rows));
}
/// The part of the mask of columns [first, end) of tiles in a row that is counted from the rectangle's first.
[[nodiscard]] GSH_HD inline std::uint64_t row_mask(const TileCover& cover, int row, int first, int end) {
    return first == end ? 0 : ((1ull << (end - first)) - 1) << (8 * row + first - cover.x0);
}

/// Sets the mask of a rectangle of up to 8x8 tiles; returns the number of tiles.
template <class T>
[[nodiscard]] GSH_HD std::uint32_t set_mask(const Ellipse<T>& ellipse, const TileGrid& grid, TileCover& cover) {
    const int columns = cover.columns, rows = cover.rows;
    if (columns == 1 || rows == 1) { // the ellipse meets all tiles
        cover.mask = whole_mask(cover);
        return static_cast<std::uint32_t>(columns * rows);
    }
    std::uint32_t count = 0;
    for (int y = 0; y < rows; ++y) {
        int first, end;
        cover_columns(ellipse, cover, cover.y0 + y, grid, first, end);
        count += static_cast<std::uint32_t>(end - first);
        cover.mask |= row_mask(cover, y, first, end);
    }
    return count;
}

inline namespace GSH_ISA { // roundings depend on the instruction set

/// Bit b is set for each block b of 4x4 pixels, four to a row of the 16x16 tile, that the ellipse u² + v² <= reach may
/// meet between the first and the last line of pixels; (u, v) are those of the centre of the tile's first pixel. It
/// works as horizontal_extent (tiles.hpp), in single precision with a margin and without branches.
template <Lane T>
    requires(std::same_as<ScalarOf<T>, float>)
[[nodiscard]] GSH_INLINE GSH_HD IndexOf<T> touched_blocks(T u, T v, const Whitening<T>& w, T reach) {
    using Index = IndexOf<T>;
    const T zero(0.0f);
    const T inverse_ux = rough_ratio(T(1.0f), w.ux), shear = rough_ratio(w.uy, w.vy);
    const T radius = rough_sqrt(reach) * T(1.0001f);
    const T tip = rough_ratio(radius * shear, rough_sqrt(T(1.0f) + shear * shear));
    const T margin = T(2e-3f) + T(4e-6f) * abs(shear);
    const T base = shear * v - u, widest = radius + margin;
    Index found(0u);
    for (int row = 0; row < 4; ++row) {
        const T low = v + T(static_cast<float>(4 * row)) * w.vy, high = low + T(3.0f) * w.vy;
        const T at_right = clamp(-tip, low, high), at_left = clamp(tip, low, high);
        const T right_u = rough_sqrt(max(reach - at_right * at_right, zero)) + margin;
        const T left_u = rough_sqrt(max(reach - at_left * at_left, zero)) + margin;
        const T right = (base - shear * at_right + right_u) * inverse_ux;
        const T left = (base - shear * at_left - left_u) * inverse_ux;
        const auto inside = (low <= widest) & (high >= -widest);
        for (int column = 0; column < 4; ++column) {
            const auto touched = inside & (right >= T(static_cast<float>(4 * column))) &
                                 (left <= T(static_cast<float>(4 * column + 3)));
            found = found | select(touched, Index(1u << (4 * row + column)), Index(0u));
        }
    }
    return found;
}

} // namespace GSH_ISA

} // namespace detail

} // namespace gsh
