// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of colouring 170,000 Gaussians under 4 points and 12 directions, and of the adjoint.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/light/cpu/lit_splats.hpp>
#include <gsh/light/lit_splats.hpp>

#include <benchmark/benchmark.h>

#include <array>
#include <cstddef>
#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000, V = 13886, P = 4, D = 12;

/// Samples in an order like that of Morton-sorted ones: neighbours stand on nearby vertices.
struct LitArrays {
    std::vector<vec3<float>> points, directions, vertices, base, normals, colors;
    std::vector<float> log_intensities, gloss = {-1, 3}, visibility;
    std::vector<std::array<int, 3>> triangles;
    std::vector<vec3<float>> center{vec3<float>(0, 0, 4)};

    LitArrays() {
        Rng rng(1);
        const auto number = [&](double low, double high) { return static_cast<float>(rng.uniform(low, high)); };
        const auto vector = [&](double low, double high) {
            const float x = number(low, high), y = number(low, high), z = number(low, high);
            return vec3<float>(x, y, z);
        };
        for (std::size_t k = 0; k < P; ++k) points.push_back(normalize(vector(-1, 1)) * 4.0f);
        for (std::size_t k = 0; k < D; ++k) directions.push_back(normalize(vector(-1, 1)));
        for (std::size_t k = 0; k < P + D; ++k) log_intensities.push_back(number(-1, 1));
        for (std::size_t v = 0; v < V; ++v) vertices.push_back(vector(-1, 1)), normals.push_back(normalize(vector(-1, 1)));
        for (std::size_t n = 0; n < V * (P + D); ++n) visibility.push_back(number(0, 1));
        for (std::size_t i = 0; i < N; ++i) {
            base.push_back(vector(0, 1)), colors.push_back(vector(-1, 1));
            const auto near = static_cast<int>(i * (V - 40) / N);
            triangles.push_back({near, near + static_cast<int>(rng.below(40)), near + static_cast<int>(rng.below(40))});
        }
    }
    LitSplatsInput<float> input(bool glossy) const {
        return {{points, directions, log_intensities, glossy ? Span<const float>(gloss) : Span<const float>()},
                vertices, normals, visibility, base, center[0]};
    }
    template <class B>
    LitSplats<B> splats(B& backend) const {
        return {backend, V, triangles, std::vector<vec3<double>>(N, vec3<double>(1.0 / 3))};
    }
};

/// Arguments: with gloss or without; for backward, the percentage of Gaussians that no pixel shows, which is half of
/// them on a body.
template <class B>
void forward(benchmark::State& state) {
    LitArrays scene;
    B backend;
    const auto lit = scene.splats(backend);
    typename LitSplats<B>::Cache cache;
    for (auto _ : state) {
        lit.forward(scene.input(state.range(0)), scene.colors, cache);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (24 + 12 + 12)));
}

template <class B>
void backward(benchmark::State& state) {
    LitArrays scene, gradient;
    B backend;
    const auto lit = scene.splats(backend);
    typename LitSplats<B>::Cache cache;
    std::vector<vec3<float>> colors(N);
    lit.forward(scene.input(state.range(0)), colors, cache);
    for (std::size_t i = 0; i < N; ++i)
        if ((i / 64) % 2 && state.range(1) == 50) scene.colors[i] = vec3<float>(0);
    const LitSplatsGradient<float> out{{gradient.points, gradient.directions, gradient.log_intensities,
                                        state.range(0) ? Span<float>(gradient.gloss) : Span<float>()},
                                       gradient.vertices, gradient.normals, gradient.base, gradient.center};
    for (auto _ : state) {
        lit.backward(scene.input(state.range(0)), scene.colors, cache, out);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (24 + 12 + 12 + 24 + 8)));
}

void forward_cases(benchmark::internal::Benchmark* bench) {
    bench->ArgNames({"gloss"})->Unit(benchmark::kMillisecond)->Arg(0)->Arg(1);
}
void backward_cases(benchmark::internal::Benchmark* bench) {
    bench->ArgNames({"gloss", "unseen_percent"})->Unit(benchmark::kMillisecond);
    bench->Args({0, 0})->Args({1, 0})->Args({1, 50});
}
BENCHMARK(forward<cpu::Serial>)->Apply(forward_cases);
BENCHMARK(forward<cpu::Threads>)->Apply(forward_cases)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->Apply(backward_cases);
BENCHMARK(backward<cpu::Threads>)->Apply(backward_cases)->UseRealTime();

} // namespace
} // namespace gsh
