// SPDX-License-Identifier: Apache-2.0
#include <gsh/loss/metrics.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

Image<double> random_image(int channels, int height, int width, std::uint64_t seed) {
    Image<double> image(channels, height, width);
    image.data = test::Rng(seed).numbers(image.data.size(), 0, 1);
    return image;
}

/// The protocol, step by step: both images are padded by 5 pixels by reflection; SSIM in its textbook form is computed
/// at every pixel of the original from a window of the padded images; 5 pixels are cropped on all sides; the rest is
/// averaged.
double slow_ssim(const Image<double>& a, const Image<double>& b, const Image<std::uint8_t>* mask = nullptr) {
    const auto mirror = [](int i, int n) { return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i; };
    double weights[11], total = 0, sum = 0;
    for (int k = 0; k < 11; ++k) total += weights[k] = std::exp(-(k - 5) * (k - 5) / 4.5);
    int count = 0;
    for (int c = 0; c < a.channels; ++c)
        for (int y = 0; y < a.height; ++y)
            for (int x = 0; x < a.width; ++x) {
                double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
                for (int j = 0; j < 11; ++j)
                    for (int i = 0; i < 11; ++i) {
                        const double w = weights[j] * weights[i] / (total * total);
                        const int v = mirror(y + j - 5, a.height), u = mirror(x + i - 5, a.width);
                        const double p = a.at(c, v, u), q = b.at(c, v, u);
                        ma += w * p, mb += w * q, aa += w * p * p, bb += w * q * q, ab += w * p * q;
                    }
                const double value = (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
                                     ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
                if (y < 5 || y >= a.height - 5 || x < 5 || x >= a.width - 5) continue; // the crop
                if (mask && mask->at(0, y, x) == 0) continue;
                sum += value;
                ++count;
            }
    return sum / count;
}

} // namespace

TEST_CASE("psnr of known errors") {
    Image<double> a(3, 4, 5, 0.5), b(3, 4, 5, 0.4);
    CHECK(psnr(a.view(), b.view()) == doctest::Approx(20).epsilon(1e-12));
    CHECK(psnr(a.view(), a.view()) == std::numeric_limits<double>::infinity());
    Image<float> f(3, 4, 5, 0.4f);
    CHECK(psnr(f.view(), a.view()) == doctest::Approx(20).epsilon(1e-6)); // float against double
    a.at(1, 2, 3) = std::numeric_limits<double>::quiet_NaN();
    CHECK(std::isnan(psnr(a.view(), b.view())));
}

TEST_CASE("psnr inside a mask sees only the pixels above one half") {
    Image<double> a(3, 4, 5, 0.5), b = a;
    Image<float> mask(1, 4, 5);
    mask.at(0, 1, 2) = 1, mask.at(0, 3, 4) = 0.51f, mask.at(0, 0, 0) = 0.5f;
    for (int c = 0; c < 3; ++c) a.at(c, 1, 2) += 0.1, a.at(c, 3, 4) -= 0.1, a.at(c, 0, 0) = 9;
    CHECK(psnr(a.view(), b.view(), mask.view()) == doctest::Approx(20).epsilon(1e-12));
    CHECK_THROWS_AS((void)psnr(a.view(), b.view(), Image<float>(1, 4, 5).view()), ValueError);
    CHECK_THROWS_AS((void)psnr(a.view(), b.view(), Image<float>(3, 4, 5).view()), ShapeError);
    CHECK_THROWS_AS((void)psnr(a.view(), Image<double>(3, 5, 4).view(), mask.view()), ShapeError);
}

TEST_CASE("ssim follows the protocol of padding, window and crop") {
    for (const auto& [h, w] : {std::pair{11, 11}, {12, 17}, {31, 23}}) {
        const auto a = random_image(3, h, w, 1), b = random_image(3, h, w, 2);
        CHECK(std::abs(ssim(a.view(), b.view()) - slow_ssim(a, b)) < 1e-12);
        CHECK(ssim(a.view(), a.view()) == 1);
        auto near = a;
        for (double& x : near.data) x = 0.98 * x + 0.01;
        CHECK(std::abs(ssim(near.view(), a.view()) - slow_ssim(near, a)) < 1e-12);
        CHECK(ssim(near.view(), a.view()) > 0.99);
    }
    Image<float> fa(1, 20, 20, 0.25f), fb(1, 20, 20, 0.75f); // no variance, so only the luminance term remains
    CHECK(ssim(fa.view(), fb.view()) ==
          doctest::Approx((2 * 0.25 * 0.75 + 1e-4) / (0.25 * 0.25 + 0.75 * 0.75 + 1e-4)).epsilon(1e-12));
}

TEST_CASE("ssim inside a mask is the mean of its windows there") {
    const auto a = random_image(3, 23, 29, 1), b = random_image(3, 23, 29, 2);
    Image<std::uint8_t> mask(1, 23, 29);
    test::Rng rng(5);
    for (auto& m : mask.data) m = rng.uniform() < 0.2;
    CHECK(std::abs(ssim(a.view(), b.view(), std::as_const(mask).view()) - slow_ssim(a, b, &mask)) < 1e-12);
    CHECK(ssim(a.view(), a.view(), mask.view()) == 1);
    const Image<std::uint8_t> all(1, 23, 29, 1);
    CHECK(std::abs(ssim(a.view(), b.view(), all.view()) - ssim(a.view(), b.view())) < 1e-14);
    Image<std::uint8_t> border(1, 23, 29);
    for (int y = 0; y < 23; ++y)
        for (int x = 0; x < 29; ++x) border.at(0, y, x) = y < 5 || y >= 18 || x < 5 || x >= 24;
    CHECK_THROWS_AS((void)ssim(a.view(), b.view(), border.view()), ValueError);
    CHECK_THROWS_AS((void)ssim(a.view(), b.view(), Image<std::uint8_t>(1, 29, 23).view()), ShapeError);
}

TEST_CASE("a region's score counts its pixels, and none is no error") {
    Image<double> a(3, 20, 20, 0.5);
    const Image<double> b(3, 20, 20, 0.4);
    Image<std::uint8_t> mask(1, 20, 20);
    const RegionScore nothing = score_region(a.view(), b.view(), mask.view());
    CHECK(nothing.pixels == 0);
    CHECK(std::isnan(nothing.psnr));
    CHECK(std::isnan(nothing.ssim));
    mask.at(0, 4, 10) = 1; // too near to the border to have a window
    const RegionScore border = score_region(a.view(), b.view(), mask.view());
    CHECK(border.pixels == 1);
    CHECK(border.windows == 0);
    CHECK(border.psnr == doctest::Approx(20).epsilon(1e-9));
    CHECK(std::isnan(border.ssim));
    mask.at(0, 5, 14) = 1, mask.at(0, 14, 5) = 1;
    mask.at(0, 15, 5) = 1, mask.at(0, 5, 15) = 1, mask.at(0, 5, 4) = 1; // too near to the other borders
    const RegionScore some = score_region(a.view(), b.view(), mask.view());
    CHECK(some.pixels == 6);
    CHECK(some.windows == 2);
    CHECK(some.ssim == doctest::Approx(ssim(a.view(), b.view(), std::as_const(mask).view())));
    CHECK(score_region(a.view(), a.view(), mask.view()).psnr == std::numeric_limits<double>::infinity());
    a.at(2, 5, 14) = std::numeric_limits<double>::quiet_NaN();
    CHECK(std::isnan(score_region(a.view(), b.view(), mask.view()).psnr));
    CHECK_THROWS_AS((void)score_region(a.view(), b.view(), Image<float>(1, 20, 19).view()), ShapeError);
}

TEST_CASE("means leave out images that hardly show a region, and those without error") {
    constexpr double infinity = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
    const auto mean = [](std::vector<RegionScore> scores, std::size_t min_pixels = 50) {
        return mean_over_images(scores, min_pixels);
    };
    const RegionScore good{100, 100, 30, 0.9}, fair{50, 50, 20, 0.8}, small{49, 49, 1, 0.1}, equal{99, 99, infinity, 1};
    RegionMean m = mean({good, fair, small});
    CHECK(m.images == 2);
    CHECK(m.psnr == 25); // the mean is over decibels, with equal weight for each image
    CHECK(m.ssim == doctest::Approx(0.85));
    m = mean({good, equal});
    CHECK(m.images == 2);
    CHECK(m.equal == 1);
    CHECK(m.psnr == 30);
    CHECK(m.ssim == doctest::Approx(0.95));
    CHECK(mean({equal}).psnr == infinity);
    CHECK(mean({small}).images == 0);
    CHECK(std::isnan(mean({small}).psnr));
    CHECK(std::isnan(mean({}).ssim));
    CHECK(mean({small}, 49).psnr == 1);
    CHECK(mean({{}, good}, 0).psnr == 30); // an image without pixels has no score
    CHECK(std::isnan(mean({good, {100, 100, nan, nan}}).psnr));
    CHECK(std::isnan(mean({good, {100, 100, nan, nan}}).ssim));
    CHECK(mean({good, {100, 0, 20, nan}}).ssim == 0.9); // without a window, an image counts only for PSNR
}

TEST_CASE("metrics refuse what they cannot judge") {
    const Image<double> a(3, 12, 10), b(3, 12, 11), none;
    CHECK_THROWS_AS((void)ssim(a.view(), a.view()), ValueError);
    CHECK_THROWS_AS((void)ssim(a.view(), b.view()), ShapeError);
    CHECK_THROWS_AS((void)psnr(a.view(), b.view()), ShapeError);
    CHECK_THROWS_AS((void)psnr(none.view(), none.view()), ValueError);
    CHECK_THROWS_AS((void)ssim(none.view(), none.view()), ValueError);
}
