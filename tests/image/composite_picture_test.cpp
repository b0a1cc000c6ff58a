// SPDX-License-Identifier: Apache-2.0
/// @file  A picture that is composited where it is read.
#include <gsh/backend/serial.hpp>
#include <gsh/image/composite_picture.hpp>

#include <doctest/doctest.h>

#include "support/gradient.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

TEST_CASE_TEMPLATE("CompositePicture has the bits that composite_rgba8 writes", T, float, double) {
    const int h = 23, w = 17;
    cpu::Serial backend;
    Image<T> behind(3, h, w);
    for (std::size_t i = 0; i < behind.data.size(); ++i) behind.data[i] = T(i % 97) / T(97);
    for (const PixelBox& box : {PixelBox{4, 7, 11, 9}, {0, 0, w, 5}, {3, 3, 0, 0}, {0, 0, w, h}})
        for (const bool plain : {true, false}) {
            test::Rng rng(4);
            std::vector<std::uint8_t> bytes;
            for (std::size_t i = 0; i < 4 * box.size(); ++i)
                bytes.push_back(static_cast<std::uint8_t>(i % 12 == 3   ? 0
                                                          : i % 12 == 7 ? 255
                                                                        : 256 * rng.uniform()));
            CompositePicture<T> picture{.rgba = bytes, .box = box, .color = {0.3, 1, 0.7}, .height = h, .width = w};
            Image<T> color(3, h, w), alpha(1, h, w);
            if (plain) {
                composite_rgba8(backend, bytes, h, w, picture.color, color.view(), alpha.view(), box);
            } else {
                picture.image = std::as_const(behind).view();
                composite_rgba8(backend, bytes, h, w, picture.image, color.view(), alpha.view(), box);
            }
            CHECK_NOTHROW(check_picture(backend, "test", "picture", picture, 3, h, w));
            CHECK_NOTHROW(check_picture(backend, "test", "mask", picture.mask(), 1, h, w));
            for (int y = 0; y < h; ++y)
                for (int x = 0; x < w; ++x) {
                    for (int c = 0; c < 3; ++c) REQUIRE(picture.at(c, y, x) == color.at(c, y, x));
                    REQUIRE(picture.mask().at(0, y, x) == alpha.at(0, y, x));
                }
        }
}

TEST_CASE("CompositePicture: shapes are checked") {
    cpu::Serial backend;
    const std::vector<std::uint8_t> bytes(4 * 6);
    const Image<float> behind(3, 5, 4), other(3, 4, 5);
    const auto check = [&](const CompositePicture<float>& picture) {
        check_picture(backend, "test", "picture", picture, 3, 5, 4);
    };
    const CompositePicture<float> good{
        .rgba = bytes, .box = {1, 1, 3, 2}, .color = {}, .image = behind.view(), .height = 5, .width = 4};
    CHECK_NOTHROW(check(good));
    CHECK_THROWS_AS(check(good.mask()), ShapeError);
    CompositePicture<float> bad = good;
    bad.box.height = 3; // more pixels than bytes
    CHECK_THROWS_AS(check(bad), ShapeError);
    bad = good, bad.box.x = 2; // beyond the right side
    CHECK_THROWS_AS(check(bad), ValueError);
    bad = good, bad.image = other.view();
    CHECK_THROWS_AS(check(bad), ShapeError);
    bad = good, bad.height = 6;
    CHECK_THROWS_AS(check(bad), ShapeError);
}

} // namespace gsh
