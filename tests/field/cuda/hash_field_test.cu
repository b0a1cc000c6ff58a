// SPDX-License-Identifier: Apache-2.0
/// @file  Hash grid and MLP together on the CUDA backend, with every kind of inputs, in steps that are repeated.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/serial.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/cuda/hash_grid.cuh>
#include <gsh/field/cuda/mlp.cuh>
#include <gsh/field/hash_field.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

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
template <class T>
struct Problem {
    Field field;
    bool separate_tables;
    std::vector<vec3<T>> points;
    std::vector<T> region, point_inputs, shared, table, weights, dL_doutputs;

    Problem(std::size_t count, std::size_t point_columns, std::size_t shared_columns, bool multi_scale, bool separate)
        : field({.base = 3, .growth = 1.7, .table_size = 128}, {.outputs = outputs, .width = 24}, point_columns,
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
template <class B, class T>
struct Passes {
    template <class V>
    using Buffer = typename B::template Buffer<V>;
    const Problem<T>& p;
    B& backend;
    Buffer<vec3<T>> points;
    Buffer<T> region, point_inputs, shared, table, weights, dL_doutputs, result, dL_dtable, dL_dweights, dL_dshared;
    typename Field::Query<B, T> query;
    typename Field::Cache<B, T> cache;

    Passes(B& made, const Problem<T>& problem) : p(problem), backend(made) {
        const auto upload = [&](const auto& from, auto& to) {
            to.resize(from.size());
            backend.upload(Span(from.data(), from.size()), Span(to.data(), to.size()));
        };
        upload(p.points, points);
        upload(p.region, region);
        upload(p.point_inputs, point_inputs);
        upload(p.shared, shared);
        upload(p.table, table);
        upload(p.weights, weights);
        upload(p.dL_doutputs, dL_doutputs);
        result.resize(p.dL_doutputs.size());
        upload(std::vector<T>(p.table.size(), T(0)), dL_dtable);
        upload(std::vector<T>(p.weights.size(), T(0)), dL_dweights);
        upload(std::vector<T>(p.shared.size(), T(0)), dL_dshared);
        p.field.prepare(backend, points, query, {1, p.separate_tables, region});
    }
    void step() {
        const FieldInputs<T> inputs{point_inputs, shared};
        p.field.forward(backend, table, weights, query, result, cache, inputs);
        p.field.backward(backend, weights, query, dL_doutputs, cache, dL_dtable, dL_dweights, inputs, dL_dshared);
    }
    template <class V>
    [[nodiscard]] std::vector<V> fetch(const Buffer<V>& from) const {
        std::vector<V> host(from.size());
        backend.download(Span<const V>(from), Span<V>(host));
        return host;
    }
};

template <class T>
void check_close(const std::vector<T>& found, const std::vector<T>& expected) {
    REQUIRE(found.size() == expected.size());
    double difference = 0, size = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
        difference += std::pow(double(found[i]) - double(expected[i]), 2);
        size += std::pow(double(expected[i]), 2);
    }
    CHECK(std::isfinite(difference));
    CHECK(std::sqrt(difference) <= (sizeof(T) == 8 ? 1e-12 : 1e-4) * std::sqrt(size));
}
template <class T>
void check_equal(const Passes<Device, T>& found, const Passes<cpu::Serial, T>& expected) {
    CHECK(found.fetch(found.query.touched) == expected.fetch(expected.query.touched));
    CHECK(found.query.lookups() == expected.query.lookups());
    check_close(found.fetch(found.result), expected.fetch(expected.result));
    check_close(found.fetch(found.dL_dtable), expected.fetch(expected.dL_dtable));
    check_close(found.fetch(found.dL_dweights), expected.fetch(expected.dL_dweights));
    check_close(found.fetch(found.dL_dshared), expected.fetch(expected.dL_dshared));
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

} // namespace gsh::hash_field_on_device
