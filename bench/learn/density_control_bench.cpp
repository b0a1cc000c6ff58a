// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of density control: the statistics of each step, and a change of 100,000 Gaussians.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/render/cpu/rasterizer.hpp>

#include <benchmark/benchmark.h>

#include <cstdint>

using namespace gsh;

namespace {

constexpr std::size_t count = 100'000;

template <class B>
struct Load {
    B backend;
    DensityControl<B> control{backend, {}, 1.0, 1};
    RasterCache<B, float> cache;
    Gaussians<B> gaussians, m, v;

    Load() {
        GaussianCloud<float> cloud(count, 3);
        cache.width = cache.height = 540;
        cache.visible.resize(count);
        cache.screen_gradient_norms.resize(count);
        cache.screen_radii.resize(count);
        for (std::size_t i = 0; i < count; ++i) {
            cloud.log_scales[i] = vec3<float>(i % 2 ? -6.0f : -3.0f);
            cache.visible[i] = random_uniform(1, i) < 0.6;
            cache.screen_gradient_norms[i] = static_cast<float>(random_uniform(2, i) * 8e-7);
            cache.screen_radii[i] = 6;
        }
        for (auto* set : {&gaussians, &m, &v}) upload(backend, cloud, *set);
        control.restart(count);
    }
};

template <class B>
void observe(benchmark::State& state) {
    Load<B> load;
    for (auto _ : state) load.control.observe(load.cache);
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(count));
}

template <class B>
void adapt(benchmark::State& state) {
    Load<B> load;
    const auto gaussians = load.gaussians;
    for (auto _ : state) {
        state.PauseTiming();
        for (auto* set : {&load.gaussians, &load.m, &load.v}) *set = gaussians;
        load.control.restart(count);
        load.control.observe(load.cache);
        state.ResumeTiming();
        benchmark::DoNotOptimize(load.control.adapt(load.gaussians, load.m, load.v, 7, true));
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(count));
    state.counters["after"] = static_cast<double>(load.gaussians.size());
}

BENCHMARK(observe<cpu::Serial>)->Unit(benchmark::kMillisecond);
BENCHMARK(observe<cpu::Threads>)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(adapt<cpu::Serial>)->Unit(benchmark::kMillisecond);
BENCHMARK(adapt<cpu::Threads>)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
