// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of interpolating offsets of 10,475 vertices at 170,000 samples, and of the adjoint.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/core/rng.hpp>

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

constexpr std::size_t V = 10475, N = 170000;

void count(benchmark::State& state, std::size_t items, std::size_t bytes) {
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(items));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

template <class B, bool Backward>
void interpolation(benchmark::State& state) {
    B backend;
    Rng rng(3);
    std::vector<std::array<int, 3>> triangles;
    for (std::size_t i = 0; i < N; ++i) {
        const auto near = static_cast<int>(i * (V - 40) / N); // sorted samples depend on nearby vertices
        triangles.push_back({near, near + static_cast<int>(rng.below(40)), near + static_cast<int>(rng.below(40))});
    }
    const SurfaceInterpolation<B, float> surface(backend, V, triangles,
                                                 std::vector<vec3<double>>(N, vec3<double>(1.0 / 3)));
    std::vector<vec3<float>> values(V), points(N);
    for (auto _ : state) {
        if (Backward) surface.backward(points, values);
        else surface.forward(values, points);
        benchmark::ClobberMemory();
    }
    count(state, N, N * (24 + 36 + (Backward ? 0 : 24)));
}

BENCHMARK(interpolation<cpu::Serial, false>)->Unit(benchmark::kMillisecond);
BENCHMARK(interpolation<cpu::Threads, false>)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(interpolation<cpu::Serial, true>)->Unit(benchmark::kMillisecond);
BENCHMARK(interpolation<cpu::Threads, true>)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
