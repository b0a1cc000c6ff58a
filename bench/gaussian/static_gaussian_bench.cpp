// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include <benchmark/benchmark.h>

using namespace gsh;

namespace {

constexpr std::size_t count = 170'000;

GaussianCloud<float> random_cloud(int degree) {
    GaussianCloud<float> cloud(count, degree);
    Rng rng(1);
    const auto number = [&] { return static_cast<float>(rng.uniform(-1, 1)); };
    for (auto& v : cloud.means) v = {number(), number(), number()};
    for (auto& q : cloud.quats) q = {number(), number(), number(), number()};
    for (auto& v : cloud.log_scales) v = {number() - 4, number() - 4, number() - 4};
    for (auto& v : cloud.sh) v = {number(), number(), number()};
    return cloud;
}

template <class B, int Degree>
void forward(benchmark::State& state) {
    B backend;
    Gaussians<B, float> gaussians;
    upload(backend, random_cloud(Degree), gaussians);
    Splats<B, float> splats;
    splats.resize(count);
    const StaticSplats<B, Degree> to_splats(backend);
    typename StaticSplats<B, Degree>::Cache cache;
    for (auto _ : state) {
        to_splats.forward(gaussians.view(), vec3<float>(0, 0, -4), splats.view(), cache);
        benchmark::DoNotOptimize(splats.colors.data());
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(count));
    state.SetBytesProcessed(state.iterations() *
                            std::int64_t(count * (11 + 3 * sh_basis_count(Degree) + 13) * sizeof(float)));
}

template <class B, int Degree>
void backward(benchmark::State& state) {
    B backend;
    Gaussians<B, float> gaussians, dL_dgaussians;
    upload(backend, random_cloud(Degree), gaussians);
    upload(backend, GaussianCloud<float>(count, Degree), dL_dgaussians);
    Splats<B, float> dL_dsplats;
    dL_dsplats.resize(count);
    const StaticSplats<B, Degree> to_splats(backend);
    typename StaticSplats<B, Degree>::Cache cache;
    to_splats.forward(gaussians.view(), vec3<float>(0, 0, -4), dL_dsplats.view(), cache);
    for (auto _ : state) {
        to_splats.backward(gaussians.view(), vec3<float>(0, 0, -4), dL_dsplats.view(), cache, dL_dgaussians.view());
        benchmark::DoNotOptimize(dL_dgaussians.sh.data());
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(count));
    state.SetBytesProcessed(state.iterations() *
                            std::int64_t(count * (3 * (11 + 3 * sh_basis_count(Degree)) + 13) * sizeof(float)));
}

BENCHMARK_TEMPLATE(forward, cpu::Serial, 2)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(forward, cpu::Serial, 3)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(forward, cpu::Threads, 3)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_TEMPLATE(backward, cpu::Serial, 2)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(backward, cpu::Serial, 3)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(backward, cpu::Threads, 3)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
