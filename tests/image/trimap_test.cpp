// SPDX-License-Identifier: Apache-2.0
#include <gsh/image/trimap.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

constexpr int width = 60, height = 40;

/// A disc of radius 12 around (30, 20) before a background that grows brighter to the right. The disc's colour is that of
/// the background, less `contrast` in blue.
std::vector<std::uint8_t> disc(int contrast = 10) {
    std::vector<std::uint8_t> rgba;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const bool inside = std::hypot(x - 30, y - 20) < 12;
            const int ground = 40 + 2 * x;
            for (const int value : {ground, ground, inside ? 90 - contrast : 90, inside ? 255 : 0})
                rgba.push_back(static_cast<std::uint8_t>(value));
        }
    return rgba;
}
double distance_to_centre(const UnknownPixel& pixel) {
    const int index = static_cast<int>(pixel.index);
    return std::hypot(index % width - 30, index / width - 20);
}

} // namespace

TEST_CASE("unknown pixels are those near the outline, with the background from outside") {
    const std::vector<std::uint8_t> rgba = disc();
    for (const double radius : {1.0, 2.5, 4.0}) {
        CAPTURE(radius);
        const std::vector<UnknownPixel> unknown = unknown_pixels(rgba, height, width, radius);
        std::vector<bool> is_unknown(rgba.size() / 4, false);
        for (const UnknownPixel& pixel : unknown) {
            is_unknown[pixel.index] = true;
            CHECK(std::abs(distance_to_centre(pixel) - 12) < radius + 1.5);
            const int x = static_cast<int>(pixel.index) % width;
            for (std::size_t c = 0; c < 2; ++c) CHECK(std::abs(pixel.background[c] - (40 + 2 * x)) <= 4 * radius + 5);
            CHECK(pixel.background[2] == 90); // not that of the disc
        }
        for (std::size_t i = 0; i < is_unknown.size(); ++i)
            if (std::abs(distance_to_centre({static_cast<std::uint32_t>(i), {}}) - 12) < radius - 1)
                CHECK(is_unknown[i]);
        CHECK(std::is_sorted(unknown.begin(), unknown.end(), [](auto& a, auto& b) { return a.index < b.index; }));
    }
    CHECK(unknown_pixels(rgba, height, width, 0).empty());
}

TEST_CASE("pixels inside of the mask are known where their colour is none of the background's") {
    const std::vector<std::uint8_t> alike = disc(), distinct = disc(60);
    std::vector<bool> is_unknown(alike.size() / 4, false);
    for (const UnknownPixel& pixel : unknown_pixels(distinct, height, width, 4)) is_unknown[pixel.index] = true;
    std::size_t known = 0;
    for (const UnknownPixel& pixel : unknown_pixels(alike, height, width, 4)) {
        const bool deep = distance_to_centre(pixel) < 12 - 2.5; // at least two pixels inside of the outline
        const bool outside = distance_to_centre(pixel) >= 12;
        if (deep) CHECK(!is_unknown[pixel.index]);
        if (outside) CHECK(is_unknown[pixel.index]);
        known += !is_unknown[pixel.index];
    }
    CHECK(known > 100);

    // A mark in the background near the outline has the disc's colour: then that colour says nothing near it.
    std::vector<std::uint8_t> marked = distinct;
    for (int y = 15; y < 25; ++y)
        for (int x = 46; x < 50; ++x) marked[4 * static_cast<std::size_t>(y * width + x) + 2] = 90 - 60;
    bool near_the_mark = false;
    for (const UnknownPixel& pixel : unknown_pixels(marked, height, width, 4))
        near_the_mark |= distance_to_centre(pixel) < 12 - 2.5;
    CHECK(near_the_mark);
}

TEST_CASE("a mask without a background behind it is believed") {
    for (const int value : {0, 255}) {
        std::vector<std::uint8_t> rgba = disc();
        for (std::size_t i = 0; i < rgba.size(); i += 4)
            if (rgba[i + 3] == 0)
                std::fill_n(rgba.begin() + static_cast<std::ptrdiff_t>(i), 3, static_cast<std::uint8_t>(value));
        CHECK(unknown_pixels(rgba, height, width, 3).empty());
        rgba[1] ^= 1; // one pixel of it is enough
        CHECK(!unknown_pixels(rgba, height, width, 3).empty());
    }
    std::vector<std::uint8_t> full = disc();
    for (std::size_t i = 3; i < full.size(); i += 4) full[i] = 255;
    CHECK(unknown_pixels(full, height, width, 3).empty());
    // A disc that fills almost all: a corner is background, and all unknown pixels hang together with it.
    full[3] = 0;
    CHECK(unknown_pixels(full, height, width, 3).size() < 3); // no background remains outside of the unknown pixels
}

TEST_CASE("wrong sizes are refused") {
    const std::vector<std::uint8_t> rgba = disc();
    CHECK_THROWS_AS((void)unknown_pixels(rgba, height, width - 1, 2), ShapeError);
    CHECK_THROWS_AS((void)unknown_pixels(rgba, height, width, -1), ValueError);
}

TEST_CASE("hidden pixels are the white ones of a picture, and count before unknown ones") {
    const std::vector<std::uint8_t> picture{0, 127, 128, 255};
    const std::vector<UnknownPixel> hidden = hidden_pixels(picture);
    REQUIRE(hidden.size() == 2);
    CHECK(hidden[0].index == 2);
    CHECK(hidden[1].index == 3);
    CHECK(hidden[1].hidden == 1);
    const std::vector<UnknownPixel> unknown{{0, {9, 9, 9}}, {2, {8, 8, 8}}}, both = with_hidden(unknown, hidden);
    REQUIRE(both.size() == 3);
    CHECK(both[0].hidden == 0);
    CHECK(both[0].background[0] == 9);
    CHECK(both[1].index == 2);
    CHECK(both[1].hidden == 1);
    CHECK(both[2].index == 3);
}
