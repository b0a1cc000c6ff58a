// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer on a GPU: what does not change its bits, what it refuses, and recorded steps.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/render/cuda/rasterizer.cuh>

#include <doctest/doctest.h>

#include "render/cuda/raster_device.hpp"
#include "support/contains.hpp"
#include "support/cuda_device.hpp"
#include "support/raster_scene.hpp"
#include "support/reference_rasterizer.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

using namespace gsh;

namespace {

using cpu::Serial;
using cuda::Device;
namespace raster = test::raster;
using test::RasterScene;

} // namespace

TEST_CASE_TEMPLATE("A second backward pass doubles all gradients", T, float, double) {
    if (test::skip_without_device()) return;
    test::Rng rng(5);
    const auto scene = test::make_scene(rng, 300, 60, 45, 0.03).template cast<T>();
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = raster::random_image(rng, scene.camera);
    Device device;
    const auto once = raster::run(device, scene, weights, background);
    auto twice = raster::run(device, scene, weights, background, {}, {.backward_passes = 2});
    const auto halve = [](auto& values) {
        T* const numbers = reinterpret_cast<T*>(values.data());
        for (std::size_t i = 0; i < values.size() * sizeof(values[0]) / sizeof(T); ++i) numbers[i] /= 2;
    };
    halve(twice.gradient.means), halve(twice.gradient.covariances);
    halve(twice.gradient.opacities), halve(twice.gradient.colors);
    halve(twice.camera), halve(twice.background), halve(twice.background_image.data);
    CHECK(raster::same_bits(once, twice));
}

TEST_CASE("Finite but absurd Gaussians draw nothing and break nothing") {
    if (test::skip_without_device()) return;
    test::Rng rng(6);
    auto scene = test::make_scene(rng, 10, 40, 30, 0.05).cast<float>();
    const float huge = 1e38f;
    scene.means[0] = vec3<float>(huge, -huge, 1);
    scene.means[1] = vec3<float>(0, 0, huge);
    scene.covariances[2] = {huge, huge, huge, huge, huge, huge};
    scene.covariances[3] = {-1, 0, 0, -1, 0, -1}; // not a covariance
    scene.covariances[4] = {0, 0, 0, 0, 0, 0};    // a point, so only the dilation remains
    scene.opacities[5] = -3;
    scene.opacities[6] = huge;
    scene.colors[7] = vec3<float>(-1, 2, 0);
    scene.covariances[8] = {1e6f, 0, 0, 1e6f, 0, 1e6f};
    scene.means[9] = vec3<float>(1e6f, 0, 1); // far beside the image
    Device device;
    const auto found =
        raster::run(device, scene, test::random_weights(rng, scene.camera), raster::random_image(rng, scene.camera));
    for (const float v : found.images.color.data) CHECK(std::isfinite(v));
    for (const float v : found.gradient.opacities) CHECK(std::isfinite(v));
    Serial serial;
    const auto expected =
        raster::run(serial, scene, test::random_weights(rng, scene.camera), raster::random_image(rng, scene.camera));
    CHECK(found.visible == expected.visible);
}

TEST_CASE_TEMPLATE("A needle that passes by all tiles draws nothing, wherever the camera has been before", T, float,
                   double) {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    constexpr int size = 300;
    auto scene = test::make_scene(rng, 20, size, size, 0.05);
    scene.camera.R = mat3<double>(1), scene.camera.t = vec3<double>(0, 0, 2);
    // Diagonal, beyond a corner of the image: its rectangle meets more than 8x8 tiles, and its ellipse none.
    const double s = 1 / std::sqrt(2.0);
    mat3<double> axes(0);
    axes[0] = vec3<double>(s, -s, 0) * 3.0, axes[1] = vec3<double>(s, s, 0) * 1e-3, axes[2].z = 1e-3;
    scene.add(vec3<double>(1.2, 1.2, 0), gram(axes), 0.9, vec3<double>(1, 0, 0));
    const auto cast = scene.cast<T>();
    const std::size_t needle = scene.size() - 1;

    Device device;
    raster::Memory<Device, T> memory(device, cast, test::random_weights(rng, cast.camera),
                                     raster::random_image(rng, cast.camera));
    const Rasterizer<Device, T> rasterizer(device, {});
    using Cache = typename Rasterizer<Device, T>::Cache;
    struct Drawing {
        std::vector<T> color;
        std::vector<vec3<T>> dL_dcolors;
        std::uint8_t visible;
    };
    const auto draw = [&](Cache& cache, const Camera<T>& camera) {
        const SplatView<const T> splats = memory.splats.view();
        fill_zero(device, memory.gradient.view());
        rasterizer.forward(camera, splats, {}, memory.target({}), cache);
        rasterizer.backward(camera, splats, {}, memory.weights({}), cache, memory.gradient.view());
        return Drawing{raster::from_backend(device, memory.color), raster::from_backend(device, memory.gradient.colors),
                       raster::from_backend(device, cache.visible)[needle]};
    };
    Cache fresh, used;
    const Drawing expected = draw(fresh, cast.camera);
    CHECK(expected.visible == 0);
    for (const double nearer : {0.4, 0.8, 1.2}) {
        Camera<T> near = cast.camera;
        near.t.x -= T(nearer), near.t.y -= T(nearer);
        CHECK(draw(used, near).visible == 1);
        const Drawing again = draw(used, cast.camera);
        CHECK(raster::same_bits(again.color, expected.color));
        CHECK(raster::same_bits(again.dL_dcolors, expected.dL_dcolors));
    }
}

TEST_CASE("A pixel whose transmittance falls to 1/2 between two segments of a list has a median depth") {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    Device device;
    cpu::Serial serial;
    // Between the second and the third: the product in front of the third is the first that is a product of products.
    constexpr std::size_t in_front = 2 * cuda::blended_at_once;
    std::size_t between = 0;
    for (int scene_number = 0; scene_number < 4; ++scene_number) {
        RasterScene<double> scene;
        scene.camera = test::make_camera(16, 16);
        scene.camera.R = mat3<double>(1), scene.camera.t = vec3<double>(0, 0, 2);
        // Wide splats of many opacities: at each pixel, the product over two segments is 1/2, but for roundings.
        std::vector<double> logs(in_front + 80); // of 1 - alpha
        for (double& log : logs) log = std::log1p(-rng.uniform(2e-4, 1e-3));
        const double sum = std::accumulate(logs.begin(), logs.begin() + in_front, 0.0);
        for (std::size_t i = 0; i < logs.size(); ++i)
            scene.add(vec3<double>(0, 0, 1e-3 * double(i)), test::ball(500.0),
                      -std::expm1(logs[i] * std::log(0.5) / sum), vec3<double>(1, 0.5, 0));
        const auto cast = scene.cast<float>();
        RasterParams<float> params;
        params.alpha_min = 1e-5f;
        test::Rendering<float> weights(cast.camera); // of the median alone
        for (Image<float>* image : {&weights.color, &weights.alpha, &weights.expected_depth})
            std::fill(image->data.begin(), image->data.end(), 0.0f);
        std::fill(weights.median_depth.data.begin(), weights.median_depth.data.end(), 1.0f);
        const auto background = raster::random_image(rng, cast.camera);
        const auto found = raster::run(device, cast, weights, background, params);
        const auto expected = raster::run(serial, cast, weights, background, params);
        for (std::size_t i = 0; i < found.images.median_depth.data.size(); ++i) {
            const float median = found.images.median_depth.data[i], of_serial = expected.images.median_depth.data[i];
            CHECK(std::abs(median - of_serial) < 0.01f); // ten splats
            between += std::abs((double(median) - 2) / 1e-3 - double(in_front)) < 2;
        }
        // Each pixel passes its gradient to one splat.
        double passed = 0;
        for (const vec3<float>& g : found.gradient.means) passed += double(g.z);
        CHECK(std::abs(passed - 256) < 1e-3);
    }
    CHECK(between > 100); // the pixels are those that the case is about
}

TEST_CASE("Gaussians that are not finite and too many pairs are refused, and the picture is left as it was") {
    if (test::skip_without_device()) return;
    test::Rng rng(7);
    const auto good = test::make_scene(rng, 300, 40, 30, 0.05);
    Device device;
    using R = Rasterizer<Device, double>;
    const auto message = [&](const RasterScene<double>& scene, const RasterParams<double>& params = {}) {
        R::Cache cache;
        raster::Memory<Device, double> m(device, scene, test::random_weights(rng, scene.camera),
                                         raster::random_image(rng, scene.camera));
        const SplatView<const double> splats = m.splats.view();
        std::string text = "nothing thrown";
        try {
            R(device, params).forward(scene.camera, splats, m.behind(scene, {}), m.target({}), cache);
        } catch (const ValueError& error) {
            text = error.what();
        }
        for (const double v : raster::from_backend(device, m.color)) CHECK(v == -1);
        return text;
    };
    const double bad[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()};
    for (const double value : bad)
        for (int member = 0; member < 4; ++member) {
            auto scene = good;
            for (const std::size_t i : {140, 142, 290}) {
                if (member == 0) scene.means[i].y = value;
                if (member == 1) scene.covariances[i].yz = value;
                if (member == 2) scene.opacities[i] = value;
                if (member == 3) scene.colors[i].z = value;
            }
            CHECK(message(scene) ==
                  test::contains("Gaussian 140 has a mean, covariance, opacity or color that is not finite (3 "
                                 "such"));
        }
    RasterParams<double> few;
    few.max_pairs = 3;
    CHECK(message(good, few) == test::contains("tiles in all, expected at most 3"));
}

TEST_CASE("In a recorded step the host does not wait, and what cannot be drawn halts the device") {
    if (test::skip_without_device()) return;
    test::Rng rng(8);
    const auto scene = test::make_scene(rng, 300, 60, 45, 0.02).cast<float>();
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = raster::random_image(rng, scene.camera);
    Device device;
    using R = Rasterizer<Device, float>;
    const R rasterizer(device);
    R::Cache cache;
    raster::Memory<Device, float> m(device, scene, weights, background);
    const raster::Options options{.camera = true};
    const auto step = [&] {
        const SplatView<const float> splats = m.splats.view();
        fill_zero(device, m.gradient.view());
        rasterizer.forward(scene.camera, splats, m.behind(scene, options), m.target(options), cache);
        rasterizer.backward(scene.camera, splats, m.behind(scene, options), m.weights(options), cache,
                            m.gradient.view(), Span<CameraGradient<float>>(m.camera), m.dL_dbehind(options));
    };
    const auto halted = [&] {
        std::uint32_t word = 0;
        device.download(Span<const std::uint32_t>(device.halted()), Span<std::uint32_t>(&word, 1));
        return word != 0;
    };
    const auto results = [&] {
        std::vector<float> all = raster::from_backend(device, m.color);
        const auto means = raster::from_backend(device, m.gradient.means);
        const float* const numbers = reinterpret_cast<const float*>(means.data());
        all.insert(all.end(), numbers, numbers + 3 * means.size());
        return all;
    };
    const auto upload = [&](const RasterScene<float>& changed) {
        device.upload(Span<const vec3<float>>(changed.means), Span<vec3<float>>(m.splats.means));
        device.upload(Span<const sym3<float>>(changed.covariances), Span<sym3<float>>(m.splats.covariances));
    };
    const auto message = [&] {
        try {
            rasterizer.check(cache);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("nothing thrown");
    };

    step(); // the buffers grow
    const auto expected = results();
    cuda::StepGraph graph(device);
    graph.run(step);
#if defined(GSH_CUDA_EMULATION)
    const auto waits = test::CudaEmulation::instance().waits, allocations = test::CudaEmulation::instance().allocations;
#endif
    for (int i = 0; i < 2; ++i) graph.run(step);
#if defined(GSH_CUDA_EMULATION)
    CHECK(test::CudaEmulation::instance().waits == waits);
    CHECK(test::CudaEmulation::instance().allocations == allocations);
#endif
    CHECK(raster::same_bits(results(), expected));
    CHECK(graph.counts().captures == 1);
    CHECK(graph.counts().launches == 3);
    CHECK_FALSE(halted());
    CHECK_NOTHROW(rasterizer.check(cache));
    CHECK_FALSE(cache.visible.empty());

    auto larger = scene;
    for (auto& c : larger.covariances) c.xx *= 100, c.yy *= 100, c.zz *= 100;
    upload(larger);
    const auto capacity = cache.scratch.capacity();
    graph.run(step);
    CHECK(halted());
    CHECK(message() == test::contains("the buffers of the recorded step hold " + std::to_string(capacity)));
    CHECK(cache.scratch.capacity() == capacity);
    CHECK(graph.counts().captures == 1);
    for (const auto& v : raster::from_backend(device, m.gradient.means)) CHECK(v == vec3<float>(0)); // nothing is added

    auto broken = scene;
    broken.means[17].x = std::numeric_limits<float>::quiet_NaN();
    upload(broken);
    device.resume();
    graph.run(step);
    CHECK(halted());
    CHECK(message() == test::contains("Gaussian 17 has"));

    upload(scene);
    device.resume();
    graph.run(step);
    CHECK_FALSE(halted());
    CHECK(raster::same_bits(results(), expected));

    upload(larger); // outside of a recorded step the buffers grow, then the recorded step holds them
    graph.run(step);
    CHECK(halted());
    step();
    CHECK(message() == test::contains("the device has halted in an earlier pass"));
    device.resume();
    const auto of_larger = results();
    graph.run(step);
    CHECK_FALSE(halted());
    CHECK(raster::same_bits(results(), of_larger));

    R::Cache fresh;
    const auto first = [&] {
        const SplatView<const float> splats = m.splats.view();
        rasterizer.forward(scene.camera, splats, m.behind(scene, options), m.target(options), fresh);
    };
    cuda::StepGraph(device).run(first); // there are no buffers yet
    CHECK(halted());
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("Scratch that got too little memory for one of its buffers holds what the smallest of them does") {
    auto& machine = test::CudaEmulation::instance();
    Device device;
    RasterScratch<Device, float> scratch;
    scratch.reserve(1000);
    CHECK(scratch.capacity() == 1250);
    const std::size_t limit = machine.memory_limit;
    machine.memory_limit = limit - machine.free_memory() + 1'100'000; // enough for the keys alone
    CHECK_THROWS_AS(scratch.reserve(100'000), DeviceError);
    machine.memory_limit = limit;
    CHECK(scratch.keys.size() == 125'000);
    CHECK(scratch.capacity() == 0);
    scratch.reserve(2000);
    CHECK(scratch.capacity() == 2500);
    CHECK(scratch.instances.size() == 2500);
}

TEST_CASE("The bits depend neither on the order of threads and blocks nor on memory that nobody has written") {
    test::Rng rng(9);
    auto& machine = test::CudaEmulation::instance();
    for (const std::size_t count : {200u, 2600u}) { // long lists have segments
        auto scene = test::make_scene(rng, count, 50, 33, count > 2000 ? 0.3 : 0.03).cast<float>();
        for (std::size_t i = 0; i < count; i += 3) scene.means[i] = scene.means[0]; // equal depths
        const auto weights = test::random_weights(rng, scene.camera);
        const auto background = raster::random_image(rng, scene.camera);
        Device device;
        const auto expected = raster::run(device, scene, weights, background);
        for (const auto order : {test::Order::reverse, test::Order::random})
            for (const unsigned char fill : {0x00, 0xFF}) {
                machine.order = order, machine.fill = fill, machine.seed = fill + 3u;
                CHECK(raster::same_bits(raster::run(device, scene, weights, background), expected));
            }
        machine.order = test::Order::forward, machine.fill = 0xA5;
    }
}
#endif
