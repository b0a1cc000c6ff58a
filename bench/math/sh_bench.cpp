// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/sh.hpp>

#include <benchmark/benchmark.h>

#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t count = 170'000; // Gaussians of an avatar

struct Data {
    std::vector<vec3<float>> sh, dirs, colors, dL_dsh, dL_ddirs;

    explicit Data(int basis_count)
        : sh(count * static_cast<std::size_t>(basis_count)), dirs(count), colors(count), dL_dsh(sh.size()),
          dL_ddirs(count) {
        Rng rng(1);
        const auto number = [&] { return static_cast<float>(rng.uniform(-1, 1)); };
        for (auto& v : sh) v = {number(), number(), number()};
        for (auto& v : dirs) v = normalize(vec3<float>(number(), number(), number()));
    }
};

template <int Degree>
struct Forward {
    Span<const vec3<float>> sh, dirs;
    Span<vec3<float>> colors;
    void operator()(std::size_t i) const {
        colors[i] = SHEval<Degree>::forward(sh.data() + i * SHEval<Degree>::basis_count, dirs[i]);
    }
};

template <int Degree>
struct Backward {
    Span<const vec3<float>> sh, dirs, dL_dcolors;
    Span<vec3<float>> dL_dsh, dL_ddirs;
    void operator()(std::size_t i) const {
        constexpr std::size_t basis = SHEval<Degree>::basis_count;
        SHEval<Degree>::backward(sh.data() + i * basis, dirs[i], dL_dcolors[i], dL_dsh.data() + i * basis, dL_ddirs[i]);
    }
};

template <class B, int Degree>
void sh_forward(benchmark::State& state) {
    Data data(SHEval<Degree>::basis_count);
    B backend;
    for (auto _ : state) {
        backend.for_each(count, Forward<Degree>{data.sh, data.dirs, data.colors});
        benchmark::DoNotOptimize(data.colors.data());
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(count));
    state.SetBytesProcessed(state.iterations() * std::int64_t((data.sh.size() + 2 * count) * sizeof(vec3<float>)));
}

template <class B, int Degree>
void sh_backward(benchmark::State& state) {
    Data data(SHEval<Degree>::basis_count);
    B backend;
    for (auto _ : state) {
        backend.for_each(count, Backward<Degree>{data.sh, data.dirs, data.colors, data.dL_dsh, data.dL_ddirs});
        benchmark::DoNotOptimize(data.dL_dsh.data());
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(count));
    state.SetBytesProcessed(state.iterations() * std::int64_t((3 * data.sh.size() + 4 * count) * sizeof(vec3<float>)));
}

BENCHMARK_TEMPLATE(sh_forward, cpu::Serial, 0)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_forward, cpu::Serial, 1)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_forward, cpu::Serial, 2)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_forward, cpu::Serial, 3)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_forward, cpu::Serial, 4)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_forward, cpu::Threads, 2)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_TEMPLATE(sh_backward, cpu::Serial, 0)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_backward, cpu::Serial, 1)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_backward, cpu::Serial, 2)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_backward, cpu::Serial, 3)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_backward, cpu::Serial, 4)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(sh_backward, cpu::Threads, 2)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
