// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/loss/lpips.hpp>

#include "loss/lpips_networks.hpp"
#include "support/gradient.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::noise;

namespace {

/// Three channels to two by a 1 x 1 convolution without scaling, small enough to compute by hand.
LpipsNetwork by_hand() {
    return {.name = "by hand",
            .steps = {{0, 2, 1, 1, 0, true}},
            .convolutions = {{{1, 0, 0, /**/ 0, 1, -1}, {0.5f, 0}}},
            .lins = {{2, 1}},
            .shift = {0, 0, 0},
            .scale = {1, 1, 1}};
}

/// All kinds of steps: strided and padded convolutions, a pooling with a remainder, a step that is not compared.
LpipsNetwork small_network() {
    LpipsNetwork network{.name = "small",
                         .steps = {{0, 4, 3, 2, 1, true}, {1, 0, 3, 2}, {2, 5, 3, 1, 1}, {3, 3, 2, 1, 0, true}}};
    return test::with_noise(std::move(network));
}

using Maps = std::vector<std::vector<double>>; // [channel][pixel]

/// LPIPS from its definition, with plain loops in double.
double slow_lpips(const LpipsNetwork& network, const Image<double>& a, const Image<double>& b, LpipsScaling scaling) {
    const auto at = [](const Maps& maps, std::size_t c, int y, int x, int h, int w) {
        return y < 0 || x < 0 || y >= h || x >= w ? 0 : maps[c][std::size_t(y * w + x)];
    };
    std::vector<Maps> compared[2];
    for (int which = 0; which < 2; ++which) {
        const Image<double>& image = which == 0 ? a : b;
        int h = image.height, w = image.width;
        Maps maps(3);
        for (std::size_t c = 0; c < 3; ++c)
            for (int y = 0; y < h; ++y)
                for (int x = 0; x < w; ++x) {
                    const double v = image.at(int(c), y, x), fed = scaling == LpipsScaling::correct ? 2 * v - 1 : v;
                    maps[c].push_back((fed - double(network.shift[c])) / double(network.scale[c]));
                }
        std::size_t convolution = 0;
        for (const LpipsStep& s : network.steps) {
            const int H = (h + 2 * s.padding - s.kernel) / s.stride + 1;
            const int W = (w + 2 * s.padding - s.kernel) / s.stride + 1;
            Maps out(s.channels > 0 ? std::size_t(s.channels) : maps.size());
            for (std::size_t o = 0; o < out.size(); ++o)
                for (int y = 0; y < H; ++y)
                    for (int x = 0; x < W; ++x) {
                        double value = s.channels > 0 ? double(network.convolutions[convolution].bias[o]) : -1e300;
                        for (std::size_t i = s.channels > 0 ? 0 : o; i < (s.channels > 0 ? maps.size() : o + 1); ++i)
                            for (int j = 0; j < s.kernel; ++j)
                                for (int k = 0; k < s.kernel; ++k) {
                                    const double v = at(maps, i, y * s.stride - s.padding + j,
                                                        x * s.stride - s.padding + k, h, w);
                                    const auto window = std::size_t(s.kernel * s.kernel);
                                    const auto place = (o * maps.size() + i) * window + std::size_t(j * s.kernel + k);
                                    value = s.channels > 0
                                                ? value + v * double(network.convolutions[convolution].weight[place])
                                                : std::max(value, v);
                                }
                        out[o].push_back(s.channels > 0 ? std::max(value, 0.0) : value);
                    }
            convolution += s.channels > 0;
            maps = out, h = H, w = W;
            if (s.compared) compared[which].push_back(maps);
        }
    }
    double distance = 0;
    for (std::size_t l = 0; l < compared[0].size(); ++l) {
        const Maps &p = compared[0][l], &q = compared[1][l];
        for (std::size_t i = 0; i < p[0].size(); ++i) {
            double pp = 0, qq = 0;
            for (std::size_t c = 0; c < p.size(); ++c) pp += p[c][i] * p[c][i], qq += q[c][i] * q[c][i];
            for (std::size_t c = 0; c < p.size(); ++c) {
                const double d = p[c][i] / (std::sqrt(pp) + 1e-10) - q[c][i] / (std::sqrt(qq) + 1e-10);
                distance += double(network.lins[l][c]) * d * d / double(p[0].size());
            }
        }
    }
    return distance;
}

template <class T>
Image<T> noise_image(int height, int width, std::uint32_t seed) {
    Image<T> image(3, height, width);
    const auto numbers = noise(image.data.size(), seed, 0.5);
    for (std::size_t i = 0; i < numbers.size(); ++i) image.data[i] = T(numbers[i]) + T(0.5);
    return image;
}
/// Three quarters of one noise, a quarter of another.
template <class T>
Image<T> like(const Image<T>& image, std::uint32_t seed) {
    Image<T> other = noise_image<T>(image.height, image.width, seed);
    for (std::size_t i = 0; i < other.data.size(); ++i)
        other.data[i] = T(0.75) * image.data[i] + T(0.25) * other.data[i];
    return other;
}

template <class T>
double distance(const LpipsNetwork& network, const Image<T>& a, const Image<T>& b,
                LpipsScaling scaling = LpipsScaling::correct) {
    cpu::Serial backend;
    return Lpips<cpu::Serial, T>(backend, network, scaling).distance(a.view(), b.view());
}

} // namespace

TEST_CASE("one pixel through one convolution, by hand") {
    Image<double> a(3, 1, 1), b(3, 1, 1);
    a.data = {2.5, 5, 1}; // features (3, 4), direction (0.6, 0.8)
    b.data = {-3, 2, 1};  // features (relu(-2.5), 1), direction (0, 1)
    CHECK(distance(by_hand(), a, b, LpipsScaling::table) == doctest::Approx(2 * 0.36 + 0.04).epsilon(1e-9));
    const Image<double> dark(3, 1, 1, -1); // features (0, 0) have no direction, and must not cause a division by zero
    CHECK(distance(by_hand(), a, dark, LpipsScaling::table) == doctest::Approx(2 * 0.36 + 0.64).epsilon(1e-9));
    CHECK(distance(by_hand(), dark, dark, LpipsScaling::table) == 0);

    // [0, 1] is stretched to [-1, 1]: 1.75 becomes 2.5, and so on.
    Image<double> a01 = a, b01 = b;
    for (std::size_t i = 0; i < 3; ++i) a01.data[i] = (a.data[i] + 1) / 2, b01.data[i] = (b.data[i] + 1) / 2;
    CHECK(distance(by_hand(), a01, b01) == doctest::Approx(0.76).epsilon(1e-9));

    LpipsNetwork shifted = by_hand(); // scales by (x - 1) / 2, so that 2 x + 1 gives the same
    shifted.shift = {1, 1, 1}, shifted.scale = {2, 2, 2};
    for (std::size_t i = 0; i < 3; ++i) a.data[i] = 2 * a.data[i] + 1, b.data[i] = 2 * b.data[i] + 1;
    CHECK(distance(shifted, a, b, LpipsScaling::table) == doctest::Approx(0.76).epsilon(1e-9));
}

TEST_CASE("a small network agrees with plain loops") {
    const LpipsNetwork network = small_network();
    for (const auto& [h, w] : {std::pair{9, 9}, {10, 13}, {31, 22}, {40, 41}})
        for (const LpipsScaling scaling : {LpipsScaling::correct, LpipsScaling::table}) {
            CAPTURE(h);
            CAPTURE(w);
            const auto a = noise_image<double>(h, w, 1), b = noise_image<double>(h, w, 2);
            const double slow = slow_lpips(network, a, b, scaling);
            CHECK(slow > 0.01);
            CHECK(std::abs(distance(network, a, b, scaling) - slow) < 1e-13);
            const auto fa = noise_image<float>(h, w, 1), fb = noise_image<float>(h, w, 2);
            CHECK(std::abs(distance(network, fa, fb, scaling) - slow) < 1e-6 * slow);
        }
}

TEST_CASE("the networks agree with the reference code on noise") {
    // Reference values: lpips 0.1.4 on PyTorch 2.15 in double, with the same noise as weights, eval(), images 48 x 64.
    const auto a = noise_image<float>(48, 64, 1000), b = like(a, 2000);
    const auto check = [&](LpipsNetwork network, double table, double correct) {
        network = test::with_noise(std::move(network));
        CHECK(std::abs(distance(network, a, b, LpipsScaling::table) / table - 1) < 2e-6);
        CHECK(std::abs(distance(network, a, b) / correct - 1) < 2e-6);
    };
    SUBCASE("AlexNet") { check(lpips_alexnet(), 0.030992577564, 0.084295572434); }
    SUBCASE("VGG16") { check(lpips_vgg16(), 0.036692562604, 0.088444041247); }
}

TEST_CASE("an image is at distance 0 from itself, and as far from another as that from it") {
    const LpipsNetwork network = test::with_noise(lpips_alexnet());
    cpu::Serial backend;
    const Lpips<cpu::Serial> lpips(backend, network);
    const auto a = noise_image<float>(33, 45, 1), b = like(a, 2), c = like(a, 3);
    Lpips<cpu::Serial>::Features fa, fb, fc;
    lpips.forward(a.view(), fa);
    lpips.forward(b.view(), fb);
    CHECK(lpips.distance(fa, fa) == 0);
    CHECK(lpips.distance(a.view(), a.view()) == 0);
    CHECK(lpips.distance(fa, fb) > 0);
    CHECK(lpips.distance(fa, fb) == lpips.distance(fb, fa));
    CHECK(lpips.distance(fa, fb) == lpips.distance(a.view(), b.view()));
    lpips.forward(c.view(), fc);
    const double once = lpips.distance(fa, fc);
    lpips.forward(b.view(), fc); // the features may be reused, also for another size
    CHECK(lpips.distance(fa, fc) == lpips.distance(fa, fb));
    lpips.forward(noise_image<float>(64, 31, 5).view(), fc);
    lpips.forward(c.view(), fc);
    CHECK(lpips.distance(fa, fc) == once);
    CHECK(lpips.protocol() == "AlexNet v0.1, images fed in [-1, 1]");
    CHECK(Lpips<cpu::Serial>(backend, network, LpipsScaling::table).protocol() ==
          "AlexNet v0.1, images fed in [0, 1]");
}

TEST_CASE("Threads give the bits of Serial") {
    const LpipsNetwork network = test::with_noise(lpips_alexnet());
    const auto a = noise_image<float>(70, 61, 1), b = like(a, 2);
    const double serial = distance(network, a, b);
    for (const std::size_t threads : {1, 2, 3}) {
        cpu::Threads backend(threads);
        CHECK(Lpips<cpu::Threads>(backend, network).distance(a.view(), b.view()) == serial);
    }
}

TEST_CASE("networks know the smallest image") {
    for (const LpipsNetwork& network : {lpips_alexnet(), lpips_vgg16(), small_network(), by_hand()}) {
        const int smallest = smallest_side(network);
        int side = smallest, short_of = smallest - 1;
        for (const LpipsStep& step : network.steps) {
            side = step.output(side);
            short_of = step.output(short_of);
        }
        CHECK(side == 1);
        CHECK(short_of == 0);
    }
    CHECK(smallest_side(lpips_alexnet()) == 31);
    CHECK(smallest_side(lpips_vgg16()) == 16);
}

TEST_CASE("what cannot be compared is refused") {
    cpu::Serial backend;
    const LpipsNetwork network = small_network();
    const Lpips<cpu::Serial> lpips(backend, network);
    const auto image = noise_image<float>(9, 9, 1);
    Lpips<cpu::Serial>::Features features, other, none;
    const auto forward = [&](const Image<float>& i) { lpips.forward(i.view(), features); };
    CHECK_THROWS_AS(forward(Image<float>(1, 9, 9)), ShapeError);
    CHECK_THROWS_AS(forward(Image<float>(4, 9, 9)), ShapeError);
    CHECK_THROWS_AS(forward(Image<float>(3, 6, 9)), ValueError);
    CHECK_THROWS_AS(forward(Image<float>(3, 9, 0)), ValueError);
    CHECK_THROWS_AS((void)lpips.distance(image.view(), noise_image<float>(9, 10, 1).view()), ShapeError);
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        Image<float> damaged = image;
        damaged.at(1, 8, 8) = bad;
        CHECK_THROWS_AS(forward(damaged), ValueError);
    }
    forward(image);
    CHECK_THROWS_AS((void)lpips.distance(features, none), ShapeError);
    lpips.forward(noise_image<float>(9, 10, 1).view(), other);
    CHECK_THROWS_AS((void)lpips.distance(features, other), ShapeError);
    LpipsNetwork wider = network;
    wider.steps.back().channels = 4;
    const Lpips<cpu::Serial> another(backend, test::with_noise(std::move(wider)));
    another.forward(image.view(), other);
    CHECK_THROWS_AS((void)lpips.distance(other, other), ShapeError);
}

TEST_CASE("a network that does not fit together is refused") {
    cpu::Serial backend;
    const auto construct = [&](auto&& change) {
        LpipsNetwork network = small_network();
        change(network);
        Lpips<cpu::Serial>(backend, network);
    };
    CHECK_NOTHROW(construct([](LpipsNetwork&) {}));
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions[1].weight.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions[1].bias.push_back(0); }), ShapeError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions.pop_back(); }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions.push_back({}); }), ShapeError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.lins.pop_back(); }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.lins.push_back({}); }), ShapeError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.lins[0].pop_back(); }), ShapeError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.lins[0][0] = std::nanf(""); }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions[0].weight[3] = INFINITY; }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.convolutions[0].bias[3] = std::nanf(""); }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.scale[1] = 0; }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.steps[1].stride = 0; }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n.steps[1].padding = 1; }), ValueError);
    CHECK_THROWS_AS(construct([](LpipsNetwork& n) { n = {}; }), ValueError);
    LpipsNetwork huge = small_network(); // finite numbers whose squares overflow
    for (float& w : huge.convolutions[0].weight) w = 3e38f;
    const auto a = noise_image<float>(9, 9, 1), b = noise_image<float>(9, 9, 2);
    CHECK_THROWS_AS((void)distance(huge, a, b), ValueError);
}
