// SPDX-License-Identifier: Apache-2.0
#include <gsh/render/tiles.hpp>

#include "support/gradient.hpp"

#include <set>

using namespace gsh;

namespace {

struct Shape {
    sym2<double> covariance;
    Ellipse<double> ellipse;
};

/// Round, slanted and needle-thin ellipses, inside the image, on its edge and far away.
Shape random_shape(test::Rng& rng) {
    const double angle = rng.uniform(0, 3.2), a = std::exp(rng.uniform(-3, 6)), b = std::exp(rng.uniform(-3, 3));
    const double c = std::cos(angle), s = std::sin(angle);
    Shape shape;
    shape.covariance = {a * a * c * c + b * b * s * s + 0.3, (a * a - b * b) * c * s,
                        a * a * s * s + b * b * c * c + 0.3};
    shape.ellipse = {rng.uniform(-60, 160), rng.uniform(-60, 130), whiten(shape.covariance), rng.uniform(0.01, 8)};
    return shape;
}

TileRect tiles_around(const Ellipse<double>& e, const sym2<double>& covariance, const TileGrid& grid) {
    return tile_rect(e.x, e.y, std::sqrt(squared_extent(e.reach, covariance.xx)),
                     std::sqrt(squared_extent(e.reach, covariance.yy)), grid);
}

double squared_distance(const Ellipse<double>& e, double x, double y) {
    const double u = e.w.ux * (x - e.x) + e.w.uy * (y - e.y), v = e.w.vy * (y - e.y);
    return u * u + v * v;
}

} // namespace

TEST_CASE("whiten turns the covariance into half log2(e) of its inverse") {
    test::Rng rng(1);
    for (int i = 0; i < 50; ++i) {
        const auto [covariance, e] = random_shape(rng);
        const double det = determinant(covariance), dx = rng.uniform(-9, 9), dy = rng.uniform(-9, 9);
        const double q = (covariance.yy * dx * dx - 2 * covariance.xy * dx * dy + covariance.xx * dy * dy) / det;
        CHECK(squared_distance(e, e.x + dx, e.y + dy) == doctest::Approx(q * half_log2_e).epsilon(1e-9));
    }
}

TEST_CASE("the tiles of an ellipse are exactly those that hold its extent in their rows of pixels") {
    test::Rng rng(2);
    const TileGrid grid{101, 67};
    REQUIRE(grid.columns() == 7);
    REQUIRE(grid.rows() == 5);
    int missed = 0, surplus = 0, found = 0;
    for (int i = 0; i < 2000; ++i) {
        const auto [covariance, e] = random_shape(rng);
        std::set<std::pair<int, int>> truth, tiles;
        for (int y = 0; y < grid.height; ++y)
            for (int x = 0; x < grid.width; ++x)
                if (squared_distance(e, x + 0.5, y + 0.5) <= e.reach) truth.insert({x / 16, y / 16});
        const TileRect rect = tiles_around(e, covariance, grid);
        for (int y = rect.y0; y < rect.y1; ++y) {
            int first, end;
            tile_columns(e, y, grid, first, end);
            if (first == end) continue;
            CHECK(first >= rect.x0);
            CHECK(end <= rect.x1);
            for (int x = first; x < end; ++x) tiles.insert({x, y});
        }
        for (const auto& tile : truth) missed += tiles.count(tile) == 0;
        for (const auto& tile : tiles) surplus += truth.count(tile) == 0;
        found += static_cast<int>(truth.size());
    }
    CHECK(found > 2000);
    CHECK(missed == 0);
    CHECK(surplus < found / 20); // an ellipse may pass between the pixel centres
}

TEST_CASE("what lies off the image or on no pixel centre has no tiles") {
    const TileGrid grid{40, 40};
    const sym2<double> covariance{0.3, 0, 0.3};
    const Whitening<double> w = whiten(covariance);
    CHECK(tiles_around({-20, 10, w, 5}, covariance, grid).empty());
    CHECK(tiles_around({10, 1e12, w, 5}, covariance, grid).empty());
    CHECK(tiles_around({10, 10, w, 1e-3}, covariance, grid).empty());
    const TileRect corner = tiles_around({39.5, 39.5, w, 1e-3}, covariance, grid);
    CHECK(corner.x0 == 2);
    CHECK(corner.x1 == 3);
    CHECK(corner.y1 == 3);
}

TEST_CASE("a splat's radius on the screen is three standard deviations along its longer axis") {
    CHECK(screen_radius(whiten(sym2<double>{9, 0, 4})) == doctest::Approx(9));
    CHECK(screen_radius(whiten(sym2<double>{6.5, 2.5, 6.5})) == doctest::Approx(9)); // turned by 45 degrees
}
