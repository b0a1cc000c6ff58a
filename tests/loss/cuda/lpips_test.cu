// SPDX-License-Identifier: Apache-2.0
/// @file  LPIPS on the GPU.
#include <gsh/backend/serial.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/loss/cuda/lpips.cuh>
#include <gsh/loss/lpips.hpp>

#include <doctest/doctest.h>

#include "loss/lpips_networks.hpp"
#include "support/cuda_device.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace gsh::lpips_on_device {
namespace {

using cuda::Device;

/// All kinds of steps, with channels that fill packs of 16 bytes and such that do not, fewer and more than a tile has.
LpipsNetwork small_network() {
    LpipsNetwork network{
        .name = "small",
        .steps = {{0, 66, 3, 2, 1, true}, {1, 0, 3, 2}, {2, 8, 3, 1, 1}, {3, 5, 3, 1, 2, true}, {4, 3, 2, 1, 0, true}}};
    return test::with_noise(std::move(network));
}

template <class T>
Image<T> noise_image(int height, int width, std::uint32_t seed) {
    Image<T> image(3, height, width);
    const auto numbers = test::noise(image.data.size(), seed, 0.5);
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

template <class B, class T>
LpipsFeatures<B, T> forward(B& backend, const Lpips<B, T>& lpips, const Image<T>& image) {
    typename B::template Buffer<T> pixels(image.data.size());
    backend.upload(Span<const T>(image.data), Span<T>(pixels));
    LpipsFeatures<B, T> features;
    lpips.forward({pixels, image.channels, image.height, image.width}, features);
    return features;
}
template <class B, class T>
double distance(B& backend, const LpipsNetwork& network, const Image<T>& a, const Image<T>& b,
                LpipsScaling scaling = LpipsScaling::correct) {
    const Lpips<B, T> lpips(backend, network, scaling);
    return lpips.distance(forward(backend, lpips, a), forward(backend, lpips, b));
}

} // namespace

TEST_CASE("the maps of LPIPS and the distance follow the CPU's") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    const LpipsNetwork network = small_network();
    for (const auto& [h, w] : {std::pair{9, 9}, {10, 13}, {33, 31}})
        for (const LpipsScaling scaling : {LpipsScaling::correct, LpipsScaling::table}) {
            CAPTURE(h);
            const auto a = noise_image<double>(h, w, 1), b = noise_image<double>(h, w, 2);
            const double expected = distance(serial, network, a, b, scaling);
            CHECK(std::abs(distance(device, network, a, b, scaling) / expected - 1) < 1e-12);
            const auto fa = noise_image<float>(h, w, 1), fb = noise_image<float>(h, w, 2);
            CHECK(std::abs(distance(device, network, fa, fb, scaling) / expected - 1) < 1e-6);

            const auto found = forward(device, Lpips<Device, double>(device, network, scaling), a);
            const auto host = forward(serial, Lpips<cpu::Serial, double>(serial, network, scaling), a);
            for (std::size_t k = 0; k < host.maps.size(); ++k) {
                std::vector<double> values = downloaded(device, Span<const double>(found.maps[k].values));
                REQUIRE(values.size() == host.maps[k].values.size());
                double worst = 0;
                for (std::size_t i = 0; i < values.size(); ++i)
                    worst = std::max(worst, std::abs(values[i] - host.maps[k].values[i]));
                CHECK(worst < 1e-12);
            }
        }
}

TEST_CASE("AlexNet agrees with the reference code on noise") {
    if (test::skip_without_device()) return;
    Device device;
    // Reference value: lpips 0.1.4 on PyTorch 2.15 in double, with the same noise as weights, eval(), images 48 x 64.
    const auto a = noise_image<float>(48, 64, 1000), b = like(a, 2000);
    CHECK(std::abs(distance(device, test::with_noise(lpips_alexnet()), a, b) / 0.084295572434 - 1) < 2e-6);
}

TEST_CASE("an image is at distance 0 from itself, and as far from another as that from it") {
    if (test::skip_without_device()) return;
    Device device;
    const Lpips<Device> lpips(device, small_network());
    const auto a = noise_image<float>(33, 45, 1), b = like(a, 2);
    const auto fa = forward(device, lpips, a), fb = forward(device, lpips, b);
    CHECK(lpips.distance(fa, fa) == 0);
    CHECK(lpips.distance(fa, forward(device, lpips, a)) == 0);
    CHECK(lpips.distance(fa, fb) > 0);
    CHECK(lpips.distance(fa, fb) == lpips.distance(fb, fa));
}

TEST_CASE("LPIPS refuses an image that holds a NaN or an infinity") {
    if (test::skip_without_device()) return;
    Device device;
    const Lpips<Device> lpips(device, small_network());
    const auto image = noise_image<float>(9, 9, 1);
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
        Image<float> damaged = image;
        damaged.at(1, 8, 8) = bad;
        CHECK_THROWS_AS(forward(device, lpips, damaged), ValueError);
    }
    CHECK_NOTHROW(forward(device, lpips, image));
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("LPIPS has the same bits in any order of blocks and threads") {
    auto& machine = test::CudaEmulation::instance();
    const auto a = noise_image<float>(33, 45, 1), b = like(a, 2);
    const auto once = [&](test::Order order, unsigned char fill) {
        machine.order = order, machine.fill = fill;
        Device device;
        return distance(device, small_network(), a, b);
    };
    const double expected = once(test::Order::forward, 0xA5);
    CHECK(once(test::Order::reverse, 0xA5) == expected);
    CHECK(once(test::Order::random, 0xFF) == expected);
    machine.order = test::Order::forward, machine.fill = 0xA5;
}
#endif

} // namespace gsh::lpips_on_device
