// SPDX-License-Identifier: Apache-2.0
/// @file  Blend shapes on the GPU.
#include <gsh/backend/serial.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/body/cuda/blend_shapes.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace gsh::blend_shapes_on_device {
namespace {

using cuda::Device;

/// A mesh's directions, and inputs of both passes.
struct Inputs {
    std::size_t V, C;
    std::vector<vec3<double>> directions, offsets, dL_doffsets;
    std::vector<double> coefficients;

    Inputs(std::size_t vertices, std::size_t count, std::uint64_t seed) : V(vertices), C(count) {
        test::Rng rng(seed);
        directions = rng.vecs(V * C), offsets = rng.vecs(V), dL_doffsets = rng.vecs(V);
        coefficients = rng.numbers(C);
        for (std::size_t k = 0; k < C; k += 3) coefficients[k] = 0;
    }
};

/// Offsets, then the gradient of the coefficients, which starts as ones.
template <class T, class B>
std::vector<T> run(B& backend, const Inputs& inputs, int backwards = 1) {
    const BlendShapes<B, T> shapes(backend, inputs.V, {inputs.directions});
    const auto upload = [&]<class U>(const std::vector<U>& host) {
        typename B::template Buffer<U> buffer(host.size());
        backend.upload(Span<const U>(host), Span<U>(buffer));
        return buffer;
    };
    const auto vectors = [](const std::vector<vec3<double>>& from) {
        std::vector<vec3<T>> to;
        for (const auto& v : from) to.push_back(vec3<T>(v));
        return to;
    };
    const auto coefficients = upload(std::vector<T>(inputs.coefficients.begin(), inputs.coefficients.end()));
    const auto dL_doffsets = upload(vectors(inputs.dL_doffsets));
    auto offsets = upload(vectors(inputs.offsets));
    auto dL_dcoefficients = upload(std::vector<T>(shapes.coefficient_count(), T(1)));
    typename BlendShapes<B, T>::Workspace workspace;
    shapes.forward(coefficients, offsets);
    for (int i = 0; i < backwards; ++i) shapes.backward(dL_doffsets, dL_dcoefficients, workspace);

    std::vector<T> result(3 * inputs.V + shapes.coefficient_count());
    const Span<T> all(result);
    backend.download(view_as<const T>(Span<const vec3<T>>(offsets)), all.subspan(0, 3 * inputs.V));
    backend.download(Span<const T>(dL_dcoefficients), all.subspan(3 * inputs.V, result.size() - 3 * inputs.V));
    return result;
}

} // namespace

TEST_CASE("BlendShapes follows the CPU's, forward and backward") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t V : {1, 21, 22, 255, 256, 257, 700})
        for (const std::size_t C : {0, 1, 7, 31, 32, 33, 65}) {
            CAPTURE(V);
            CAPTURE(C);
            const Inputs inputs(V, C, 1);
            const auto expected = run<double>(serial, inputs);
            CHECK(test::relative_distance(run<double>(device, inputs), expected) < 1e-13);
            CHECK(test::relative_distance(run<float>(device, inputs), expected) < 1e-6);
        }
}

TEST_CASE("BlendShapes sums over more chunks of a mesh than a warp has lanes") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t V : {4096, 4097, 8193}) { // 32 chunks in double, 33 in double, 33 in float
        CAPTURE(V);
        const Inputs inputs(V, 3, 6);
        const auto expected = run<double>(serial, inputs);
        const auto check = [&]<class T>(const std::vector<T>& found, double tolerance) {
            // Offsets are far more numbers than coefficients.
            CHECK(test::largest_distance(found, expected, {3 * V, 3}) < tolerance);
        };
        check(run<double>(device, inputs), 1e-13);
        check(run<float>(device, inputs), 1e-6);
    }
}

TEST_CASE("BlendShapes::backward is the gradient of forward") {
    if (test::skip_without_device()) return;
    Device device;
    Inputs inputs(50, 9, 2);
    const auto result = run<double>(device, inputs);
    std::vector<double> gradient(result.begin() + 150, result.end());
    for (double& g : gradient) g -= 1; // where it started
    const auto loss = [&] {
        auto offsets = run<double>(device, inputs, 0);
        offsets.resize(150); // without the gradient
        return test::inner(offsets, test::numbers<double>(inputs.dL_doffsets));
    };
    test::check_gradient(loss, inputs.coefficients, gradient);
}

TEST_CASE("nothing times nothing is nothing") {
    if (test::skip_without_device()) return;
    Device device;
    CHECK(run<float>(device, Inputs(0, 0, 1)).empty());
    CHECK(run<float>(device, Inputs(2, 0, 1)).size() == 6);
}

TEST_CASE("BlendShapes adds, and does not read the directions of zeros") {
    if (test::skip_without_device()) return;
    Device device;
    Inputs inputs(40, 12, 3);
    const auto once = run<double>(device, inputs), twice = run<double>(device, inputs, 2);
    for (std::size_t k = 120; k < once.size(); ++k) CHECK(twice[k] - 1 == doctest::Approx(2 * (once[k] - 1)));
    for (std::size_t v = 0; v < inputs.V; ++v)
        inputs.directions[v * inputs.C + 3] = vec3<double>(std::numeric_limits<double>::quiet_NaN());
    const auto offsets = run<double>(device, inputs, 0);
    CHECK(std::equal(once.begin(), once.begin() + 120, offsets.begin()));
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("BlendShapes has the same bits in any order of blocks and threads") {
    auto& machine = test::CudaEmulation::instance();
    const Inputs inputs(400, 40, 4);
    const auto once = [&](test::Order order, unsigned char fill) {
        machine.order = order, machine.fill = fill;
        Device device;
        return run<float>(device, inputs);
    };
    const auto expected = once(test::Order::forward, 0xA5);
    CHECK(once(test::Order::reverse, 0xA5) == expected);
    CHECK(once(test::Order::random, 0xFF) == expected);
    machine.order = test::Order::forward, machine.fill = 0xA5;
}

TEST_CASE("a repeated pass of BlendShapes allocates nothing and does not wait") {
    const auto& machine = test::CudaEmulation::instance();
    Device device;
    const Inputs inputs(400, 40, 5);
    const BlendShapes<Device, float> shapes(device, inputs.V, {inputs.directions});
    Device::Buffer<float> coefficients(inputs.C), dL_dcoefficients(inputs.C);
    Device::Buffer<vec3<float>> offsets(inputs.V);
    device.fill(Span<float>(coefficients), 1.0f);
    device.fill(Span<vec3<float>>(offsets), vec3<float>(0));
    device.fill(Span<float>(dL_dcoefficients), 0.0f);
    BlendShapes<Device, float>::Workspace workspace;
    std::uint64_t allocations = 0, waits = 0;
    for (int step = 0; step < 3; ++step) {
        if (step == 1) allocations = machine.allocations, waits = machine.waits;
        shapes.forward(coefficients, offsets);
        shapes.backward(offsets, dL_dcoefficients, workspace);
    }
    CHECK(machine.allocations == allocations);
    CHECK(machine.waits == waits);
}
#endif

} // namespace gsh::blend_shapes_on_device
