// SPDX-License-Identifier: Apache-2.0
#include "body_points.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/hash_grid.hpp>

#include <benchmark/benchmark.h>

using namespace gsh;

namespace {

using Grid = HashGrid<16, 4>;
constexpr std::size_t points = 170'000;

/// Bytes per point: each corner entry is read once (and written once in backward), and each row of features once.
void count(benchmark::State& state, std::size_t passes) {
    const auto times = state.iterations() * static_cast<std::int64_t>(points);
    state.SetItemsProcessed(times);
    state.SetBytesProcessed(times * static_cast<std::int64_t>((8 * passes + 1) * Grid::output_count * sizeof(float)));
}

/// The widest grid of the avatar. Argument: layout of the features, 1 level by level, 0 row-major.
template <class B>
struct Setup {
    B backend;
    Grid grid{{.growth = 1.5}};
    Grid::Query<B, float> query;
    std::vector<float> table = grid.initial_table<float>(1), features = std::vector<float>(points * Grid::output_count);
    FeatureView<float> view;

    explicit Setup(const benchmark::State& state)
        : view(features, points, Grid::output_count, state.range(0) ? 4 : Grid::output_count) {
        const auto p = bench::body_points(points);
        grid.prepare(backend, p, query);
    }
};

template <class B>
void forward(benchmark::State& state) {
    Setup<B> s(state);
    for (auto _ : state) s.grid.forward(s.backend, s.table, s.query, s.view);
    count(state, 1);
}

template <class B>
void backward(benchmark::State& state) {
    Setup<B> s(state);
    s.grid.forward(s.backend, s.table, s.query, s.view);
    std::vector<float> dL_dtable(s.table.size());
    for (auto _ : state) s.grid.backward(s.backend, s.view, s.query, dL_dtable);
    count(state, 2);
    state.counters["touched"] = static_cast<double>(s.query.touched.size());
    state.counters["entries"] = static_cast<double>(s.grid.entry_count());
}

template <class B>
void prepare(benchmark::State& state) {
    Setup<B> s(state);
    const auto p = bench::body_points(points);
    for (auto _ : state) s.grid.prepare(s.backend, p, s.query);
    count(state, 1);
}

BENCHMARK(forward<cpu::Serial>)->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Threads>)->Arg(1)->Arg(0)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(prepare<cpu::Threads>)->Arg(1)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
