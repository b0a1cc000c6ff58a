// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/image/color.hpp>
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

using namespace gsh;

namespace {
std::vector<std::uint8_t> random_bytes(std::size_t count, std::uint64_t seed) {
    test::Rng rng(seed);
    std::vector<std::uint8_t> bytes(count);
    for (auto& byte : bytes) byte = std::uint8_t(rng.below(256));
    return bytes;
}
} // namespace

TEST_CASE("the sRGB curve: known values, inverse of each other, adjoints") {
    CHECK(srgb_to_linear(0.0) == 0);
    CHECK(srgb_to_linear(1.0) == doctest::Approx(1).epsilon(1e-14));
    CHECK(srgb_to_linear(0.5) == doctest::Approx(std::pow(0.555 / 1.055, 2.4)).epsilon(1e-14));
    CHECK(srgb_to_linear(0.04) == doctest::Approx(0.04 / 12.92).epsilon(1e-14));
    CHECK(linear_to_srgb(0.18) == doctest::Approx(1.055 * std::pow(0.18, 1 / 2.4) - 0.055).epsilon(1e-14));
    for (double s = -0.1; s <= 1.3; s += 0.013) {
        // Where the standard's two formulas meet, they differ by 3e-8.
        CHECK(linear_to_srgb(srgb_to_linear(s)) == doctest::Approx(s).epsilon(1e-7));
        CHECK(linear_to_srgb(srgb_to_linear(float(s))) == doctest::Approx(s).epsilon(1e-5));
        double x = s, dL_dx = 0, dL_ds = 0;
        srgb_to_linear_backward(x, 0.7, dL_ds);
        test::check_gradient([&] { return 0.7 * srgb_to_linear(x); }, {&x, 1}, {&dL_ds, 1});
        double given_linear = 0.1;
        srgb_to_linear_backward(x, srgb_to_linear(x), 0.7, given_linear);
        CHECK(given_linear == doctest::Approx(0.1 + dL_ds).epsilon(1e-13));
        linear_to_srgb_backward(x, 0.7, dL_dx);
        test::check_gradient([&] { return 0.7 * linear_to_srgb(x); }, {&x, 1}, {&dL_dx, 1});
        const double once = dL_dx;
        linear_to_srgb_backward(x, 0.7, dL_dx);
        CHECK(dL_dx == 2 * once);
    }
}

TEST_CASE("composite_rgba8 is c α + background (1 - α), exact at both ends") {
    cpu::Serial backend;
    for (const auto& [h, w] : {std::pair{1, 1}, {5, 7}, {33, 21}}) {
        auto bytes = random_bytes(std::size_t(4 * h * w), 4);
        bytes[3] = 0;
        if (h > 1) bytes[7] = 255;
        const vec3<double> background(0.1, 1, 0.7);
        Image<double> color(3, h, w), alpha(1, h, w), picture(3, h, w), over(3, h, w);
        composite_rgba8(backend, bytes, h, w, background, color.view(), alpha.view());
        for (int c = 0; c < 3; ++c)
            for (int i = 0; i < h * w; ++i) {
                const double a = bytes[std::size_t(4 * i + 3)] / 255.0, v = bytes[std::size_t(4 * i + c)] / 255.0;
                CHECK(color.at(c, 0, i) == doctest::Approx(v * a + background[c] * (1 - a)).epsilon(1e-14));
                CHECK(alpha.data[std::size_t(i)] == a);
                picture.at(c, 0, i) = background[c];
            }
        for (int c = 0; c < 3; ++c) {
            CHECK(color.at(c, 0, 0) == background[c]);
            if (h > 1) CHECK(color.at(c, 0, 1) == bytes[std::size_t(4 + c)] / 255.0);
        }
        composite_rgba8(backend, bytes, h, w, std::as_const(picture).view(), over.view());
        CHECK(over.data == color.data);
    }
}

TEST_CASE("composite_rgba8 of a box has the bits of the whole picture with alpha 0 outside") {
    const int h = 31, w = 27;
    cpu::Threads backend(2);
    for (const PixelBox& box : {PixelBox{4, 7, 11, 9}, {0, 0, w, 5}, {20, 0, 7, h}, {3, 3, 0, 0}, {0, 0, w, h}}) {
        std::vector<std::uint8_t> whole = random_bytes(std::size_t(4 * h * w), 8), part;
        for (int y = 0; y < h; ++y)
            for (int x = 0; x < w; ++x) {
                std::uint8_t* pixel = whole.data() + 4 * (y * w + x);
                if (box.contains(x, y)) part.insert(part.end(), pixel, pixel + 4);
                else pixel[3] = 0;
            }
        Image<float> behind(3, h, w), color[2], alpha[2];
        for (std::size_t i = 0; i < behind.data.size(); ++i) behind.data[i] = float(i % 97) / 97;
        for (const bool plain : {true, false}) {
            for (const int cropped : {0, 1}) {
                color[cropped] = Image<float>(3, h, w), alpha[cropped] = Image<float>(1, h, w);
                const Span<const std::uint8_t> bytes = cropped ? part : whole;
                const std::optional<PixelBox> of = cropped ? std::optional(box) : std::nullopt;
                if (plain)
                    composite_rgba8(backend, bytes, h, w, {0.3f, 1, 0.7f}, color[cropped].view(), alpha[cropped].view(),
                                    of);
                else
                    composite_rgba8(backend, bytes, h, w, std::as_const(behind).view(), color[cropped].view(),
                                    alpha[cropped].view(), of);
            }
            CHECK(color[0].data == color[1].data);
            CHECK(alpha[0].data == alpha[1].data);
        }
        CHECK_THROWS_AS(composite_rgba8(backend, part, h, w, {1, 1, 1}, color[0].view(), {}, PixelBox{0, 0, w, h - 1}),
                        ShapeError);
        CHECK_THROWS_AS(composite_rgba8(backend, part, h, w, {1, 1, 1}, color[0].view(), {}, PixelBox{1, 0, w, h}),
                        ValueError);
    }
}

TEST_CASE("composite_rgba8: Threads equals Serial, float follows, shapes are checked, empty is fine") {
    const int h = 61, w = 47;
    const auto bytes = random_bytes(std::size_t(4 * h * w), 5);
    cpu::Serial serial;
    Image<float> expected(3, h, w), color(3, h, w), alpha(1, h, w);
    composite_rgba8(serial, bytes, h, w, {1, 1, 1}, expected.view());
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        composite_rgba8(backend, bytes, h, w, {1, 1, 1}, color.view(), alpha.view());
        CHECK(color.data == expected.data);
    }
    CHECK_THROWS_AS(composite_rgba8(serial, bytes, h, w + 1, {1, 1, 1}, color.view()), ShapeError);
    CHECK_THROWS_AS(composite_rgba8(serial, bytes, h, w, {1, 1, 1}, alpha.view()), ShapeError);
    CHECK_THROWS_AS(composite_rgba8(serial, bytes, h, w, {1, 1, 1}, color.view(), color.view()), ShapeError);
    CHECK_THROWS_AS(composite_rgba8(serial, bytes, h, w, std::as_const(alpha).view(), color.view()), ShapeError);
    const Span<const std::uint8_t> two = Span<const std::uint8_t>(bytes).subspan(0, 8);
    CHECK_THROWS_AS(composite_rgba8(serial, two, h, w, {1, 1, 1}, color.view()), ShapeError);
    CHECK_THROWS_AS(composite_rgba8(serial, bytes, -1, w, {1, 1, 1}, color.view()), ValueError);
    Image<float> none(3, 0, 0);
    CHECK_NOTHROW(composite_rgba8(serial, {}, 0, 0, {1, 1, 1}, none.view()));
}

TEST_CASE_TEMPLATE("a register of colours follows its lanes", S, float, double) {
    using P = Wide<S>;
    constexpr std::size_t width = LaneTraits<P>::width;
    const double tolerance = sizeof(S) == 4 ? 2e-6 : 1e-13; // registers have their own exp and log
    for (double start = -0.02; start < 1.1; start += 0.01 * double(width)) {
        S in[width], out[4][width];
        for (std::size_t i = 0; i < width; ++i) in[i] = S(start + 0.01 * double(i));
        const P x = P::load(in);
        P slopes[2] = {P(S(0)), P(S(0))};
        srgb_to_linear_backward(x, P(S(0.7)), slopes[0]);
        linear_to_srgb_backward(x, P(S(0.7)), slopes[1]);
        srgb_to_linear(x).store(out[0]);
        linear_to_srgb(x).store(out[1]);
        slopes[0].store(out[2]);
        slopes[1].store(out[3]);
        for (std::size_t i = 0; i < width; ++i) {
            S expected[2] = {};
            srgb_to_linear_backward(in[i], S(0.7), expected[0]);
            linear_to_srgb_backward(in[i], S(0.7), expected[1]);
            CHECK(out[0][i] == doctest::Approx(srgb_to_linear(in[i])).epsilon(tolerance));
            CHECK(out[1][i] == doctest::Approx(linear_to_srgb(in[i])).epsilon(tolerance));
            CHECK(out[2][i] == doctest::Approx(expected[0]).epsilon(tolerance));
            CHECK(out[3][i] == doctest::Approx(expected[1]).epsilon(tolerance));
        }
    }
}
