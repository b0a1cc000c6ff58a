// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/color.hpp>
#include <gsh/image/resample.hpp>

#include <benchmark/benchmark.h>

#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

std::vector<std::uint8_t> random_bytes(std::size_t count) {
    Rng rng(1);
    std::vector<std::uint8_t> bytes(count);
    for (auto& byte : bytes) byte = std::uint8_t(rng.below(256));
    return bytes;
}

template <class B>
void composite(benchmark::State& state) {
    const int size = 540;
    const auto bytes = random_bytes(4 * size * size);
    Image<float> color(3, size, size), alpha(1, size, size);
    B backend;
    for (auto _ : state) {
        composite_rgba8(backend, bytes, size, size, {1, 1, 1}, color.view(), alpha.view());
        benchmark::DoNotOptimize(color.data.data());
    }
    state.SetItemsProcessed(state.iterations() * size * size);
    state.SetBytesProcessed(state.iterations() * size * size * (4 + 4 * 4));
}
BENCHMARK_TEMPLATE(composite, cpu::Serial)->Unit(benchmark::kMicrosecond);
BENCHMARK_TEMPLATE(composite, cpu::Threads)->Unit(benchmark::kMicrosecond)->UseRealTime();

template <class B>
void resample_bytes(benchmark::State& state) {
    const int size = 540;
    const auto bytes = random_bytes(4 * size * size);
    std::vector<std::uint8_t> out(bytes.size());
    B backend;
    for (auto _ : state) {
        resample_rgba8(backend, bytes, size, size, ScaleMap<float>{1.01f, 0.99f}, out, size, size);
        benchmark::DoNotOptimize(out.data());
    }
    state.SetItemsProcessed(state.iterations() * size * size);
    state.SetBytesProcessed(state.iterations() * size * size * 8);
}
BENCHMARK_TEMPLATE(resample_bytes, cpu::Threads)->Unit(benchmark::kMicrosecond)->UseRealTime();

} // namespace
