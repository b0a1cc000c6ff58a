// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of blend shapes of SMPL-X's size, with and without pose correctives.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/core/rng.hpp>

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

constexpr std::size_t V = 10475;

vec3<double> vector(Rng& rng) {
    const double x = rng.uniform(-1, 1), y = rng.uniform(-1, 1), z = rng.uniform(-1, 1);
    return {x, y, z};
}

void count(benchmark::State& state, std::size_t items, std::size_t bytes) {
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(items));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

/// C coefficients: 20 of shape and expression, or 506 with the pose correctives of 54 joints.
template <class B, bool Backward>
void blend_shapes(benchmark::State& state) {
    const auto C = static_cast<std::size_t>(state.range(0));
    B backend;
    Rng rng(2);
    std::vector<vec3<double>> directions(V * C);
    for (auto& direction : directions) direction = vector(rng);
    const BlendShapes<B, float> shapes(backend, V, {directions});
    std::vector<float> coefficients(C, 0.5f);
    std::vector<vec3<float>> offsets(V, vec3<float>(1));
    typename BlendShapes<B, float>::Workspace workspace;
    for (auto _ : state) {
        if (Backward) shapes.backward(offsets, coefficients, workspace);
        else shapes.forward(coefficients, offsets);
        benchmark::ClobberMemory();
    }
    count(state, V * C, V * C * 12);
}

BENCHMARK(blend_shapes<cpu::Serial, false>)->Arg(20)->Arg(506)->Unit(benchmark::kMillisecond);
BENCHMARK(blend_shapes<cpu::Threads, false>)->Arg(20)->Arg(506)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(blend_shapes<cpu::Serial, true>)->Arg(20)->Arg(506)->Unit(benchmark::kMillisecond);
BENCHMARK(blend_shapes<cpu::Threads, true>)->Arg(20)->Arg(506)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
