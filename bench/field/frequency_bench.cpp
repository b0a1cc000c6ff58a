// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of the time encoding γ(t), one input and nine outputs, and its adjoint.
#include <gsh/field/frequency.hpp>

#include <benchmark/benchmark.h>

#include <array>

using namespace gsh;

namespace {

using Encoding = FrequencyEncoding<4>;

void encode(benchmark::State& state) {
    std::array<float, Encoding::output_count> features{};
    float t = 0.3f;
    for (auto _ : state) {
        benchmark::DoNotOptimize(t);
        Encoding::forward(t, features.data());
        benchmark::DoNotOptimize(features.data());
        benchmark::ClobberMemory();
    }
}

void encode_backward(benchmark::State& state) {
    std::array<float, Encoding::output_count> dL_dfeatures;
    dL_dfeatures.fill(0.5f);
    float t = 0.3f, dL_dt = 0;
    for (auto _ : state) {
        benchmark::DoNotOptimize(t);
        Encoding::backward(t, dL_dfeatures.data(), dL_dt);
        benchmark::DoNotOptimize(dL_dt);
    }
}

BENCHMARK(encode);
BENCHMARK(encode_backward);

} // namespace
