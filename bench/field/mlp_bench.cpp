// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/mlp.hpp>

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstddef>

using namespace gsh;

namespace {

constexpr std::size_t points = 170'000;

void count(benchmark::State& state, const Mlp& mlp, double passes) {
    const double times = static_cast<double>(state.iterations()) * points;
    state.SetItemsProcessed(static_cast<std::int64_t>(times));
    state.SetBytesProcessed(
        static_cast<std::int64_t>(times * sizeof(float) * static_cast<double>(mlp.inputs() + mlp.outputs())));
    state.counters["flop/s"] = benchmark::Counter(times * passes * 2 * static_cast<double>(mlp.parameter_count()),
                                                  benchmark::Counter::kIsRate);
}

/// The avatar's networks, with inputs level by level. Arguments: outputs (27: spherical harmonics, 3: displacement);
/// whether in mixed precision; backward, the percentage of rows with a gradient.
template <class B>
struct Setup {
    B backend;
    Mlp mlp;
    Mlp::Cache<B, float> cache;
    std::vector<float> weights = mlp.initial_weights<float>(1), inputs = std::vector<float>(points * 64),
                       outputs = std::vector<float>(points * mlp.outputs());
    FeatureView<const float> view{inputs, points, 64, 4};

    explicit Setup(const benchmark::State& state) : mlp({64, static_cast<int>(state.range(0))}) {
        if (state.range(1)) backend.set_precision(Precision::mixed);
        for (std::size_t i = 0; i < inputs.size(); ++i) inputs[i] = static_cast<float>(random_uniform(1, i) - 0.5);
    }
};

template <class B>
void forward(benchmark::State& state) {
    Setup<B> s(state);
    for (auto _ : state) s.mlp.forward(s.backend, s.weights, {s.view}, s.outputs, s.cache);
    count(state, s.mlp, 1);
}

template <class B>
void backward(benchmark::State& state) {
    Setup<B> s(state);
    s.mlp.forward(s.backend, s.weights, {s.view}, s.outputs, s.cache);
    for (std::size_t i = 0; i < points; ++i) // rows without a gradient come in groups, as hidden Gaussians do
        if (random_uniform(2, i / 8) * 100 >= static_cast<double>(state.range(2)))
            std::fill_n(s.outputs.begin() + static_cast<std::ptrdiff_t>(i * s.mlp.outputs()), s.mlp.outputs(), 0.0f);
    std::vector<float> dL_dweights(s.weights.size()), dL_dinputs(s.inputs.size());
    const FeatureView<float> dL_dview(dL_dinputs, points, 64, 4);
    for (auto _ : state)
        s.mlp.backward(s.backend, s.weights, {s.view}, s.outputs, s.cache, dL_dweights, dL_dview, Write::assign);
    count(state, s.mlp, 2);
}

BENCHMARK(forward<cpu::Serial>)->ArgsProduct({{27, 3}, {0, 1}})->ArgNames({"outputs", "mixed"})->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->ArgsProduct({{27, 3}, {0, 1}})->ArgNames({"outputs", "mixed"})->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->ArgsProduct({{27, 3}, {0, 1}, {100, 60}})->ArgNames({"outputs", "mixed", "rows"})->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Threads>)->ArgsProduct({{27, 3}, {0, 1}, {100, 60}})->ArgNames({"outputs", "mixed", "rows"})->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
