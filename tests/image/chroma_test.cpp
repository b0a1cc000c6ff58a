// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/image/chroma.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

Image<double> noise(int height, int width, std::uint64_t seed) {
    Image<double> image(3, height, width);
    test::Rng rng(seed);
    for (double& number : image.data) number = rng.uniform(0, 1);
    return image;
}
double luma(const Image<double>& image, int y, int x) {
    return 0.299 * image.at(0, y, x) + 0.587 * image.at(1, y, x) + 0.114 * image.at(2, y, x);
}

} // namespace

TEST_CASE("brightness stays, and colours are means that are interpolated") {
    cpu::Serial backend;
    HalfChroma<cpu::Serial, double> half(backend);
    const Image<double> image = noise(8, 10, 3);
    Image<double> result(3, 8, 10);
    half.forward(image.view(), result.view());
    for (int y = 0; y < 8; ++y)
        for (int x = 0; x < 10; ++x) CHECK(luma(result, y, x) == doctest::Approx(luma(image, y, x)).epsilon(1e-12));

    // By hand for a pixel: 9/16, 3/16, 3/16, 1/16 of the four nearest means.
    const auto mean = [&](int hy, int hx) {
        double sum = 0;
        for (int dy = 0; dy < 2; ++dy)
            for (int dx = 0; dx < 2; ++dx)
                sum += image.at(0, 2 * hy + dy, 2 * hx + dx) - luma(image, 2 * hy + dy, 2 * hx + dx);
        return sum / 4;
    };
    const double expected = (9 * mean(1, 2) + 3 * mean(1, 3) + 3 * mean(0, 2) + mean(0, 3)) / 16;
    CHECK(result.at(0, 2, 5) - luma(image, 2, 5) == doctest::Approx(expected).epsilon(1e-12));
    CHECK(result.at(0, 0, 0) - luma(image, 0, 0) == doctest::Approx(mean(0, 0)).epsilon(1e-12)); // the corner: one mean

    Image<double> smooth(3, 12, 12), same(3, 12, 12); // a colour that changes linearly stays, off the border
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 12; ++y)
            for (int x = 0; x < 12; ++x) smooth.at(c, y, x) = 0.1 + 0.02 * (c + 1) * x - 0.01 * c * y;
    half.forward(smooth.view(), same.view());
    for (int c = 0; c < 3; ++c)
        for (int y = 1; y < 11; ++y)
            for (int x = 1; x < 11; ++x) CHECK(same.at(c, y, x) == doctest::Approx(smooth.at(c, y, x)).epsilon(1e-12));
    half.forward(smooth.view(), smooth.view()); // in place
    CHECK(smooth.data == same.data);
}

TEST_CASE("the adjoint of half chroma is its transpose, for even and odd sizes") {
    cpu::Serial backend;
    HalfChroma<cpu::Serial, double> half(backend);
    for (const auto& [height, width] : {std::pair{6, 8}, {7, 8}, {6, 9}, {7, 5}, {1, 1}, {1, 4}, {2, 3}}) {
        CAPTURE(height);
        CAPTURE(width);
        Image<double> image = noise(height, width, 5), weights = noise(height, width, 7);
        Image<double> result(3, height, width), gradient = weights;
        const auto value = [&] {
            half.forward(image.view(), result.view());
            double sum = 0;
            for (std::size_t i = 0; i < result.data.size(); ++i) sum += weights.data[i] * result.data[i];
            return sum;
        };
        half.backward(gradient.view());
        test::check_gradient(value, Span<double>(image.data), Span<const double>(gradient.data));
    }
}

TEST_CASE("images of other sizes are refused") {
    cpu::Serial backend;
    HalfChroma<cpu::Serial, double> half(backend);
    Image<double> image(3, 4, 4), other(3, 4, 5), gray(1, 4, 4);
    CHECK_THROWS_AS(half.forward(image.view(), other.view()), ShapeError);
    CHECK_THROWS_AS(half.backward(gray.view()), ShapeError);
}

TEST_CASE("photographs with colours of half resolution are recognised") {
    constexpr int height = 48, width = 50;
    cpu::Serial backend;
    HalfChroma<cpu::Serial, double> half(backend);
    Image<double> image = noise(height, width, 9), halved(3, height, width);
    for (double& number : image.data) number = 0.25 + 0.5 * number; // so that no colour leaves [0, 1]
    half.forward(image.view(), halved.view());
    const auto bytes = [&](const Image<double>& from, int hidden_columns) {
        std::vector<std::uint8_t> rgba;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                for (int c = 0; c < 3; ++c)
                    rgba.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(from.at(c, y, x), 0.0, 1.0))));
                rgba.push_back(x < hidden_columns ? 0 : 255);
            }
        return rgba;
    };
    CHECK(!has_half_chroma(bytes(image, 0), height, width));
    CHECK(has_half_chroma(bytes(halved, 0), height, width));
    Image<double> left = halved; // full resolution where alpha is 0 does not count
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < 20; ++x) left.at(c, y, x) = image.at(c, y, x);
    CHECK(!has_half_chroma(bytes(left, 0), height, width));
    CHECK(has_half_chroma(bytes(left, 22), height, width));
    CHECK(!has_half_chroma(std::vector<std::uint8_t>(4 * height * width, 128), height, width)); // nothing to see
    CHECK_THROWS_AS((void)has_half_chroma(bytes(image, 0), height, width + 1), ShapeError);
}
