// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/loss/photometric.hpp>

#include <benchmark/benchmark.h>

#include <cmath>

using namespace gsh;

namespace {

/// 540 x 540 pixels. With `noise` all pixels differ, otherwise those of an ellipse (14 % of the pixels) on white.
void fill(Image<float>& a, Image<float>& b, bool noise) {
    Rng rng(1);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < a.height; ++y)
            for (int x = 0; x < a.width; ++x) {
                const float u = float(rng.uniform()), v = float(rng.uniform());
                if (!noise && std::hypot((x - 270) / 100.0, (y - 270) / 130.0) > 1) continue;
                a.at(c, y, x) = u, b.at(c, y, x) = v;
            }
}

template <class B>
void forward_backward(benchmark::State& state) {
    const bool noise = state.range(0) != 0;
    const int size = int(state.range(1));
    Image<float> a(3, size, size, 1.0f), b = a, gradient(3, size, size);
    fill(a, b, noise);
    B backend;
    PhotometricLoss<B, float> loss(backend);
    typename PhotometricLoss<B, float>::Cache cache;
    for (auto _ : state) {
        loss.forward(a.view(), b.view(), cache);
        loss.backward(a.view(), b.view(), 1.0f, cache, gradient.view());
        benchmark::DoNotOptimize(gradient.data.data());
    }
    state.SetLabel(noise ? "differs everywhere" : "figure on white");
    state.SetItemsProcessed(state.iterations() * std::int64_t(a.data.size()));
    state.SetBytesProcessed(state.iterations() * std::int64_t(a.data.size() * sizeof(float) * 3));
}
BENCHMARK_TEMPLATE(forward_backward, cpu::Serial)->ArgsProduct({{0, 1}, {540}})->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(forward_backward, cpu::Threads)
    ->ArgsProduct({{0, 1}, {540, 1080}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

template <class B>
void forward_only(benchmark::State& state) {
    Image<float> a(3, 540, 540, 1.0f), b = a;
    fill(a, b, state.range(0) != 0);
    B backend;
    PhotometricLoss<B, float> loss(backend);
    typename PhotometricLoss<B, float>::Cache cache;
    for (auto _ : state) {
        loss.forward(a.view(), b.view(), cache);
        benchmark::DoNotOptimize(loss.values(cache));
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(a.data.size()));
}
BENCHMARK_TEMPLATE(forward_only, cpu::Threads)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
