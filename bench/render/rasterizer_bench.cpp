// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of rasterizing a body of 170,000 small Gaussians and a harder scene, at two image sizes, and by stage.
#include "capsule_load.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include <benchmark/benchmark.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000;

const bench::CapsuleLoad& load_of(std::int64_t index) {
    static const bench::CapsuleLoad loads[] = {bench::make_person(N), bench::make_layers(N)};
    return loads[index];
}

template <class B>
struct Setup {
    B backend;
    const bench::CapsuleLoad& load;
    Camera<float> camera;
    Rasterizer<B, float> rasterizer{backend};
    typename Rasterizer<B, float>::Cache cache;
    Image<float> color, dL_dcolor;
    bench::CapsuleLoad dL{N};
    Background<float> background{vec3<float>(1)};

    explicit Setup(benchmark::State& state)
        : load(load_of(state.range(0))), camera(bench::make_camera(static_cast<int>(state.range(1)))),
          color(3, camera.height, camera.width), dL_dcolor(3, camera.height, camera.width) {
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < camera.height; ++y)
                for (int x = 0; x < camera.width; ++x)
                    dL_dcolor.at(c, y, x) =
                        0.5f * std::sin(0.05f * static_cast<float>(x * (c + 1)) + 0.03f * static_cast<float>(y));
        dL.means.resize(N), dL.colors.resize(N), dL.covariances.resize(N), dL.opacities.resize(N);
    }
    SplatView<float> gradients() { return {dL.means, dL.covariances, dL.opacities, dL.colors}; }
    void forward() { rasterizer.forward(camera, load.view(), background, {color.view()}, cache); }
    void backward() { rasterizer.backward(camera, load.view(), background, {dL_dcolor.view()}, cache, gradients()); }

    void report(benchmark::State& state, std::size_t bytes) {
        std::size_t covered = 0;
        for (std::size_t i = 0; i < color.view().plane_size(); ++i) covered += color.data[i] != 1.0f;
        state.counters["pairs"] = static_cast<double>(cache.scratch.instances.size());
        state.counters["tiles"] = cache.scratch.active_tiles;
        state.counters["covered"] = static_cast<double>(covered) / static_cast<double>(color.view().plane_size());
        state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
        state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
    }
};

template <class B>
void forward(benchmark::State& state) {
    Setup<B> setup(state);
    for (auto _ : state) setup.forward();
    setup.report(state, N * 52 + setup.color.data.size() * 4);
}

template <class B>
void forward_backward(benchmark::State& state) {
    Setup<B> setup(state);
    for (auto _ : state) {
        setup.forward();
        setup.backward();
    }
    setup.report(state, N * 52 * 4 + setup.color.data.size() * 8);
}

/// The time of each stage, in ms.
template <class B>
void stages(benchmark::State& state) {
    Setup<B> s(state);
    const RasterParams<float>& params = s.rasterizer.params();
    std::array<double, 6> ms{};
    for (auto _ : state) {
        auto start = std::chrono::steady_clock::now();
        const auto lap = [&](std::size_t stage) {
            const auto now = std::chrono::steady_clock::now();
            ms[stage] += std::chrono::duration<double, std::milli>(now - start).count();
            start = now;
        };
        benchmark::DoNotOptimize(cpu::project_splats(s.backend, s.camera, s.load.view(), params, s.cache));
        lap(0);
        const auto order = cpu::sort_by_depth(s.backend, s.cache);
        lap(1);
        cpu::bin_splats(s.backend, order, s.cache);
        lap(2);
        cpu::blend_tiles(s.backend, s.background, params, {s.color.view()}, s.cache);
        lap(3);
        cpu::blend_tiles_backward(s.backend, s.background, params, {s.dL_dcolor.view()}, s.cache, {});
        lap(4);
        cpu::project_splats_backward(s.backend, s.camera, s.load.view(), params, s.cache, s.gradients(), {});
        lap(5);
    }
    const char* const names[] = {"1_project", "2_sort", "3_bin", "4_blend", "5_blend_back", "6_project_back"};
    for (std::size_t i = 0; i < ms.size(); ++i)
        state.counters[names[i]] = ms[i] / static_cast<double>(state.iterations());
    s.report(state, N * 52 * 4 + s.color.data.size() * 8);
}

void cases(benchmark::internal::Benchmark* b) {
    b->ArgNames({"stress", "size"})->Unit(benchmark::kMillisecond)->UseRealTime();
    for (const std::int64_t load : {0, 1})
        for (const std::int64_t size : {540, 1080}) b->Args({load, size});
}
BENCHMARK(forward<cpu::Threads>)->Apply(cases);
BENCHMARK(forward_backward<cpu::Threads>)->Apply(cases);
BENCHMARK(stages<cpu::Threads>)->Apply(cases);
BENCHMARK(stages<cpu::Serial>)->Apply(cases);

} // namespace
} // namespace gsh
