// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of sigmoid and exponential of an avatar's opacities and scales, as scalars and registers, and of adjoints.
#include <gsh/backend/serial.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/wide.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t count = 170'000 / 16 * 16; // opacities of an avatar, in whole registers

template <Lane T>
struct Activate {
    Span<const T> x;
    Span<T> sigmoids, exponentials;
    void operator()(std::size_t i) const {
        sigmoids[i] = sigmoid(x[i]);
        exponentials[i] = exp(x[i]);
    }
};

template <Lane T>
struct ActivateBackward {
    Span<const T> sigmoids, exponentials;
    Span<T> dL_dx;
    void operator()(std::size_t i) const {
        sigmoid_backward(sigmoids[i], exponentials[i], dL_dx[i]);
        exp_backward(exponentials[i], sigmoids[i], dL_dx[i]);
    }
};

template <class T>
void activations(benchmark::State& state) {
    constexpr std::size_t n = count / LaneTraits<T>::width;
    std::vector<T> x(n), sigmoids(n), exponentials(n), dL_dx(n, T(0));
    Rng rng(1);
    for (T& value : x) value = T(static_cast<ScalarOf<T>>(rng.uniform(-6, 3)));
    cpu::Serial backend;
    for (auto _ : state) {
        if (state.range(0))
            backend.for_each(n, ActivateBackward<T>{sigmoids, exponentials, dL_dx});
        else
            backend.for_each(n, Activate<T>{x, sigmoids, exponentials});
        benchmark::DoNotOptimize(exponentials.data());
        benchmark::DoNotOptimize(dL_dx.data());
    }
    state.SetBytesProcessed(state.iterations() * std::int64_t(3 * count * sizeof(ScalarOf<T>)));
}

BENCHMARK_TEMPLATE(activations, float)->ArgName("backward")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(activations, Wide<float>)->ArgName("backward")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

} // namespace
