// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/loss/photometric.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

struct Size {
    int channels, height, width;
};

Image<double> random_image(Size size, std::uint64_t seed, double low = 0, double high = 1) {
    Image<double> image(size.channels, size.height, size.width);
    image.data = test::Rng(seed).numbers(image.data.size(), low, high);
    return image;
}

/// A pair of images that differ by at least 0.02 everywhere, away from the kink of |x|.
std::pair<Image<double>, Image<double>> different_images(Size size, std::uint64_t seed) {
    auto a = random_image(size, seed), b = random_image(size, seed + 100);
    for (std::size_t i = 0; i < a.data.size(); ++i)
        if (std::abs(a.data[i] - b.data[i]) < 0.02) a.data[i] += 0.05;
    return {a, b};
}

/// A white render and a photograph that differs from it in a disc, as in training.
template <class T>
std::pair<Image<T>, Image<T>> person_on_white(int height, int width, double radius) {
    Image<T> a(3, height, width, T(1)), b = a;
    test::Rng rng(3);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const double u = rng.uniform(), v = rng.uniform(), shade = 0.5 + 0.3 * std::sin(0.3 * x + 0.2 * y + c);
                if (std::hypot(x - 0.55 * width, y - 0.45 * height) > radius) continue;
                b.at(c, y, x) = T(shade + 0.1 * v);
                a.at(c, y, x) = T(shade + 0.1 * u);
            }
    return {a, b};
}

/// 1 - mean SSIM in the textbook form, window by window, with zeros outside the image; without the windows of the
/// outermost `margin` pixels.
double slow_ssim_loss(const Image<double>& a, const Image<double>& b, int margin = 0) {
    double weights[11], total = 0, sum = 0;
    for (int k = 0; k < 11; ++k) total += weights[k] = std::exp(-(k - 5) * (k - 5) / 4.5);
    for (int c = 0; c < a.channels; ++c)
        for (int y = margin; y < a.height - margin; ++y)
            for (int x = margin; x < a.width - margin; ++x) {
                double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
                for (int j = std::max(y - 5, 0); j <= std::min(y + 5, a.height - 1); ++j)
                    for (int i = std::max(x - 5, 0); i <= std::min(x + 5, a.width - 1); ++i) {
                        const double w = weights[j - y + 5] * weights[i - x + 5] / (total * total);
                        const double p = a.at(c, j, i), q = b.at(c, j, i);
                        ma += w * p, mb += w * q, aa += w * p * p, bb += w * q * q, ab += w * p * q;
                    }
                sum += (2 * ma * mb + 1e-4) * (2 * (ab - ma * mb) + 9e-4) /
                       ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
            }
    return 1 - sum / (double(a.channels) * (a.height - 2 * margin) * (a.width - 2 * margin));
}

template <class T, class B>
struct Result {
    PhotometricValues values;
    Image<T> gradient;
};

template <class T, class B>
Result<T, B> run(B& backend, const PhotometricParams<T>& params, const Image<T>& a, const Image<T>& b, T dL_dloss = 1,
                 int backwards = 1) {
    PhotometricLoss<B, T> loss(backend, params);
    typename PhotometricLoss<B, T>::Cache cache;
    Result<T, B> result{{}, Image<T>(a.channels, a.height, a.width)};
    loss.forward(a.view(), b.view(), cache);
    result.values = loss.values(cache);
    for (int i = 0; i < backwards; ++i)
        loss.backward(a.view(), b.view(), dL_dloss, cache, result.gradient.view());
    return result;
}

constexpr Size sizes[] = {{1, 1, 1}, {2, 3, 4}, {1, 1, 13}, {1, 9, 7}, {1, 33, 65}, {3, 37, 29}, {1, 70, 131}};

} // namespace

TEST_CASE("SSIM agrees with the textbook's formula window by window") {
    cpu::Serial backend;
    for (const Size size : sizes) {
        const auto a = random_image(size, 1), b = random_image(size, 2);
        const auto values = run<double>(backend, {.ssim_weight = 1}, a, b).values;
        INFO("size " << size.channels << " x " << size.height << " x " << size.width);
        CHECK(std::abs(values.loss - slow_ssim_loss(a, b)) < 1e-12);
        CHECK(values.ssim == doctest::Approx(1 - values.loss).epsilon(1e-14));
    }
}

TEST_CASE("the loss brings the mean squared error, also where tiles without a difference are skipped") {
    cpu::Serial backend;
    for (const Size size : sizes) {
        const auto a = random_image(size, 1), b = random_image(size, 2);
        for (const double weight : {0.0, 0.2})
            CHECK(run<double>(backend, {.ssim_weight = weight}, a, b).values.mse ==
                  doctest::Approx(mean_squared_error(a.view(), b.view())).epsilon(1e-13));
    }
    const auto [a, b] = person_on_white<double>(75, 150, 12);
    CHECK(run<double>(backend, {}, a, b).values.mse ==
          doctest::Approx(mean_squared_error(a.view(), b.view())).epsilon(1e-13));
}

TEST_CASE("PhotometricLoss::backward is the gradient of forward") {
    cpu::Serial backend;
    for (const Size size : sizes)
        for (const double weight : {0.0, 0.2, 1.0}) {
            auto [a, b] = different_images(size, 7);
            const PhotometricParams<double> params{.ssim_weight = weight};
            // Makes the gradients of order one, so that the tolerance is strict.
            const double scale = double(a.data.size());
            const auto result = run<double>(backend, params, a, b, scale);

            PhotometricLoss<cpu::Serial, double> loss(backend, params);
            PhotometricLoss<cpu::Serial, double>::Cache cache;
            const auto value = [&] {
                loss.forward(a.view(), b.view(), cache);
                return scale * loss.values(cache).loss;
            };
            INFO("size " << size.channels << " x " << size.height << " x " << size.width << ", weight " << weight);
            const std::size_t stride = a.data.size() > 1000 ? 37 : 1;
            test::check_gradient(value, a.data, result.gradient.data,
                                 {.stride = stride});
        }
}

TEST_CASE("with whole_windows, those that reach beyond the border do not count") {
    cpu::Serial backend;
    const PhotometricParams<double> params{.ssim_weight = 1, .whole_windows = true};
    // The last one has tiles, of 64 x 32 pixels, in which no window is whole.
    for (const Size size : {Size{1, 11, 11}, Size{2, 12, 30}, Size{1, 43, 75}, Size{1, 40, 70}, Size{1, 74, 139},
                            Size{1, 35, 67}}) {
        auto [a, b] = different_images(size, 9);
        const double scale = double(a.data.size());
        const auto result = run<double>(backend, params, a, b, scale);
        CHECK(std::abs(result.values.loss - slow_ssim_loss(a, b, 5)) < 1e-12);
        PhotometricLoss<cpu::Serial, double> loss(backend, params);
        PhotometricLoss<cpu::Serial, double>::Cache cache;
        const auto value = [&] {
            loss.forward(a.view(), b.view(), cache);
            return scale * loss.values(cache).loss;
        };
        test::check_gradient(value, a.data, result.gradient.data, {.stride = a.data.size() > 1000 ? 37u : 1u});
    }
    const auto a = random_image({1, 10, 30}, 1);
    CHECK_THROWS_WITH_AS(run<double>(backend, params, a, a), doctest::Contains("11 x 11 pixels or more"), ValueError);
}

TEST_CASE("the gradient reaches as far as windows do, also out of equal regions") {
    cpu::Serial backend;
    auto [a, b] = person_on_white<double>(75, 150, 12);
    const double scale = double(a.data.size());
    const auto result = run<double>(backend, {.ssim_weight = 1}, a, b, scale);
    PhotometricLoss<cpu::Serial, double> loss(backend, {.ssim_weight = 1});
    PhotometricLoss<cpu::Serial, double>::Cache cache;
    const auto value = [&] {
        loss.forward(a.view(), b.view(), cache);
        return scale * loss.values(cache).loss;
    };
    test::check_gradient(value, a.data, result.gradient.data, {.stride = 61});
}

TEST_CASE_TEMPLATE("leaving out equal tiles changes no bit", T, float, double) {
    cpu::Threads backend(2);
    for (const double radius : {0.0, 3.0, 21.0, 60.0}) {
        const auto [a, b] = person_on_white<T>(139, 260, radius);
        const auto with = run<T>(backend, {.skip_equal = true}, a, b);
        const auto without = run<T>(backend, {.skip_equal = false}, a, b);
        CHECK(with.values.loss == without.values.loss);
        CHECK(with.values.l1 == without.values.l1);
        CHECK(with.values.ssim == without.values.ssim);
        CHECK(with.gradient.data == without.gradient.data);
    }
}

TEST_CASE("a stale cache of another picture leaves no trace") {
    cpu::Serial backend;
    PhotometricLoss<cpu::Serial, double> loss(backend);
    PhotometricLoss<cpu::Serial, double>::Cache cache;
    const auto busy_a = random_image({3, 139, 260}, 1), busy_b = random_image({3, 139, 260}, 2);
    loss.forward(busy_a.view(), busy_b.view(), cache);

    const auto [a, b] = person_on_white<double>(139, 260, 20);
    Image<double> gradient(3, 139, 260);
    loss.forward(a.view(), b.view(), cache);
    loss.backward(a.view(), b.view(), 1.0, cache, gradient.view());
    CHECK(gradient.data == run<double>(backend, {}, a, b).gradient.data);
}

TEST_CASE("equal images: loss 0, SSIM 1, no gradient; L1 and mix are what they say") {
    cpu::Serial backend;
    const auto a = random_image({3, 40, 70}, 1), b = random_image({3, 40, 70}, 2);
    const auto same = run<double>(backend, {}, a, a);
    CHECK(same.values.loss == 0);
    CHECK(same.values.ssim == 1);
    CHECK(std::all_of(same.gradient.data.begin(), same.gradient.data.end(), [](double g) { return g == 0; }));
    // Without the shortcut, d = 0 also gives exact zeros.
    const auto computed = run<double>(backend, {.skip_equal = false}, a, a);
    CHECK(computed.values.loss == 0);
    CHECK(computed.gradient.data == same.gradient.data);

    double l1 = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i) l1 += std::abs(a.data[i] - b.data[i]) / double(a.data.size());
    const auto mixed = run<double>(backend, {}, a, b).values;
    CHECK(mixed.l1 == doctest::Approx(l1).epsilon(1e-12));
    CHECK(mixed.loss == doctest::Approx(0.8 * l1 + 0.2 * (1 - mixed.ssim)).epsilon(1e-12));

    L1Loss<cpu::Serial, double> only_l1(backend);
    SsimLoss<cpu::Serial, double> only_ssim(backend);
    PhotometricCache<cpu::Serial, double> l1_cache, ssim_cache;
    only_l1.forward(a.view(), b.view(), l1_cache);
    only_ssim.forward(a.view(), b.view(), ssim_cache);
    CHECK(only_l1.values(l1_cache).loss == mixed.l1);
    CHECK(std::isnan(only_l1.values(l1_cache).ssim));
    CHECK(only_ssim.values(ssim_cache).ssim == mixed.ssim);
}

TEST_CASE("float follows double") {
    cpu::Serial backend;
    const auto [a, b] = person_on_white<double>(90, 110, 30);
    Image<float> fa(3, 90, 110), fb = fa;
    std::copy(a.data.begin(), a.data.end(), fa.data.begin());
    std::copy(b.data.begin(), b.data.end(), fb.data.begin());
    const double count = double(a.data.size());
    const auto exact = run<double>(backend, {}, a, b, count);
    const auto single = run<float>(backend, {}, fa, fb, float(count));
    CHECK(single.values.loss == doctest::Approx(exact.values.loss).epsilon(1e-5));
    double worst = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i)
        worst = std::max(worst, std::abs(double(single.gradient.data[i]) - exact.gradient.data[i]));
    CHECK(worst < 2e-3); // gradients here are about 1
}

TEST_CASE("a second backward doubles, and Threads equals Serial bit for bit") {
    cpu::Serial serial;
    const auto [a, b] = person_on_white<float>(139, 260, 60);
    const auto once = run<float>(serial, {}, a, b, 0.7f), twice = run<float>(serial, {}, a, b, 0.7f, 2);
    std::vector<float> doubled = once.gradient.data;
    for (float& g : doubled) g *= 2;
    CHECK(twice.gradient.data == doubled);
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        const auto result = run<float>(backend, {}, a, b, 0.7f);
        CHECK(result.values.loss == once.values.loss);
        CHECK(result.values.ssim == once.values.ssim);
        CHECK(result.gradient.data == once.gradient.data);
    }
}

TEST_CASE("a NaN is seen, an empty image is not an error, shapes are checked") {
    cpu::Serial backend;
    Image<double> a(3, 50, 40, 1.0), b = a;
    a.at(1, 20, 20) = std::numeric_limits<double>::quiet_NaN();
    CHECK(std::isnan(run<double>(backend, {}, a, b).values.loss));

    const Image<double> none;
    CHECK(run<double>(backend, {}, none, none).values.loss == 0);

    using Loss = PhotometricLoss<cpu::Serial, double>;
    Loss loss(backend);
    Loss::Cache cache;
    const Image<double> other(3, 50, 41);
    Image<double> gradient(3, 50, 40), wrong(1, 50, 40);
    CHECK_THROWS_AS((void)loss.values(cache), ShapeError);
    CHECK_THROWS_AS(loss.forward(b.view(), other.view(), cache), ShapeError);
    loss.forward(b.view(), b.view(), cache);
    CHECK_THROWS_AS(loss.backward(b.view(), b.view(), 1.0, cache, wrong.view()), ShapeError);
    CHECK_THROWS_AS(loss.backward(other.view(), b.view(), 1.0, cache, gradient.view()), ShapeError);
    CHECK_THROWS_AS(loss.backward(b.view(), other.view(), 1.0, cache, gradient.view()), ShapeError);
    CHECK_THROWS_AS((L1Loss<cpu::Serial, double>(backend).backward(b.view(), b.view(), 1.0, cache, gradient.view())),
                    ValueError);
    CHECK_THROWS_AS((Loss(backend, {.ssim_weight = 1.5})), ValueError);
}
