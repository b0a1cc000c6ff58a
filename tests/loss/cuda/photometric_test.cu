// SPDX-License-Identifier: Apache-2.0
/// @file  The photometric loss on the GPU.
#include <gsh/backend/serial.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/composite_picture.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/loss/cuda/photometric.cuh>
#include <gsh/loss/photometric.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace gsh::photometric_on_device {
namespace {

using cuda::Device;

struct Size {
    int channels, height, width;
};
constexpr Size sizes[] = {{1, 1, 1},   {2, 3, 4},   {1, 1, 33},  {1, 31, 32}, {1, 32, 33}, {1, 33, 31},
                          {1, 16, 65}, {2, 17, 29}, {3, 33, 47}, {1, 64, 64}, {1, 65, 70}};

Image<double> random_image(Size size, std::uint64_t seed) {
    Image<double> image(size.channels, size.height, size.width);
    image.data = test::Rng(seed).numbers(image.data.size(), 0, 1);
    return image;
}

/// A white render and a photograph that differs from it in a disc, as in training.
std::pair<Image<double>, Image<double>> person_on_white(int height, int width, double radius) {
    Image<double> a(3, height, width, 1.0), b = a;
    test::Rng rng(3);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const double u = rng.uniform(), v = rng.uniform(), shade = 0.5 + 0.3 * std::sin(0.3 * x + 0.2 * y + c);
                if (std::hypot(x - 0.55 * width, y - 0.45 * height) > radius) continue;
                b.at(c, y, x) = shade + 0.1 * v;
                a.at(c, y, x) = shade + 0.1 * u;
            }
    return {a, b};
}

template <class T>
Image<T> as(const Image<double>& image) {
    Image<T> other(image.channels, image.height, image.width);
    std::transform(image.data.begin(), image.data.end(), other.data.begin(), [](double x) { return T(x); });
    return other;
}

template <class T>
struct Result {
    PhotometricValues values;
    std::vector<T> gradient;
};

/// The loss and its gradient, added `backwards` times to an image of `start`.
template <class T, class B>
Result<T> run(B& backend, const PhotometricParams<T>& params, const Image<T>& a, const Image<T>& b, T dL_dloss = 1,
              int backwards = 1, T start = 0, PhotometricCache<B, T> cache = {}) {
    typename B::template Buffer<T> render(a.data.size()), truth(a.data.size()), dL_drender(a.data.size());
    backend.upload(Span<const T>(a.data), Span<T>(render));
    backend.upload(Span<const T>(b.data), Span<T>(truth));
    backend.fill(Span<T>(dL_drender), start);
    const auto view = [&]<class U>(Span<U> data) { return ImageView<U>{data, a.channels, a.height, a.width}; };
    const PhotometricLoss<B, T> loss(backend, params);
    loss.forward(view(Span<const T>(render)), view(Span<const T>(truth)), cache);
    Result<T> result{loss.values(cache), std::vector<T>(a.data.size())};
    for (int i = 0; i < backwards; ++i)
        loss.backward(view(Span<const T>(render)), view(Span<const T>(truth)), dL_dloss, cache,
                      view(Span<T>(dL_drender)));
    backend.download(Span<const T>(dL_drender), Span<T>(result.gradient));
    return result;
}

} // namespace

TEST_CASE("PhotometricLoss in double follows the CPU's, forward and backward") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const Size size : sizes)
        for (const double weight : {0.0, 0.2, 1.0}) {
            INFO("size " << size.channels << " x " << size.height << " x " << size.width << ", weight " << weight);
            const auto a = random_image(size, 1), b = random_image(size, 2);
            const PhotometricParams<double> params{.ssim_weight = weight};
            const auto found = run(device, params, a, b, 0.7), expected = run(serial, params, a, b, 0.7);
            CHECK(found.values.loss == doctest::Approx(expected.values.loss).epsilon(1e-12));
            CHECK(found.values.l1 == doctest::Approx(expected.values.l1).epsilon(1e-12));
            if (weight > 0) CHECK(found.values.ssim == doctest::Approx(expected.values.ssim).epsilon(1e-12));
            CHECK(std::isnan(found.values.ssim) == (weight == 0));
            CHECK(test::relative_distance(found.gradient, expected.gradient) < 1e-11);
        }
}

TEST_CASE("PhotometricLoss::backward is the gradient of forward") {
    if (test::skip_without_device()) return;
    Device device;
    auto [a, b] = person_on_white(41, 70, 14);
    for (std::size_t i = 0; i < a.data.size(); ++i) // away from the kink of |x|
        if (a.data[i] != b.data[i] && std::abs(a.data[i] - b.data[i]) < 0.02) a.data[i] += 0.05;
    const double scale = double(a.data.size());
    const auto result = run(device, {}, a, b, scale);
    const auto value = [&] { return scale * run(device, {}, a, b, 1.0, 0).values.loss; };
    std::vector<std::size_t> elements;
    for (std::size_t i = 0; i < a.data.size(); i += 293)
        if (a.data[i] != b.data[i]) elements.push_back(i);
    test::check_gradient(value, a.data, result.gradient, {.elements = elements});
}

TEST_CASE("PhotometricLoss in float follows double") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const auto& [a, b] :
         {person_on_white(90, 75, 30), {random_image({3, 40, 70}, 1), random_image({3, 40, 70}, 2)}}) {
        const double count = double(a.data.size());
        const auto found = run<float>(device, {}, as<float>(a), as<float>(b), float(count));
        const auto expected = run<double>(serial, {}, a, b, count);
        CHECK(found.values.loss == doctest::Approx(expected.values.loss).epsilon(1e-6));
        CHECK(found.values.ssim == doctest::Approx(expected.values.ssim).epsilon(1e-6));
        CHECK(test::relative_distance(found.gradient, expected.gradient) < 1e-4);
    }
    for (const Size size : sizes) { // of tiles, too, which are larger than in double
        INFO("size " << size.channels << " x " << size.height << " x " << size.width);
        const auto a = as<float>(random_image(size, 1)), b = as<float>(random_image(size, 2));
        const auto found = run<float>(device, {}, a, b, 0.7f), expected = run<float>(serial, {}, a, b, 0.7f);
        CHECK(found.values.loss == doctest::Approx(expected.values.loss).epsilon(1e-6));
        CHECK(found.values.l1 == doctest::Approx(expected.values.l1).epsilon(1e-6));
        CHECK(found.values.ssim == doctest::Approx(expected.values.ssim).epsilon(1e-6));
        CHECK(test::relative_distance(found.gradient, expected.gradient) < 1e-4);
    }
}

TEST_CASE_TEMPLATE("leaving out equal tiles changes no bit, nor does a cache of another picture", T, float, double) {
    if (test::skip_without_device()) return;
    Device device;
    for (const double radius : {-1.0, 3.0, 21.0}) {
        CAPTURE(radius);
        const auto [a, b] = person_on_white(70, 100, radius);
        const auto without = run<T>(device, {.skip_equal = false}, as<T>(a), as<T>(b), T(1), 1, T(0.5));
        PhotometricCache<Device, T> stale;
        const auto busy = as<T>(random_image({3, 70, 100}, 1)), other = as<T>(random_image({3, 70, 100}, 2));
        Device::Buffer<T> first(busy.data.size()), second(busy.data.size());
        device.upload(Span<const T>(busy.data), Span<T>(first));
        device.upload(Span<const T>(other.data), Span<T>(second));
        PhotometricLoss<Device, T>(device).forward({first, 3, 70, 100}, {second, 3, 70, 100}, stale);
        const auto with = run<T>(device, {.skip_equal = true}, as<T>(a), as<T>(b), T(1), 1, T(0.5), std::move(stale));
        CHECK(with.values.loss == without.values.loss);
        CHECK(with.values.l1 == without.values.l1);
        CHECK(with.values.ssim == without.values.ssim);
        CHECK(with.gradient == without.gradient);
        if (radius < 0) CHECK(with.values.ssim == 1);
    }
}

TEST_CASE_TEMPLATE("a photograph that is composited where it is read is compared like the written one", T, float,
                   double) {
    if (test::skip_without_device()) return;
    Device device;
    const int height = 70, width = 83;
    const auto plate = as<T>(random_image({3, height, width}, 5));
    for (const PixelBox& box : {PixelBox{0, 0, width, height}, {9, 5, 60, 33}, {3, 3, 0, 0}})
        for (const bool plain : {true, false}) {
            CAPTURE(plain);
            test::Rng rng(6);
            std::vector<std::uint8_t> bytes;
            for (std::size_t i = 0; i < 4 * box.size(); ++i)
                bytes.push_back(static_cast<std::uint8_t>(i % 8 == 3 ? 255 : 256 * rng.uniform()));
            Device::Buffer<std::uint8_t> rgba(bytes.size());
            Device::Buffer<T> of_plate(plate.data.size()), written(plate.data.size()), alpha(plate.data.size() / 3);
            device.upload(Span<const std::uint8_t>(bytes), Span<std::uint8_t>(rgba));
            device.upload(Span<const T>(plate.data), Span<T>(of_plate));
            CompositePicture<T> picture{
                .rgba = rgba, .box = box, .color = {0.2, 0.5, 0.9}, .height = height, .width = width};
            const ImageView<T> color{written, 3, height, width}, mask{alpha, 1, height, width};
            if (plain) {
                composite_rgba8(device, rgba, height, width, picture.color, color, mask, box);
            } else {
                picture.image = {of_plate, 3, height, width};
                composite_rgba8(device, rgba, height, width, picture.image, color, mask, box);
            }
            Device::Buffer<T> render(plate.data.size());
            const auto rendered = as<T>(random_image({3, height, width}, 7));
            device.upload(Span<const T>(rendered.data), Span<T>(render));
            const auto compare = [&](const auto& truth) {
                const PhotometricLoss<Device, T> loss(device);
                PhotometricCache<Device, T> cache;
                const std::size_t size = alpha.size() * std::size_t(truth.channels);
                Device::Buffer<T> gradient(size);
                const ImageView<const T> seen{Span<const T>(render).subspan(0, size), truth.channels, height, width};
                const ImageView<T> dL_dseen{gradient, truth.channels, height, width};
                device.fill(Span<T>(gradient), T(0));
                loss.forward(seen, truth, cache);
                loss.backward(seen, truth, T(1), cache, dL_dseen);
                Result<T> result{loss.values(cache), std::vector<T>(size)};
                device.download(Span<const T>(gradient), Span<T>(result.gradient));
                return result;
            };
            // The compiler may fuse multiplications and sums of the two kernels in different ways.
            const double tolerance = 100 * double(std::numeric_limits<T>::epsilon());
            const auto check = [&](const Result<T>& found, const Result<T>& expected) {
                CHECK(found.values.loss == doctest::Approx(expected.values.loss).epsilon(tolerance));
                CHECK(test::relative_distance(found.gradient, expected.gradient) < tolerance);
            };
            check(compare(picture), compare(ImageView<const T>(color)));
            check(compare(picture.mask()), compare(ImageView<const T>(mask)));
        }
}

TEST_CASE("a second backward doubles, and a gradient of zero adds nothing") {
    if (test::skip_without_device()) return;
    Device device;
    const auto [a, b] = person_on_white(70, 80, 30);
    const auto once = run<float>(device, {}, as<float>(a), as<float>(b), 0.7f);
    const auto twice = run<float>(device, {}, as<float>(a), as<float>(b), 0.7f, 2);
    for (std::size_t i = 0; i < once.gradient.size(); ++i) REQUIRE(twice.gradient[i] == 2 * once.gradient[i]);
    CHECK(run<float>(device, {}, as<float>(a), as<float>(b), 0.0f, 1, 0.5f).gradient ==
          std::vector<float>(a.data.size(), 0.5f));
}

TEST_CASE("a NaN is seen, and an empty image is not an error") {
    if (test::skip_without_device()) return;
    Device device;
    Image<float> a(3, 50, 40, 1.0f), b = a;
    a.at(1, 20, 20) = std::numeric_limits<float>::quiet_NaN();
    CHECK(std::isnan(run<float>(device, {}, a, b).values.loss));
    const Image<float> none;
    CHECK(run<float>(device, {}, none, none).values.loss == 0);
    CHECK(run<float>(device, {}, b, b).values.loss == 0);
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE_TEMPLATE("the photometric loss has the same bits in any order of blocks and threads", T, float, double) {
    auto& machine = test::CudaEmulation::instance();
    const auto [a, b] = person_on_white(70, 80, 25);
    const auto once = [&](test::Order order, unsigned char fill) {
        machine.order = order, machine.fill = fill;
        Device device;
        return run<T>(device, {}, as<T>(a), as<T>(b));
    };
    const auto expected = once(test::Order::forward, 0xA5);
    for (const auto& [order, fill] : {std::pair{test::Order::reverse, 0xA5}, {test::Order::random, 0xFF}}) {
        const auto found = once(order, static_cast<unsigned char>(fill));
        CHECK(found.values.loss == expected.values.loss);
        CHECK(found.gradient == expected.gradient);
    }
    machine.order = test::Order::forward, machine.fill = 0xA5;
}

TEST_CASE("a repeated step allocates nothing and does not wait") {
    const auto& machine = test::CudaEmulation::instance();
    Device device;
    Device::Buffer<float> render(3 * 40 * 50), truth(3 * 40 * 50), dL_drender(3 * 40 * 50);
    for (auto* image : {&render, &truth, &dL_drender}) device.fill(Span<float>(*image), 0.5f);
    const PhotometricLoss<Device, float> loss(device);
    PhotometricCache<Device, float> cache;
    std::uint64_t allocations = 0, waits = 0;
    for (int step = 0; step < 3; ++step) {
        if (step == 1) allocations = machine.allocations, waits = machine.waits;
        loss.forward({render, 3, 40, 50}, {truth, 3, 40, 50}, cache);
        loss.backward({render, 3, 40, 50}, {truth, 3, 40, 50}, 1.0f, cache, {dL_drender, 3, 40, 50});
    }
    CHECK(machine.allocations == allocations);
    CHECK(machine.waits == waits);
}
#endif

} // namespace gsh::photometric_on_device
