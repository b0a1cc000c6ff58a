// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/image/reduce.hpp>

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

namespace gsh {

TEST_CASE("A block becomes its mean, its colour that of its opaque pixels; what is no whole block is dropped") {
    cpu::Serial backend;
    // 3 x 5 pixels, reduced by 2: one row of two blocks.
    std::vector<std::uint8_t> image(4 * 3 * 5, 99), out(4 * 1 * 2);
    const auto set = [&](int y, int x, std::vector<std::uint8_t> rgba) {
        std::copy(rgba.begin(), rgba.end(), image.begin() + 4 * (y * 5 + x));
    };
    set(0, 0, {10, 20, 30, 255}), set(0, 1, {20, 40, 60, 255}), set(1, 0, {30, 0, 90, 255}), set(1, 1, {40, 0, 0, 255});
    set(0, 2, {200, 100, 0, 255}), set(0, 3, {0, 255, 0, 0}), set(1, 2, {0, 255, 0, 0}), set(1, 3, {100, 100, 0, 255});
    reduce_rgba8(backend, Span<const std::uint8_t>(image), 3, 5, 2, Span<std::uint8_t>(out));
    CHECK(out == std::vector<std::uint8_t>{25, 15, 45, 255, 150, 100, 0, 128});
}

TEST_CASE("A factor of 1 copies visible pixels; transparent blocks are black and transparent") {
    cpu::Serial backend;
    const std::vector<std::uint8_t> image{1, 2, 3, 255, 7, 8, 9, 1, 50, 60, 70, 0, 5, 5, 5, 128};
    std::vector<std::uint8_t> out(image.size());
    reduce_rgba8(backend, Span<const std::uint8_t>(image), 2, 2, 1, Span<std::uint8_t>(out));
    CHECK(out == std::vector<std::uint8_t>{1, 2, 3, 255, 7, 8, 9, 1, 0, 0, 0, 0, 5, 5, 5, 128});
}

TEST_CASE("Threads computes the bits of Serial") {
    std::vector<std::uint8_t> image(4 * 67 * 91);
    for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint8_t>(i * i + 31 * i);
    std::vector<std::uint8_t> a(4 * 13 * 18), b(a.size(), 1);
    cpu::Serial serial;
    cpu::Threads threads(3);
    reduce_rgba8(serial, Span<const std::uint8_t>(image), 67, 91, 5, Span<std::uint8_t>(a));
    reduce_rgba8(threads, Span<const std::uint8_t>(image), 67, 91, 5, Span<std::uint8_t>(b));
    CHECK(a == b);
}

TEST_CASE("Sizes that do not fit are refused") {
    cpu::Serial backend;
    std::vector<std::uint8_t> image(4 * 4 * 4), out(4 * 2 * 2);
    const auto reduce = [&](int height, int width, int factor) {
        reduce_rgba8(backend, Span<const std::uint8_t>(image), height, width, factor, Span<std::uint8_t>(out));
    };
    CHECK_NOTHROW(reduce(4, 4, 2));
    CHECK_THROWS_AS(reduce(4, 4, 0), ValueError);
    CHECK_THROWS_AS(reduce(4, 4, -2), ValueError);
    CHECK_THROWS_AS(reduce(4, 4, 1), ShapeError);
    CHECK_THROWS_AS(reduce(3, 4, 2), ShapeError);
}

} // namespace gsh
