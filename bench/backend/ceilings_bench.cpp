// SPDX-License-Identifier: Apache-2.0
/// @file  What this machine can do at most: multiply-adds in registers, and traffic to memory.
///        `scripts/bench --ceilings` puts the rates of gsh's components beside these.
#include <gsh/backend/host_buffer.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/math/wide.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>

using namespace gsh;

namespace {

using W = Wide<float>;

/// A multiply-add has a latency of four cycles or so, and a core starts at most two in a cycle: twelve independent sums
/// keep it busy.
template <class B>
void multiply_adds(benchmark::State& state) {
    B backend;
    constexpr std::size_t steps = 100'000, sums = 12;
    const std::size_t threads = backend.thread_count();
    for (auto _ : state)
        backend.for_chunks(threads, 1, [&](std::size_t, std::size_t, std::size_t) {
            W x[sums], factor(0.999f), offset(0.001f);
            for (std::size_t i = 0; i < sums; ++i) x[i] = W(static_cast<float>(i));
            benchmark::DoNotOptimize(factor), benchmark::DoNotOptimize(offset);
            for (std::size_t step = 0; step < steps; ++step)
                for (std::size_t i = 0; i < sums; ++i) x[i] = multiply_add(x[i], factor, offset);
            W sum(0.0f);
            for (std::size_t i = 0; i < sums; ++i) sum += x[i];
            benchmark::DoNotOptimize(sum);
        });
    state.counters["flop/s"] = benchmark::Counter(2 * static_cast<double>(threads * steps * sums * W::width),
                                                  benchmark::Counter::kIsIterationInvariantRate);
}

/// Arrays far beyond the caches. A copy counts what it reads and what it writes, as the program sees it.
template <class B>
struct Memory {
    static constexpr std::size_t size = std::size_t(32) << 20, grain = std::size_t(1) << 18; // floats
    B backend;
    cpu::Buffer<float> from{size}, to{size};

    Memory() { backend.fill(Span<float>(from), 1.0f), backend.fill(Span<float>(to), 0.0f); }
    template <class Body>
    void pass(benchmark::State& state, std::size_t streams, const Body& body) {
        for (auto _ : state)
            backend.for_chunks(size, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
                W sum(0.0f);
                for (std::size_t i = begin; i < end; i += W::width) body(i, sum);
                benchmark::DoNotOptimize(sum);
            });
        state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(streams * size * sizeof(float)));
    }
};

template <class B>
void read(benchmark::State& state) {
    Memory<B> m;
    m.pass(state, 1, [&](std::size_t i, W& sum) { sum += W::load(&m.from[i]); });
}
template <class B>
void write(benchmark::State& state) {
    Memory<B> m;
    m.pass(state, 1, [&](std::size_t i, W&) { W(2.0f).store(&m.to[i]); });
}
template <class B>
void copy(benchmark::State& state) {
    Memory<B> m;
    m.pass(state, 2, [&](std::size_t i, W&) { W::load(&m.from[i]).store(&m.to[i]); });
}

BENCHMARK(multiply_adds<cpu::Serial>)->UseRealTime();
BENCHMARK(multiply_adds<cpu::Threads>)->UseRealTime();
BENCHMARK(read<cpu::Serial>)->UseRealTime();
BENCHMARK(read<cpu::Threads>)->UseRealTime();
BENCHMARK(write<cpu::Threads>)->UseRealTime();
BENCHMARK(copy<cpu::Serial>)->UseRealTime();
BENCHMARK(copy<cpu::Threads>)->UseRealTime();

} // namespace
