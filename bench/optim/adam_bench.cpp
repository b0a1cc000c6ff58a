// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/optim/cpu/adam.hpp>

#include <benchmark/benchmark.h>

#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t entries = 1'331'760, width = 4; // size of an avatar's hash table

struct State {
    std::vector<float> parameters, gradients, m, v;
    std::vector<std::uint32_t> rows;

    State() : parameters(entries * width), gradients(entries * width), m(entries * width), v(entries * width) {
        for (std::size_t i = 0; i < gradients.size(); ++i)
            gradients[i] = static_cast<float>(random_uniform(1, i) - 0.5);
        // Half of the rows are touched, in runs with gaps in between.
        for (std::uint32_t r = 0; r < entries; ++r)
            if (random_bits(2, r / 16) & 1) rows.push_back(r);
    }
};

template <class B>
void dense(benchmark::State& state) {
    B backend;
    State s;
    std::int64_t t = 0;
    for (auto _ : state)
        Adam().step(backend, Span<float>(s.parameters), s.gradients, s.m, s.v, 1e-3, ++t);
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(s.parameters.size()));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(s.parameters.size() * 7 * sizeof(float)));
}

template <class B>
void rows(benchmark::State& state) {
    B backend;
    State s;
    std::int64_t t = 0;
    for (auto _ : state)
        Adam().step_rows(backend, Span<float>(s.parameters), s.gradients, s.m, s.v, s.rows, width, 1e-3, ++t);
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(s.rows.size() * width));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(s.rows.size() * width * 7 * sizeof(float)));
}

BENCHMARK(dense<cpu::Serial>)->Unit(benchmark::kMillisecond);
BENCHMARK(dense<cpu::Threads>)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(rows<cpu::Serial>)->Unit(benchmark::kMillisecond);
BENCHMARK(rows<cpu::Threads>)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
