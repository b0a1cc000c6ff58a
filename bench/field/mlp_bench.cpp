// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/mlp.hpp>

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

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

/// The avatar's networks, with 64 features level by level. Arguments: outputs (27: spherical harmonics, 3:
/// displacement, 30: both); further inputs of each point, which have no gradient (10: the priors of depths and
/// normals); whether in mixed precision; backward, the percentage of rows with a gradient.
template <class B>
struct Setup {
    B backend;
    Mlp mlp;
    Mlp::Cache<B, float> cache;
    std::vector<float> weights = mlp.initial_weights<float>(1), features = std::vector<float>(points * 64),
                       beside = std::vector<float>(points * (mlp.inputs() - 64)),
                       outputs = std::vector<float>(points * mlp.outputs());
    MlpInputs<float> inputs{{features, points, 64, 4}, beside};

    explicit Setup(const benchmark::State& state)
        : mlp({64 + static_cast<int>(state.range(1)), static_cast<int>(state.range(0))}) {
        if (state.range(2)) backend.set_precision(Precision::mixed);
        for (std::size_t i = 0; i < features.size(); ++i) features[i] = static_cast<float>(random_uniform(1, i) - 0.5);
        for (std::size_t i = 0; i < beside.size(); ++i) beside[i] = static_cast<float>(random_uniform(3, i) - 0.5);
    }
};

template <class B>
void forward(benchmark::State& state) {
    Setup<B> s(state);
    for (auto _ : state) s.mlp.forward(s.backend, s.weights, s.inputs, s.outputs, s.cache);
    count(state, s.mlp, 1);
}

template <class B>
void backward(benchmark::State& state) {
    Setup<B> s(state);
    s.mlp.forward(s.backend, s.weights, s.inputs, s.outputs, s.cache);
    for (std::size_t i = 0; i < points; ++i) // rows without a gradient come in groups, as hidden Gaussians do
        if (random_uniform(2, i / 8) * 100 >= static_cast<double>(state.range(3)))
            std::fill_n(s.outputs.begin() + static_cast<std::ptrdiff_t>(i * s.mlp.outputs()), s.mlp.outputs(), 0.0f);
    std::vector<float> dL_dweights(s.weights.size()), dL_dinputs(s.features.size());
    const FeatureView<float> dL_dview(dL_dinputs, points, 64, 4);
    for (auto _ : state)
        s.mlp.backward(s.backend, s.weights, s.inputs, s.outputs, s.cache, dL_dweights, dL_dview, Write::assign);
    count(state, s.mlp, 2);
}

void arguments(benchmark::internal::Benchmark* bench, const std::vector<std::int64_t>& percentages) {
    bench->ArgNames({"outputs", "beside", "mixed", "rows"})->Unit(benchmark::kMillisecond);
    for (const auto& [outputs, beside] : {std::pair(27, 0), std::pair(3, 0), std::pair(30, 10)})
        for (const int mixed : {0, 1})
            for (const std::int64_t percentage : percentages) bench->Args({outputs, beside, mixed, percentage});
}
void forward_arguments(benchmark::internal::Benchmark* bench) { arguments(bench, {100}); }
void backward_arguments(benchmark::internal::Benchmark* bench) { arguments(bench, {100, 60}); }

BENCHMARK(forward<cpu::Serial>)->Apply(forward_arguments);
BENCHMARK(forward<cpu::Threads>)->Apply(forward_arguments)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->Apply(backward_arguments);
BENCHMARK(backward<cpu::Threads>)->Apply(backward_arguments)->UseRealTime();

} // namespace
