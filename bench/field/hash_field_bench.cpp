// SPDX-License-Identifier: Apache-2.0
#include "body_points.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/field/hash_field.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

using Field = HashField<16, 4>;
constexpr std::size_t points = 170'000;

/// A field of the avatar's size. Arguments: outputs; shared inputs; per cent of the points that ask for levels 12 to
/// 15.
template <class B>
struct Setup {
    B backend;
    Field field;
    typename Field::Query<B, float> query;
    typename Field::Cache<B, float> cache;
    std::vector<float> table, weights, shared, outputs, dL_dtable, dL_dweights;

    explicit Setup(const benchmark::State& state)
        : field({}, {.outputs = static_cast<int>(state.range(0))}, 0, static_cast<std::size_t>(state.range(1))),
          table(field.grid().initial_table<float>(1)), weights(field.mlp().initial_weights<float>(2)),
          shared(field.shared_inputs(), 0.5f), outputs(points * field.mlp().outputs()), dL_dtable(table.size()),
          dL_dweights(weights.size()) {
        std::vector<float> region(points, 0.0f);
        for (std::size_t i = 0; i < points * static_cast<std::size_t>(state.range(2)) / 100; ++i) region[i] = 1;
        field.prepare(backend, bench::body_points(points), query, {12, false, region});
    }
    void forward() { field.forward(backend, table, weights, query, outputs, cache, {{}, shared}); }
    void backward() { field.backward(backend, weights, query, outputs, cache, dL_dtable, dL_dweights, {{}, shared}); }
};

/// Multiplications and additions of the network, and table rows read.
template <class B>
void count(benchmark::State& state, const Setup<B>& s, double products) {
    const double times = static_cast<double>(state.iterations());
    state.counters["GFLOP/s"] =
        benchmark::Counter(times * products * 2 * static_cast<double>(points * s.field.mlp().parameter_count()) * 1e-9,
                           benchmark::Counter::kIsRate);
    state.counters["lookups"] = static_cast<double>(s.query.lookups());
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(points));
}

template <class B>
void forward(benchmark::State& state) {
    Setup<B> s(state);
    for (auto _ : state) s.forward();
    count(state, s, 1);
}

template <class B>
void backward(benchmark::State& state) {
    Setup<B> s(state);
    s.forward();
    for (auto _ : state) s.backward();
    count(state, s, 2);
}

/// SH of degree 2; both heads joined, a quarter of the points in fine regions; displacements; one number that follows
/// nine shared inputs.
void heads(benchmark::internal::Benchmark* bench) {
    bench->Args({27, 0, 100})->Args({30, 0, 25})->Args({3, 0, 100})->Args({1, 9, 100});
}

BENCHMARK(forward<cpu::Serial>)->Args({27, 0, 100})->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Serial>)->Args({27, 0, 100})->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->Apply(heads)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Threads>)->Apply(heads)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
