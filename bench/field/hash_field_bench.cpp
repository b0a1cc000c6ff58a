// SPDX-License-Identifier: Apache-2.0
#include "body_points.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/hash_field.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

using Field = HashField<16, 4>;
constexpr std::size_t points = 170'000;

/// A field of the avatar's size. Arguments: number of outputs; number of shared inputs; percentage of the points that
/// read levels 12 to 15; number of tables, which share the entries of one.
template <class B>
struct Setup {
    B backend;
    Field field;
    typename Field::Query<B, float> query;
    typename Field::Cache<B, float> cache;
    std::vector<float> table, weights, shared, outputs, dL_dtable, dL_dweights;

    explicit Setup(const benchmark::State& state)
        : field({.growth = 1.6, .table_size = (1u << 17) / static_cast<std::uint32_t>(state.range(3))},
                {.outputs = static_cast<int>(state.range(0))}, 0, static_cast<std::size_t>(state.range(1))),
          weights(field.mlp().initial_weights<float>(2)), shared(field.shared_inputs(), 0.5f),
          outputs(points * field.mlp().outputs()), dL_dweights(weights.size()) {
        // As with K(x) on a body, 70% of the points with τ > 0 have τ = 1.
        std::vector<float> region(points, 0.0f);
        const std::size_t fine = points * static_cast<std::size_t>(state.range(2)) / 100;
        for (std::size_t i = 0; i < fine; ++i) region[i] = 10 * i < 7 * fine ? 1.0f : 0.5f;
        field.prepare(backend, bench::body_points(points), query, {12, state.range(3) > 1, region});
        while (table.size() < field.table_parameter_count(query)) {
            const auto more = field.grid().initial_table<float>(table.size());
            table.insert(table.end(), more.begin(), more.end());
        }
        dL_dtable.resize(table.size());
    }
    void forward() { field.forward(backend, table, weights, query, outputs, cache, {{}, shared}); }
    void backward() { field.backward(backend, weights, query, outputs, cache, dL_dtable, dL_dweights, {{}, shared}); }
};

/// Counts the multiplications and additions of the network, and the table rows that are read.
template <class B>
void count(benchmark::State& state, const Setup<B>& s, double products) {
    const double times = static_cast<double>(state.iterations());
    state.counters["flop/s"] =
        benchmark::Counter(times * products * 2 * static_cast<double>(points * s.field.mlp().parameter_count()),
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
    for (auto _ : state) {
        state.PauseTiming(); // backward uses the cache up
        s.forward();
        state.ResumeTiming();
        s.backward();
    }
    count(state, s, 2);
}

/// The heads of an avatar: SH of degree 2; displacements; one output with nine shared inputs; and SH and displacements
/// in one field. The last one has fine levels for all points; for the 65% of them that K(x) places where τ > 0; for the
/// same points with a table of their own; for a quarter; and for none.
void heads(benchmark::internal::Benchmark* bench) {
    bench->Args({27, 0, 100, 1})->Args({3, 0, 100, 1})->Args({1, 9, 100, 1});
    bench->Args({30, 0, 100, 1})->Args({30, 0, 65, 1})->Args({30, 0, 65, 2})->Args({30, 0, 25, 1})->Args({30, 0, 0, 1});
}

BENCHMARK(forward<cpu::Serial>)->Args({27, 0, 100, 1})->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Serial>)->Args({27, 0, 100, 1})->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->Apply(heads)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Threads>)->Apply(heads)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
