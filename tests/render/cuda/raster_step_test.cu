// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer on a GPU: what does not change its bits, what it refuses, and recorded steps.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/render/cuda/rasterizer.cuh>

#include <doctest/doctest.h>

#include "render/cuda/raster_device.hpp"
#include "support/cuda_device.hpp"
#include "support/raster_scene.hpp"
#include "support/reference_rasterizer.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

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
            CHECK(message(scene).find("Gaussian 140 has a mean, covariance, opacity or color that is not finite (3 "
                                      "such") != std::string::npos);
        }
    RasterParams<double> few;
    few.max_pairs = 3;
    CHECK(message(good, few).find("tiles in all, expected at most 3") != std::string::npos);
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
    CHECK(message().find("the buffers of the recorded step hold " + std::to_string(capacity)) != std::string::npos);
    CHECK(cache.scratch.capacity() == capacity);
    CHECK(graph.counts().captures == 1);
    for (const auto& v : raster::from_backend(device, m.gradient.means)) CHECK(v == vec3<float>(0)); // nothing is added

    auto broken = scene;
    broken.means[17].x = std::numeric_limits<float>::quiet_NaN();
    upload(broken);
    device.resume();
    graph.run(step);
    CHECK(halted());
    CHECK(message().find("Gaussian 17 has") != std::string::npos);

    upload(scene);
    device.resume();
    graph.run(step);
    CHECK_FALSE(halted());
    CHECK(raster::same_bits(results(), expected));

    upload(larger); // outside of a recorded step the buffers grow, then the recorded step holds them
    step();
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
