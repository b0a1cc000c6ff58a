// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/camera/distortion.hpp>
#include <gsh/image/resample.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

using namespace gsh;

namespace {
struct Shift {
    double x, y;
    vec2<double> operator()(const vec2<double>& p) const { return {p.x + x, p.y + y}; }
};
struct Nowhere {
    vec2<float> operator()(const vec2<float>& p) const { return {p.x * std::numeric_limits<float>::quiet_NaN(), p.y}; }
};
} // namespace

TEST_CASE("the identity map keeps every bit, a half-pixel shift averages neighbours") {
    cpu::Serial backend;
    Image<double> image(2, 7, 9), same(2, 7, 9), shifted(2, 7, 9);
    image.data = test::Rng(1).numbers(image.data.size(), 0, 1);
    resample(backend, image.view(), ScaleMap<double>{}, same.view());
    CHECK(same.data == image.data);
    resample(backend, image.view(), Shift{0.5, 0}, shifted.view());
    for (int c = 0; c < 2; ++c)
        for (int y = 0; y < 7; ++y) {
            for (int x = 0; x < 8; ++x)
                CHECK(shifted.at(c, y, x) == doctest::Approx((image.at(c, y, x) + image.at(c, y, x + 1)) / 2));
            CHECK(shifted.at(c, y, 8) == doctest::Approx(image.at(c, y, 8) / 2)); // outside counts as 0
        }
    resample(backend, image.view(), Shift{100, -1e30}, shifted.view());
    CHECK(std::all_of(shifted.data.begin(), shifted.data.end(), [](double v) { return v == 0; }));
}

TEST_CASE("halving by ScaleMap averages two by two; a linear image stays linear") {
    cpu::Serial backend;
    Image<float> image(1, 8, 12), half(1, 4, 6);
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 12; ++x) image.at(0, y, x) = float(3 * x + 10 * y);
    resample(backend, image.view(), ScaleMap<float>{2, 2}, half.view());
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 6; ++x) CHECK(half.at(0, y, x) == doctest::Approx(3 * (2 * x + 0.5) + 10 * (2 * y + 0.5)));
}

TEST_CASE("resample_rgba8 keeps the colour under transparent pixels out of the picture") {
    cpu::Serial backend;
    // The left half is opaque red. The right half is transparent and bright green, which a wrong filter would mix in.
    const int h = 6, w = 8;
    std::vector<std::uint8_t> image(4 * h * w), out(4 * h * w, 77);
    for (int i = 0; i < h * w; ++i) {
        const bool left = i % w < w / 2;
        const std::uint8_t pixel[] = {std::uint8_t(left ? 200 : 0), std::uint8_t(left ? 10 : 255), 30,
                                      std::uint8_t(left ? 255 : 0)};
        std::copy(pixel, pixel + 4, image.begin() + 4 * i);
    }
    resample_rgba8<double>(backend, image, h, w, Shift{0.5, 0.25}, out, h, w);
    for (int y = 0; y < h - 1; ++y) {
        const auto pixel = [&](int x) { return out.data() + 4 * (y * w + x); };
        CHECK(int(pixel(1)[0]) == 200);
        CHECK(int(pixel(1)[3]) == 255);
        CHECK(int(pixel(3)[0]) == 200); // on the edge: half covered, pure red
        CHECK(int(pixel(3)[1]) == 10);
        CHECK(std::abs(pixel(3)[3] - 128) <= 1);
        CHECK(int(pixel(5)[3]) == 0);
        CHECK(int(pixel(5)[1]) == 0);
    }
    // The identity keeps all visible pixels.
    resample_rgba8(backend, image, h, w, ScaleMap<float>{}, out, h, w);
    for (std::size_t i = 0; i < out.size(); i += 4) {
        CHECK(out[i + 3] == image[i + 3]);
        if (out[i + 3]) CHECK(std::equal(out.begin() + long(i), out.begin() + long(i) + 3, image.begin() + long(i)));
    }
    resample_rgba8(backend, image, h, w, Nowhere{}, out, h, w);
    CHECK(std::all_of(out.begin(), out.end(), [](auto v) { return v == 0; }));
}

TEST_CASE("a distorted photograph of a smooth scene comes out straight") {
    cpu::Serial backend;
    const int h = 120, w = 160;
    UndistortMap<double> map;
    map.photographed.fx = map.photographed.fy = 150, map.photographed.cx = 83, map.photographed.cy = 58;
    map.photographed.width = w, map.photographed.height = h;
    map.straight = map.photographed;
    map.distortion = {-0.2, 0.05, 0.001, -0.002, 0};
    const auto scene = [](vec2<double> p) { return 0.5 + 0.3 * std::sin(9 * p.x) * std::cos(7 * p.y); };
    Image<double> photograph(1, h, w), straight(1, h, w);
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x)
            photograph.at(0, y, x) = scene(undistort_checked(
                map.distortion, vec2<double>((x + 0.5 - map.photographed.cx) / map.photographed.fx,
                                             (y + 0.5 - map.photographed.cy) / map.photographed.fy)));
    resample(backend, photograph.view(), map, straight.view());
    double worst = 0;
    for (int y = 4; y < h - 4; ++y)
        for (int x = 4; x < w - 4; ++x) {
            const vec2<double> p((x + 0.5 - map.straight.cx) / map.straight.fx,
                                 (y + 0.5 - map.straight.cy) / map.straight.fy);
            const vec2<double> q = map(vec2<double>(x + 0.5, y + 0.5));
            if (q.x < 1 || q.y < 1 || q.x > w - 1 || q.y > h - 1) continue;
            worst = std::max(worst, std::abs(straight.at(0, y, x) - scene(p)));
        }
    CHECK(worst < 1e-3); // bilinear between samples of this scene
}

TEST_CASE("resampling: Threads equals Serial, shapes are checked, empty images are fine") {
    cpu::Serial serial;
    Image<float> image(3, 31, 43), expected(3, 40, 37), out(3, 40, 37);
    test::Rng rng(2);
    for (float& x : image.data) x = float(rng.uniform());
    const ScaleMap<float> map{1.1f, 0.7f};
    resample(serial, image.view(), map, expected.view());
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        resample(backend, image.view(), map, out.view());
        CHECK(out.data == expected.data);
    }
    Image<float> gray(1, 31, 43), none(3, 0, 0);
    CHECK_THROWS_AS(resample(serial, gray.view(), map, out.view()), ShapeError);
    CHECK_NOTHROW(resample(serial, image.view(), map, none.view()));
    resample(serial, none.view(), map, out.view());
    CHECK(std::all_of(out.data.begin(), out.data.end(), [](float v) { return v == 0; }));

    std::vector<std::uint8_t> bytes(4 * 6), other(4 * 5);
    CHECK_THROWS_AS(resample_rgba8(serial, bytes, 2, 2, map, other, 1, 5), ShapeError);
    CHECK_THROWS_AS(resample_rgba8(serial, bytes, 2, 3, map, other, 1, 4), ShapeError);
    CHECK_THROWS_AS(resample_rgba8(serial, bytes, -2, -3, map, other, 1, 5), ValueError);
    CHECK_NOTHROW(resample_rgba8(serial, bytes, 2, 3, map, other, 1, 5));
    CHECK_NOTHROW(resample_rgba8(serial, {}, 0, 0, map, other, 1, 5));
}
