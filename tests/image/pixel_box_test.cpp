// SPDX-License-Identifier: Apache-2.0
#include <gsh/image/pixel_box.hpp>

#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

TEST_CASE("box_of_mask is the smallest box with all pixels that have alpha") {
    constexpr int height = 9, width = 7;
    std::vector<std::uint8_t> rgba(4 * height * width, 77);
    for (std::size_t i = 3; i < rgba.size(); i += 4) rgba[i] = 0;
    const auto alpha = [&](int x, int y) -> std::uint8_t& {
        return rgba[4 * whole_picture(height, width).index(x, y) + 3];
    };
    CHECK(box_of_mask(rgba, height, width).size() == 0);
    alpha(5, 3) = 1;
    CHECK(box_of_mask(rgba, height, width) == PixelBox{5, 3, 1, 1});
    alpha(2, 6) = 255;
    CHECK(box_of_mask(rgba, height, width) == PixelBox{2, 3, 4, 4});
    alpha(0, 8) = alpha(6, 0) = 9;
    CHECK(box_of_mask(rgba, height, width) == whole_picture(height, width));
    CHECK_THROWS_AS((void)box_of_mask(rgba, height, width + 1), ShapeError);
    CHECK(box_of_mask({}, 0, 0).size() == 0);
}

TEST_CASE("a box numbers its pixels row by row, and contains no others") {
    const PixelBox box{3, 1, 4, 2};
    CHECK(box.size() == 8);
    std::size_t next = 0;
    for (int y = -1; y < 5; ++y)
        for (int x = -1; x < 9; ++x) {
            const bool inside = x >= 3 && x < 7 && y >= 1 && y < 3;
            CHECK(box.contains(x, y) == inside);
            if (inside) CHECK(box.index(x, y) == next++);
        }
    PixelBox grown;
    CHECK_FALSE(grown.contains(0, 0));
    for (const auto& [x, y] : {std::pair{6, 2}, {3, 1}, {4, 2}}) grown.include(x, y);
    CHECK(grown == box);
}

TEST_CASE("a box's pixels are copied between pictures of other boxes, and nothing else changes") {
    const PixelBox from_box{1, 2, 5, 4}, to_box{2, 0, 3, 7}, box{2, 3, 3, 2};
    std::vector<std::uint8_t> from(4 * from_box.size()), to(4 * to_box.size(), 200);
    for (std::size_t i = 0; i < from.size(); ++i) from[i] = std::uint8_t(i);
    copy_pixels(box, from, from_box, to, to_box);
    for (int y = 0; y < 7; ++y)
        for (int x = 2; x < 5; ++x)
            for (std::size_t c = 0; c < 4; ++c)
                CHECK(to[4 * to_box.index(x, y) + c] ==
                      (box.contains(x, y) ? from[4 * from_box.index(x, y) + c] : 200));
    copy_pixels({}, {}, {}, {}, {});
}

TEST_CASE("a box outside of the picture is refused with its columns and rows") {
    CHECK_NOTHROW(check_box("here", "box", {0, 0, 5, 4}, 4, 5));
    CHECK_NOTHROW(check_box("here", "box", {5, 4, 0, 0}, 4, 5));
    for (const PixelBox& bad : {PixelBox{-1, 0, 2, 2}, {0, -1, 2, 2}, {4, 0, 2, 2}, {0, 3, 2, 2}, {0, 0, -1, 2}})
        CHECK_THROWS_AS(check_box("here", "box", bad, 4, 5), ValueError);
    std::string message;
    try {
        check_box("here", "the box", {4, 0, 2, 3}, 4, 5);
    } catch (const ValueError& error) {
        message = error.what();
    }
    for (const char* part : {"here", "the box", "columns 4 to 6", "rows 0 to 3", "5 x 4"})
        CHECK(message == test::contains(part));
}
