// SPDX-License-Identifier: Apache-2.0
/// @file  The MLP on the CUDA backend equals the one of cpu::Serial.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/serial.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/cuda/mlp.cuh>
#include <gsh/field/mlp.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/rounded_mlp.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace gsh::mlp_on_device {
namespace {

using cuda::Device;

struct Shape {
    int features, block, points, shared, outputs, width, hidden_layers;
};

template <class T>
Device::Buffer<T> to_device(Device& device, const std::vector<T>& host) {
    Device::Buffer<T> buffer(host.size());
    device.upload(Span<const T>(host), Span<T>(buffer));
    return buffer;
}
template <class T>
std::vector<T> fetch(Device& device, const Device::Buffer<T>& buffer) {
    return downloaded(device, Span<const T>(buffer));
}

template <class T>
struct Problem {
    Shape shape;
    std::size_t rows;
    Mlp mlp;
    std::vector<T> weights, features, points, shared, dL_doutputs;

    Problem(const Shape& s, std::size_t n)
        : shape(s), rows(n), mlp({s.features + s.points + s.shared, s.outputs, s.width, s.hidden_layers}),
          weights(mlp.initial_weights<T>(5)), features(numbers(1, s.features)), points(numbers(2, s.points)),
          shared(numbers(3, s.shared, 1)), dL_doutputs(numbers(4, s.outputs)) {}

private:
    [[nodiscard]] std::vector<T> numbers(std::uint64_t seed, int columns) const { return numbers(seed, columns, rows); }
    [[nodiscard]] static std::vector<T> numbers(std::uint64_t seed, int columns, std::size_t n) {
        test::Rng rng(seed);
        std::vector<T> result(n * static_cast<std::size_t>(columns));
        for (T& x : result) x = static_cast<T>(rng.uniform(-1, 1));
        return result;
    }
};

template <class T>
struct Results {
    std::vector<T> outputs, dL_dweights, dL_dfeatures, dL_dshared;
};

/// How backward is called.
struct Options {
    Write mode = Write::add;
    int backwards = 1;
    bool features = true, shared = true;
    unsigned most_blocks = 0; ///< of the device; 0: as many as usual
    Precision precision = Precision::fp32;
};

template <class T>
FeatureView<T> features_view(const Shape& s, std::size_t rows, Span<T> values) {
    return {values, rows, static_cast<std::size_t>(s.features), static_cast<std::size_t>(s.block)};
}

template <class T, class B, class Numbers>
void run_passes(B& backend, const Problem<T>& p, const Options& options, const Numbers& weights,
                const Numbers& features, const Numbers& points, const Numbers& shared, const Numbers& dL_doutputs,
                Numbers& outputs, Numbers& dL_dweights, Numbers& dL_dfeatures, Numbers& dL_dshared) {
    Mlp::Cache<B, T> cache;
    const MlpInputs<T> inputs{features_view(p.shape, p.rows, Span<const T>(features)), points, shared};
    p.mlp.forward(backend, weights, inputs, outputs, cache);
    const FeatureView<T> to_features =
        options.features ? features_view(p.shape, p.rows, Span<T>(dL_dfeatures)) : FeatureView<T>();
    const Span<T> to_shared = options.shared ? Span<T>(dL_dshared) : Span<T>();
    for (int i = 0; i < options.backwards; ++i) {
        if constexpr (std::is_same_v<B, Device>)
            if (options.most_blocks != 0) {
                cuda::detail::mlp_backward_in_blocks(backend, p.mlp, Span<const T>(weights), inputs,
                                                     Span<const T>(dL_doutputs), cache.scratch, Span<T>(dL_dweights),
                                                     to_features, options.mode, to_shared, options.most_blocks);
                continue;
            }
        p.mlp.backward(backend, weights, inputs, dL_doutputs, cache, dL_dweights, to_features, options.mode, to_shared);
    }
}

/// All gradients hold ones before.
template <class T>
Results<T> run_serial(const Problem<T>& p, const Options& options = {}) {
    cpu::Serial backend;
    Results<T> r{std::vector<T>(p.dL_doutputs.size()), std::vector<T>(p.weights.size(), T(1)),
                 std::vector<T>(p.features.size(), T(1)), std::vector<T>(p.shared.size(), T(1))};
    run_passes(backend, p, options, p.weights, p.features, p.points, p.shared, p.dL_doutputs, r.outputs, r.dL_dweights,
               r.dL_dfeatures, r.dL_dshared);
    return r;
}
template <class T>
Results<T> run_device(const Problem<T>& p, const Options& options = {}) {
    Device device;
    device.set_precision(options.precision);
    const auto weights = to_device(device, p.weights), features = to_device(device, p.features),
               points = to_device(device, p.points), shared = to_device(device, p.shared),
               dL_doutputs = to_device(device, p.dL_doutputs);
    const auto ones = [&](std::size_t n) { return to_device(device, std::vector<T>(n, T(1))); };
    Device::Buffer<T> outputs(p.dL_doutputs.size()), dL_dweights = ones(p.weights.size()),
                                                     dL_dfeatures = ones(p.features.size()),
                                                     dL_dshared = ones(p.shared.size());
    run_passes(device, p, options, weights, features, points, shared, dL_doutputs, outputs, dL_dweights, dL_dfeatures,
               dL_dshared);
    return {fetch(device, outputs), fetch(device, dL_dweights), fetch(device, dL_dfeatures), fetch(device, dL_dshared)};
}

/// tolerance: of float. An activation near 0 may be rounded to either side of it, which changes its gradient.
template <class T>
void check_close(const std::vector<T>& found, const std::vector<T>& expected, double tolerance) {
    CHECK(test::relative_distance(found, expected) <= (sizeof(T) == 8 ? 1e-13 : tolerance));
}
template <class T>
void check_equal(const Results<T>& found, const Results<T>& expected) {
    check_close(found.outputs, expected.outputs, 3e-6);
    check_close(found.dL_dweights, expected.dL_dweights, 1e-4);
    check_close(found.dL_dfeatures, expected.dL_dfeatures, 1e-4);
    check_close(found.dL_dshared, expected.dL_dshared, 1e-4);
}

} // namespace

TEST_CASE_TEMPLATE("Mlp on the device equals Serial for networks of any size", T, float, double) {
    if (test::skip_without_device()) return;
    for (const Shape& s : {Shape{64, 4, 9, 5, 30, 64, 2}, // an avatar's field
                           Shape{3, 1, 0, 0, 2, 0, 0}, Shape{4, 4, 0, 0, 1, 8, 1}, Shape{5, 5, 0, 2, 3, 7, 2},
                           Shape{16, 2, 3, 0, 9, 17, 3}, Shape{6, 3, 0, 40, 27, 33, 1}, Shape{8, 8, 1, 0, 17, 16, 5},
                           Shape{68, 4, 2, 3, 5, 9, 1},    // many features
                           Shape{66, 66, 0, 1, 67, 65, 2}, // wide layers
                           Shape{12, 4, 0, 70, 65, 20, 1}, Shape{70, 10, 1, 2, 66, 0, 0}}) {
        CAPTURE(s.features);
        CAPTURE(s.width);
        const Problem<T> p(s, 33);
        check_equal(run_device(p), run_serial(p));
    }
}

TEST_CASE_TEMPLATE("Mlp on the device takes any number of rows", T, float, double) {
    if (test::skip_without_device()) return;
    for (const std::size_t rows : {0, 1, 31, 32, 33, 63, 64, 65, 127, 128, 129}) {
        CAPTURE(rows);
        const Problem<T> p({8, 4, 1, 3, 5, 9, 1}, rows);
        check_equal(run_device(p), run_serial(p));
    }
}

TEST_CASE_TEMPLATE("gradients of many tiles are summed by few blocks", T, float, double) {
    if (test::skip_without_device()) return;
    const Problem<T> p({8, 4, 1, 3, 5, 9, 1}, 400);
    const auto expected = run_serial(p);
    for (const unsigned blocks : {1u, 3u}) check_equal(run_device(p, {.most_blocks = blocks}), expected);
}

TEST_CASE("Mlp::backward on the device is the gradient of forward") {
    if (test::skip_without_device()) return;
    Problem<double> p({6, 3, 2, 3, 4, 9, 2}, 35);
    Results<double> gradient = run_device(p);
    for (auto* values : {&gradient.dL_dweights, &gradient.dL_dfeatures, &gradient.dL_dshared})
        for (double& g : *values) g -= 1; // where they started
    const auto loss = [&] { return test::inner(run_device(p, {.backwards = 0}).outputs, p.dL_doutputs); };
    test::check_gradient(loss, p.weights, gradient.dL_dweights, {.stride = 7});
    test::check_gradient(loss, p.features, gradient.dL_dfeatures, {.stride = 11});
    test::check_gradient(loss, p.shared, gradient.dL_dshared);
}

TEST_CASE("Mlp::backward adds on the device, and Write::assign overwrites the inputs' gradient alone") {
    if (test::skip_without_device()) return;
    for (const int block : {4, 2}) {
        const Problem<double> p({8, block, 1, 3, 5, 9, 1}, 70);
        for (const Write mode : {Write::add, Write::assign})
            check_equal(run_device(p, {mode, 2}), run_serial(p, {mode, 2}));
        const auto none = run_device(p, {.features = false, .shared = false});
        check_equal(none, run_serial(p, {.features = false, .shared = false}));
        CHECK(none.dL_dfeatures == std::vector<double>(p.features.size(), 1.0));
        CHECK(none.dL_dshared == std::vector<double>(3, 1.0));
    }
}

TEST_CASE("Mlp takes features that do not begin at a multiple of four numbers") {
    if (test::skip_without_device()) return;
    const Problem<float> p({8, 4, 0, 0, 5, 20, 1}, 40);
    const auto expected = run_serial(p);
    Device device;
    const auto weights = to_device(device, p.weights), dL_doutputs = to_device(device, p.dL_doutputs);
    std::vector<float> shifted = p.features;
    shifted.insert(shifted.begin(), 0.0f);
    const auto features = to_device(device, shifted);
    Device::Buffer<float> outputs(p.dL_doutputs.size()), dL_dfeatures(shifted.size());
    auto dL_dweights = to_device(device, std::vector<float>(p.weights.size(), 1.0f));
    device.fill(Span<float>(dL_dfeatures), 1.0f);
    Mlp::Cache<Device, float> cache;
    const MlpInputs<float> inputs{features_view(p.shape, 40, Span<const float>(features).subspan(1, 320))};
    p.mlp.forward(device, weights, inputs, outputs, cache);
    p.mlp.backward(device, weights, inputs, dL_doutputs, cache, dL_dweights,
                   features_view(p.shape, 40, Span<float>(dL_dfeatures).subspan(1, 320)));
    auto found = fetch(device, dL_dfeatures);
    found.erase(found.begin());
    check_equal({fetch(device, outputs), fetch(device, dL_dweights), found, {}}, expected);
}

#if defined(GSH_CUDA_EMULATION)

TEST_CASE("Mlp has the same bits in any order of threads, whatever new memory holds") {
    auto& machine = test::CudaEmulation::instance();
    for (const Shape& s : {Shape{12, 4, 1, 3, 5, 9, 2}, Shape{4, 4, 0, 1, 3, 65, 1}}) {
        const Problem<float> p(s, 130);
        const auto expected = run_device(p, {.most_blocks = 1});
        for (const auto order : {test::Order::forward, test::Order::reverse, test::Order::random}) {
            machine.order = order, machine.fill = 0xFF;
            const auto found = run_device(p, {.most_blocks = 1});
            CHECK(found.outputs == expected.outputs);
            CHECK(found.dL_dweights == expected.dL_dweights);
            CHECK(found.dL_dfeatures == expected.dL_dfeatures);
            CHECK(found.dL_dshared == expected.dL_dshared);
        }
        machine.order = test::Order::forward, machine.fill = 0xA5;
    }
}

TEST_CASE("a repeated pass of Mlp does not wait and allocates nothing") {
    auto& machine = test::CudaEmulation::instance();
    Device device;
    const Mlp mlp({8, 3, 16, 2});
    const std::size_t rows = 200;
    Device::Buffer<float> weights(mlp.parameter_count()), features(rows * 6), shared(2), outputs(rows * 3);
    for (auto* buffer : {&weights, &features, &shared, &outputs}) device.fill(Span<float>(*buffer), 0.5f);
    Mlp::Cache<Device> cache;
    const FeatureView<float> view(features, rows, 6, 2);
    const auto pass = [&] {
        mlp.forward(device, weights, {view, {}, shared}, outputs, cache);
        mlp.backward(device, weights, {view, {}, shared}, outputs, cache, weights, view, Write::assign, shared);
    };
    pass();
    device.synchronize();
    const auto waits = machine.waits, allocations = machine.allocations, launches = machine.launches;
    pass();
    CHECK(machine.waits == waits);
    CHECK(machine.allocations == allocations);
    device.synchronize();
    CHECK(machine.launches == launches + 5);
}

#endif

namespace {

/// What mixed precision computes. All gradients hold ones before, and are added to.
Results<float> run_rounded(const Problem<float>& p) {
    const auto F = static_cast<std::size_t>(p.shape.features), P = static_cast<std::size_t>(p.shape.points);
    const auto features = features_view(p.shape, p.rows, Span<const float>(p.features));
    std::vector<double> inputs;
    for (std::size_t row = 0; row < p.rows; ++row) {
        for (std::size_t c = 0; c < F; ++c) inputs.push_back(double(features(row, c)));
        for (std::size_t c = 0; c < P; ++c) inputs.push_back(double(p.points[row * P + c]));
    }
    const test::RoundedMlp rounded(p.mlp, p.rows, p.weights, inputs, p.shared, p.dL_doutputs);
    const auto plus_one = [](const std::vector<double>& from) {
        std::vector<float> to;
        for (const double x : from) to.push_back(static_cast<float>(1 + x));
        return to;
    };
    Results<float> r{{rounded.outputs.begin(), rounded.outputs.end()},
                     plus_one(rounded.dL_dweights),
                     std::vector<float>(p.features.size()),
                     plus_one(rounded.dL_dshared)};
    const auto dL_dfeatures = features_view(p.shape, p.rows, Span<float>(r.dL_dfeatures));
    for (std::size_t row = 0; row < p.rows; ++row)
        for (std::size_t c = 0; c < F; ++c)
            dL_dfeatures(row, c) = static_cast<float>(1 + rounded.dL_dinputs[row * (F + P) + c]);
    return r;
}

/// Features and points; 80 inputs; few and many outputs; narrow layers: the field of shadows, and numbers that fill no
/// tile.
constexpr Shape mixed_shapes[] = {{64, 4, 0, 0, 30, 64, 2},
                                  {64, 4, 10, 6, 30, 64, 2},
                                  {64, 4, 16, 0, 64, 64, 2},
                                  {8, 8, 3, 2, 1, 64, 2},
                                  {20, 4, 0, 12, 17, 64, 2},
                                  {64, 4, 0, 20, 1, 32, 2},
                                  {12, 4, 3, 2, 5, 24, 2},
                                  {8, 4, 0, 3, 3, 9, 2},
                                  {16, 4, 1, 0, 20, 48, 2}};

} // namespace

TEST_CASE("mixed precision rounds the operands of products to bf16, and nothing else") {
    if (test::skip_without_device()) return;
    for (const Shape& shape : mixed_shapes)
        for (const std::size_t rows : {1u, 15u, 16u, 17u, 31u, 32u, 33u, 63u, 64u, 65u, 150u}) {
            CAPTURE(shape.features);
            CAPTURE(shape.outputs);
            CAPTURE(rows);
            const Problem<float> p(shape, rows);
            const Results<float> found = run_device(p, {.precision = Precision::mixed}), expected = run_rounded(p);
            // A sum in another order may be rounded to the neighbouring number.
            check_close(found.outputs, expected.outputs, 1e-3);
            check_close(found.dL_dweights, expected.dL_dweights, 1e-3);
            check_close(found.dL_dfeatures, expected.dL_dfeatures, 1e-3);
            check_close(found.dL_dshared, expected.dL_dshared, 1e-3);
        }
}

TEST_CASE("mixed precision is near float, and float for networks of other depths and larger ones") {
    if (test::skip_without_device()) return;
    for (const Shape& shape : mixed_shapes) {
        const Problem<float> p(shape, 150);
        const Results<float> found = run_device(p, {.precision = Precision::mixed}), expected = run_serial(p);
        check_close(found.outputs, expected.outputs, 0.01);
        // Of random numbers, many activations are so near 0 that rounding changes which pass.
        check_close(found.dL_dweights, expected.dL_dweights, 0.1);
        check_close(found.dL_dfeatures, expected.dL_dfeatures, 0.1);
        check_close(found.dL_dshared, expected.dL_dshared, 0.1);
    }
    for (const Shape& shape :
         {Shape{16, 4, 0, 0, 5, 72, 2}, Shape{64, 4, 0, 0, 5, 64, 1}, Shape{64, 4, 20, 0, 5, 64, 2}}) {
        const Problem<float> p(shape, 70);
        const Results<float> found = run_device(p, {.precision = Precision::mixed}), expected = run_device(p);
        CHECK(found.outputs == expected.outputs);
        CHECK(found.dL_dweights == expected.dL_dweights);
    }
}

TEST_CASE("mixed precision gives the same bits in any order of blocks and threads, and adds or assigns") {
    if (test::skip_without_device()) return;
    const Problem<float> p(mixed_shapes[1], 300);
    const Options mixed{.most_blocks = 3, .precision = Precision::mixed};
    const Results<float> first = run_device(p, mixed);
#if defined(GSH_CUDA_EMULATION)
    auto& machine = test::CudaEmulation::instance();
    for (const test::Order order : {test::Order::reverse, test::Order::random}) {
        machine.order = order, machine.fill = 0x5A;
        const Results<float> again = run_device(p, mixed);
        CHECK(again.outputs == first.outputs);
        CHECK(again.dL_dweights == first.dL_dweights);
        CHECK(again.dL_dfeatures == first.dL_dfeatures);
        CHECK(again.dL_dshared == first.dL_dshared);
    }
    machine.order = test::Order::forward, machine.fill = 0xA5;
#endif
    const Results<float> assigned = run_device(p, {.mode = Write::assign, .precision = Precision::mixed});
    for (std::size_t i = 0; i < first.dL_dfeatures.size(); ++i)
        REQUIRE(assigned.dL_dfeatures[i] == doctest::Approx(first.dL_dfeatures[i] - 1).epsilon(1e-5));
    const Results<float> none = run_device(Problem<float>(mixed_shapes[1], 0), {.precision = Precision::mixed});
    CHECK(none.dL_dweights == std::vector<float>(p.weights.size(), 1.0f));
}

} // namespace gsh::mlp_on_device
