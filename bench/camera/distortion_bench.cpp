// SPDX-License-Identifier: Apache-2.0
#include <gsh/camera/distortion.hpp>

#include <benchmark/benchmark.h>

#include <vector>

using namespace gsh;

namespace {

constexpr int size = 540;
constexpr Distortion<float> lens{-0.28f, 0.09f, 0.0012f, -0.0008f, -0.011f};

vec2<float> point(int i) { return {float(i % size) / size - 0.5f, float(i / size) / size - 0.5f}; }

void distort_points(benchmark::State& state) {
    std::vector<vec2<float>> out(size * size);
    for (auto _ : state) {
        for (int i = 0; i < size * size; ++i) out[std::size_t(i)] = distort(lens, point(i));
        benchmark::DoNotOptimize(out.data());
    }
    state.SetItemsProcessed(state.iterations() * size * size);
    state.SetBytesProcessed(state.iterations() * size * size * 8);
}
BENCHMARK(distort_points)->Unit(benchmark::kMillisecond);

void undistort_points(benchmark::State& state) {
    std::vector<vec2<float>> out(size * size);
    for (auto _ : state) {
        for (int i = 0; i < size * size; ++i) out[std::size_t(i)] = undistort(lens, point(i)).point;
        benchmark::DoNotOptimize(out.data());
    }
    state.SetItemsProcessed(state.iterations() * size * size);
    state.SetBytesProcessed(state.iterations() * size * size * 8);
}
BENCHMARK(undistort_points)->Unit(benchmark::kMillisecond);

} // namespace
