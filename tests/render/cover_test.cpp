// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/wide.hpp>
#include <gsh/render/blend.hpp>
#include <gsh/render/cover.hpp>

#include "support/gradient.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

using namespace gsh;

namespace {

sym2<double> random_covariance(test::Rng& rng, double longest) {
    const double angle = rng.uniform(0, 3.2), a = std::exp(rng.uniform(-1, std::log(longest)));
    const double b = std::exp(rng.uniform(-2, 1)), c = std::cos(angle), s = std::sin(angle);
    return {a * a * c * c + b * b * s * s + 0.3, (a * a - b * b) * c * s, a * a * s * s + b * b * c * c + 0.3};
}

} // namespace

TEST_CASE("no pixel that a splat draws lies outside the blocks that it may touch, and few others do") {
    test::Rng rng(1);
    int drawn_blocks = 0, touched_blocks = 0, missed = 0;
    for (int i = 0; i < 5000; ++i) {
        const Whitening<double> w = whiten(random_covariance(rng, 40));
        const double x = rng.uniform(-12, 28), y = rng.uniform(-12, 28), cut = rng.uniform(0.01, 8);
        const double u0 = w.ux * (0.5 - x) + w.uy * (0.5 - y), v0 = w.vy * (0.5 - y);
        const Whitening<float> narrow{static_cast<float>(w.ux), static_cast<float>(w.uy), static_cast<float>(w.vy)};
        const std::uint32_t touched = detail::touched_blocks(static_cast<float>(u0), static_cast<float>(v0), narrow,
                                                             static_cast<float>(detail::generous(cut)));
        // A CPU finds them for a register of splats, with a machine's own approximation of roots.
        using W = Wide<float>;
        const Whitening<W> wide{narrow.ux, narrow.uy, narrow.vy};
        const W wide_u(static_cast<float>(u0)), wide_v(static_cast<float>(v0));
        const std::uint32_t touched_wide =
            detail::touched_blocks(wide_u, wide_v, wide, W(static_cast<float>(detail::generous(cut))))[0];
        std::uint32_t drawn = 0;
        for (int py = 0; py < 16; ++py)
            for (int px = 0; px < 16; ++px) {
                const double u = u0 + w.ux * px + w.uy * py, v = v0 + w.vy * py;
                if (u * u + v * v <= cut) drawn |= 1u << (py / 4 * 4 + px / 4);
            }
        missed += (drawn & ~touched) != 0 || (drawn & ~touched_wide) != 0;
        for (int b = 0; b < 16; ++b) drawn_blocks += drawn >> b & 1u, touched_blocks += touched >> b & 1u;
    }
    CHECK(missed == 0);
    CHECK(drawn_blocks > 5000);
    CHECK(touched_blocks < drawn_blocks * 1.1);
}

TEST_CASE("in float, around a pixel near the centre, covers have every tile of the exact ones in a wide image") {
    test::Rng rng(2);
    const TileGrid grid{7680, 130};
    std::uint32_t exact_tiles = 0, found_tiles = 0;
    for (int i = 0; i < 3000; ++i) {
        const sym2<double> covariance = random_covariance(rng, 15);
        const double x = rng.uniform(-20, 7700), y = rng.uniform(-20, 150), cut = rng.uniform(0.1, 8);
        const Ellipse<double> exact{x, y, whiten(covariance), cut};
        const Pixel origin{static_cast<int>(x), static_cast<int>(y)};
        const Whitening<double>& w = exact.w;
        const Ellipse<float> narrow{static_cast<float>(x - origin.x),
                                    static_cast<float>(y - origin.y),
                                    {static_cast<float>(w.ux), static_cast<float>(w.uy), static_cast<float>(w.vy)},
                                    detail::generous(static_cast<float>(cut)),
                                    origin};
        const auto cover_in = [&](const auto& e) {
            using T = std::remove_cvref_t<decltype(e.x)>;
            const T half_width = std::sqrt(squared_extent(e.reach, static_cast<T>(covariance.xx)));
            const T half_height = std::sqrt(squared_extent(e.reach, static_cast<T>(covariance.yy)));
            const TileRect rect = tile_rect(e.x, e.y, half_width, half_height, grid, e.origin);
            TileCover cover;
            if (rect.empty()) return cover;
            cover = detail::cover_of(rect);
            REQUIRE(detail::fits_mask(cover));
            const std::uint32_t tiles = detail::set_mask(e, grid, cover);
            CHECK(tiles == static_cast<std::uint32_t>(std::popcount(cover.mask)));
            return cover;
        };
        const TileCover a = cover_in(exact), b = cover_in(narrow);
        for (int bit = 0; bit < 64; ++bit) {
            if ((a.mask >> bit & 1u) == 0) continue;
            ++exact_tiles;
            const int column = a.x0 + bit % 8 - b.x0, row = a.y0 + bit / 8 - b.y0;
            REQUIRE(column >= 0);
            REQUIRE(row >= 0);
            CHECK((b.mask >> (8 * row + column) & 1u) == 1);
        }
        found_tiles += static_cast<std::uint32_t>(std::popcount(b.mask));
    }
    CHECK(exact_tiles > 3000);
    CHECK(found_tiles < exact_tiles * 1.01);
}
