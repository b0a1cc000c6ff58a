// SPDX-License-Identifier: Apache-2.0
/// @file  Hash grid and MLP together on the CUDA backend, with every kind of inputs, in steps that are repeated, and in
///        mixed precision.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/serial.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/cuda/hash_field.cuh>
#include <gsh/field/cuda/hash_grid.cuh>
#include <gsh/field/cuda/mlp.cuh>
#include <gsh/field/hash_field.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/cuda/adam.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/rounded_mlp.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::hash_field_on_device {
namespace {

using cuda::Device;

using Field = HashField<4, 4>;
constexpr std::size_t outputs = 5;

/// Inputs and parameters of a field at random points, some of which read the fine levels.
template <class T, class Kind = Field>
struct Problem {
    using Field = Kind;
    Field field;
    bool separate_tables;
    std::vector<vec3<T>> points;
    std::vector<T> region, point_inputs, shared, table, weights, dL_doutputs;

    Problem(std::size_t count, std::size_t point_columns, std::size_t shared_columns, bool multi_scale, bool separate,
            int width = 24)
        : field({.base = 3, .growth = 1.7, .table_size = 128}, {.outputs = outputs, .width = width}, point_columns,
                shared_columns),
          separate_tables(separate) {
        test::Rng rng(4);
        const auto numbers = [&](std::size_t n, double low, double high) {
            std::vector<T> result(n);
            for (T& x : result) x = static_cast<T>(rng.uniform(low, high));
            return result;
        };
        for (const auto& p : rng.vecs(count, 0, 1)) points.push_back(vec3<T>(p));
        if (multi_scale) region = numbers(count, -1, 1);
        for (T& tau : region) tau = std::max(tau, T(0));
        point_inputs = numbers(count * point_columns, -1, 1);
        shared = numbers(shared_columns, -1, 1);
        table = numbers(field.grid().parameter_count() * (separate ? 2 : 1), -1, 1);
        weights = numbers(field.mlp().parameter_count(), -1, 1);
        dL_doutputs = numbers(count * outputs, -1, 1);
    }
};

/// The problem on a backend, and what the passes make of it.
template <class B, class T, class Field = hash_field_on_device::Field>
struct Passes {
    template <class V>
    using Buffer = typename B::template Buffer<V>;
    const Problem<T, Field>& p;
    B& backend;
    Buffer<vec3<T>> points;
    Buffer<T> region, point_inputs, shared, table, weights, dL_doutputs, result, dL_dtable, dL_dweights, dL_dshared;
    typename Field::Query<B, T> query;
    typename Field::Cache<B, T> cache;

    Passes(B& made, const Problem<T, Field>& problem) : p(problem), backend(made) {
        assign(backend, p.points, points);
        assign(backend, p.region, region);
        assign(backend, p.point_inputs, point_inputs);
        assign(backend, p.shared, shared);
        assign(backend, p.table, table);
        assign(backend, p.weights, weights);
        assign(backend, p.dL_doutputs, dL_doutputs);
        result.resize(p.dL_doutputs.size());
        assign(backend, std::vector<T>(p.table.size(), T(0)), dL_dtable);
        assign(backend, std::vector<T>(p.weights.size(), T(0)), dL_dweights);
        assign(backend, std::vector<T>(p.shared.size(), T(0)), dL_dshared);
        p.field.prepare(backend, points, query, {1, p.separate_tables, region});
    }
    void step() {
        const FieldInputs<T> inputs{point_inputs, shared};
        p.field.forward(backend, table, weights, query, result, cache, inputs);
        p.field.backward(backend, weights, query, dL_doutputs, cache, dL_dtable, dL_dweights, inputs, dL_dshared);
    }
    template <class V>
    [[nodiscard]] std::vector<V> fetch(const Buffer<V>& from) const {
        return downloaded(backend, Span<const V>(from));
    }
};

template <class T, class Field>
void check_equal(const Passes<Device, T, Field>& found, const Passes<cpu::Serial, T, Field>& expected) {
    const double tolerance = sizeof(T) == 8 ? 1e-12 : 1e-4;
    CHECK(found.fetch(found.query.touched) == expected.fetch(expected.query.touched));
    CHECK(found.query.lookups() == expected.query.lookups());
    CHECK(test::relative_distance(found.fetch(found.result), expected.fetch(expected.result)) <= tolerance);
    CHECK(test::relative_distance(found.fetch(found.dL_dtable), expected.fetch(expected.dL_dtable)) <= tolerance);
    CHECK(test::relative_distance(found.fetch(found.dL_dweights), expected.fetch(expected.dL_dweights)) <= tolerance);
    CHECK(test::relative_distance(found.fetch(found.dL_dshared), expected.fetch(expected.dL_dshared)) <= tolerance);
}

} // namespace

TEST_CASE_TEMPLATE("HashField on the device equals Serial", T, float, double) {
    if (test::skip_without_device()) return;
    const auto compare = [](const Problem<T>& p) {
        Device device;
        cpu::Serial serial;
        Passes<Device, T> found(device, p);
        Passes<cpu::Serial, T> expected(serial, p);
        found.step();
        expected.step();
        check_equal(found, expected);
    };
    for (const std::size_t n : {0, 1, 257}) {
        CAPTURE(n);
        compare(Problem<T>(n, 0, 0, false, false));
        compare(Problem<T>(n, 3, 0, true, false));
        if (n != 0) compare(Problem<T>(n, 2, 5, true, true)); // without points there is no region
    }
}

TEST_CASE("HashField of an avatar's size on the device equals Serial, in mixed precision nearly") {
    if (test::skip_without_device()) return;
    using Large = HashField<16, 4>; // scripts/kernel-registers expects kernels of this size
    const Problem<float, Large> p(100, 0, 0, true, false, 64);
    Device device, mixed;
    cpu::Serial serial;
    mixed.set_precision(Precision::mixed);
    Passes<Device, float, Large> found(device, p), rounded(mixed, p);
    Passes<cpu::Serial, float, Large> expected(serial, p);
    found.step(), rounded.step(), expected.step();
    check_equal(found, expected);
    const auto differ = [&](const Device::Buffer<float>& from, const std::vector<float>& other) {
        return test::relative_distance(rounded.fetch(from), other);
    };
    CHECK(differ(rounded.result, expected.fetch(expected.result)) <= 0.015);
    CHECK(differ(rounded.dL_dtable, expected.fetch(expected.dL_dtable)) <= 0.1);
    CHECK(differ(rounded.dL_dweights, expected.fetch(expected.dL_dweights)) <= 0.1);
}

TEST_CASE("HashField::backward on the device is the gradient of forward") {
    if (test::skip_without_device()) return;
    const Problem<double> p(70, 2, 5, true, true);
    Device device;
    Passes<Device, double> passes(device, p);
    passes.step();
    const auto loss_of = [&](const Problem<double>& moved) {
        Passes<Device, double> at(device, moved);
        at.step();
        return test::inner(at.fetch(at.result), p.dL_doutputs);
    };
    // Central differences along random directions, and along single numbers.
    const auto check = [&](std::vector<double> Problem<double>::*numbers, const std::vector<double>& gradient) {
        test::Rng rng(12);
        for (int direction = 0; direction < 4; ++direction) {
            std::vector<double> along(gradient.size());
            if (direction < 2) for (double& x : along) x = rng.uniform(-1, 1);
            else along[static_cast<std::size_t>(direction) % along.size()] = 1;
            double expected = 0;
            for (std::size_t i = 0; i < along.size(); ++i) expected += gradient[i] * along[i];
            const double step = 1e-7;
            Problem<double> before = p, after = p;
            for (std::size_t i = 0; i < along.size(); ++i)
                (before.*numbers)[i] -= step * along[i], (after.*numbers)[i] += step * along[i];
            CHECK((loss_of(after) - loss_of(before)) / (2 * step) == doctest::Approx(expected).epsilon(1e-5).scale(1));
        }
    };
    check(&Problem<double>::table, passes.fetch(passes.dL_dtable));
    check(&Problem<double>::weights, passes.fetch(passes.dL_dweights));
    check(&Problem<double>::shared, passes.fetch(passes.dL_dshared));
}

TEST_CASE("steps of HashField are repeated as one graph") {
    if (test::skip_without_device()) return;
    const Problem<float> p(150, 2, 5, true, true);
    Device device;
    cpu::Serial serial;
    Passes<Device, float> found(device, p);
    Passes<cpu::Serial, float> expected(serial, p);
    cuda::StepGraph graph(device);
    for (int step = 0; step < 3; ++step) {
        graph.run([&] { found.step(); });
        expected.step();
    }
    check_equal(found, expected);
    CHECK(graph.counts().captures == 1);
    CHECK(graph.counts().launches == 3);
}

namespace {

Problem<float> mixed_problem(std::size_t count, bool with_inputs, bool multi_scale, bool separate, int width = 64) {
    return with_inputs ? Problem<float>(count, 3, 5, multi_scale, separate, width)
                       : Problem<float>(count, 0, 0, multi_scale, separate, width);
}

struct MixedResults {
    std::vector<float> result, dL_dtable, dL_dweights, dL_dshared;
};

MixedResults run_mixed(const Problem<float>& p) {
    Device device;
    device.set_precision(Precision::mixed);
    Passes<Device, float> passes(device, p);
    passes.step();
    return {passes.fetch(passes.result), passes.fetch(passes.dL_dtable), passes.fetch(passes.dL_dweights),
            passes.fetch(passes.dL_dshared)};
}

/// What mixed precision computes, with sums in double: entries of the table are rounded to fp16, features, their
/// gradients and the operands of the network's products to bf16.
MixedResults run_rounded(const Problem<float>& p) {
    using Grid = Field::Grid;
    cpu::Serial serial;
    std::vector<vec3<double>> points(p.points.begin(), p.points.end());
    const std::vector<double> region(p.region.begin(), p.region.end());
    Field::Query<cpu::Serial, double> query;
    p.field.prepare(serial, points, query, {1, p.separate_tables, region});
    std::vector<double> table;
    for (const float x : p.table) table.push_back(test::as_fp16(double(x)));

    const std::size_t rows = p.points.size(), size = p.field.grid().parameter_count(), F = Grid::output_count,
                      P = p.field.point_inputs();
    std::vector<double> features(rows * F);
    const FeatureView<double> view(features, rows, F, F);
    for (std::size_t g = 0; g < query.grids.size(); ++g) {
        p.field.grid().forward(serial, Span<const double>(table).subspan(g * size, size), query.grids[g], view,
                               g ? Write::add : Write::assign);
        for (double& x : features) x = test::as_bf16(x);
    }
    std::vector<double> inputs;
    for (std::size_t i = 0; i < rows; ++i) {
        for (std::size_t c = 0; c < F; ++c) inputs.push_back(features[i * F + c]);
        for (std::size_t c = 0; c < P; ++c) inputs.push_back(double(p.point_inputs[i * P + c]));
    }
    const test::RoundedMlp mlp(p.field.mlp(), rows, p.weights, inputs, p.shared, p.dL_doutputs);
    std::vector<double> dL_dfeatures(rows * F), dL_dtable(table.size());
    for (std::size_t i = 0; i < rows; ++i)
        for (std::size_t c = 0; c < F; ++c) dL_dfeatures[i * F + c] = test::as_bf16(mlp.dL_dinputs[i * (F + P) + c]);
    for (std::size_t g = 0; g < query.grids.size(); ++g)
        p.field.grid().backward(serial, FeatureView<const double>(dL_dfeatures, rows, F, F), query.grids[g],
                                Span<double>(dL_dtable).subspan(g * size, size));
    const auto narrow = [](const std::vector<double>& from) { return std::vector<float>(from.begin(), from.end()); };
    return {narrow(mlp.outputs), narrow(dL_dtable), narrow(mlp.dL_dweights), narrow(mlp.dL_dshared)};
}

void check_same(const MixedResults& found, const MixedResults& expected) {
    CHECK(found.result == expected.result);
    CHECK(found.dL_dtable == expected.dL_dtable);
    CHECK(found.dL_dweights == expected.dL_dweights);
    CHECK(found.dL_dshared == expected.dL_dshared);
}

} // namespace

TEST_CASE("HashField in mixed precision rounds tables to fp16, features and operands to bf16, and nothing else") {
    if (test::skip_without_device()) return;
    const auto compare = [](const Problem<float>& p) {
        const MixedResults found = run_mixed(p), expected = run_rounded(p);
        // A number whose sum is taken in another order may be rounded to the neighbouring one.
        CHECK(test::relative_distance(found.result, expected.result) <= 1e-3);
        CHECK(test::relative_distance(found.dL_dtable, expected.dL_dtable) <= 2e-3);
        CHECK(test::relative_distance(found.dL_dweights, expected.dL_dweights) <= 2e-3);
        CHECK(test::relative_distance(found.dL_dshared, expected.dL_dshared) <= 2e-3);
        // Against float: of random numbers, many activations are so near 0 that rounding changes which pass. In a batch
        // of one, a single one of them can be a third of the gradient.
        if (p.points.size() < 31) return;
        cpu::Serial serial;
        Passes<cpu::Serial, float> plain(serial, p);
        plain.step();
        CHECK(test::relative_distance(found.result, plain.fetch(plain.result)) <= 0.015);
        CHECK(test::relative_distance(found.dL_dtable, plain.fetch(plain.dL_dtable)) <= 0.1);
        CHECK(test::relative_distance(found.dL_dweights, plain.fetch(plain.dL_dweights)) <= 0.1);
    };
    for (const std::size_t n : {0, 1, 31, 32, 33, 63, 64, 65, 257}) {
        CAPTURE(n);
        compare(mixed_problem(n, n % 2 == 1, false, false));
    }
    for (const bool separate : {false, true}) compare(mixed_problem(150, true, true, separate));
    compare(mixed_problem(150, true, true, false, 32)); // as the field of shadows
}

TEST_CASE("HashField in mixed precision has the same bits twice and in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    const Problem<float> p = mixed_problem(150, true, true, true);
    const MixedResults first = run_mixed(p);
    check_same(run_mixed(p), first);
#if defined(GSH_CUDA_EMULATION)
    auto& machine = test::CudaEmulation::instance();
    for (const test::Order order : {test::Order::reverse, test::Order::random}) {
        machine.order = order, machine.fill = 0xFF;
        check_same(run_mixed(p), first);
    }
    machine.order = test::Order::forward, machine.fill = 0xA5;
#endif
}

TEST_CASE("HashField in mixed precision keeps a network of wide layers in float") {
    if (test::skip_without_device()) return;
    Problem<float> p(100, 2, 5, true, false, 72);
    const MixedResults found = run_mixed(p);
    for (float& x : p.table) x = static_cast<float>(test::as_fp16(double(x)));
    Device device;
    Passes<Device, float> expected(device, p);
    expected.step();
    CHECK(found.result == expected.fetch(expected.result));
    CHECK(found.dL_dtable == expected.fetch(expected.dL_dtable));
    CHECK(found.dL_dweights == expected.fetch(expected.dL_dweights));
}

TEST_CASE("steps of HashField in mixed precision, each after a step of Adam, are repeated as one graph") {
    if (test::skip_without_device()) return;
    const Problem<float> p = mixed_problem(100, true, true, true);
    const auto train = [&](auto run) {
        Device device;
        device.set_precision(Precision::mixed);
        Passes<Device, float> passes(device, p);
        Device::Buffer<float> m(p.table.size()), v(p.table.size());
        device.fill(Span<float>(m), 0.0f), device.fill(Span<float>(v), 0.0f);
        const auto step = [&](int number) {
            passes.step();
            Adam().step_rows(device, Span<float>(passes.table), passes.dL_dtable, m, v, passes.query.touched, 4, 0.05,
                             number, UsedGradients::zero);
        };
        run(device, step);
        MixedResults results{passes.fetch(passes.result), passes.fetch(passes.table), {}, {}};
        Problem<float> next = p; // the last table, in a field that never saw another
        next.table = results.dL_dtable;
        passes.step();
        CHECK(passes.fetch(passes.result) == run_mixed(next).result);
        return results;
    };
    const MixedResults direct = train([](Device&, const auto& step) {
        for (int k = 1; k <= 4; ++k) step(k);
    });
    const MixedResults repeated = train([](Device& device, const auto& step) {
        cuda::StepGraph graph(device);
        for (int k = 1; k <= 4; ++k) graph.run([&] { step(k); });
        CHECK(graph.counts().captures == 1);
        CHECK(graph.counts().launches == 4);
    });
    check_same(repeated, direct);
}

TEST_CASE("HashField in mixed precision refuses memory of the host") {
    if (test::skip_without_device()) return;
    const Problem<float> p = mixed_problem(10, true, false, false);
    Device device;
    device.set_precision(Precision::mixed);
    Passes<Device, float> passes(device, p);
    const FieldInputs<float> inputs{passes.point_inputs, passes.shared}, host{p.point_inputs, passes.shared};
    const auto forward = [&](Span<const float> table, const FieldInputs<float>& from) {
        p.field.forward(device, table, passes.weights, passes.query, passes.result, passes.cache, from);
    };
    CHECK_THROWS_AS(forward(p.table, inputs), MemoryError);
    CHECK_THROWS_AS(forward(passes.table, host), MemoryError);
    forward(passes.table, inputs);
    CHECK_THROWS_AS(p.field.backward(device, passes.weights, passes.query, p.dL_doutputs, passes.cache,
                                     passes.dL_dtable, passes.dL_dweights, inputs, passes.dL_dshared),
                    MemoryError);
    device.synchronize();
}

} // namespace gsh::hash_field_on_device
