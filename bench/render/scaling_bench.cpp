// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer from ten thousand to three million Gaussians, at four image sizes, on one and two threads.
///        `scripts/bench --scaling` draws the picture on docs/performance.md from it.
#include "capsule_load.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <optional>

namespace gsh {
namespace {

/// A person of `count` Gaussians. Only the last one is kept: three million with their gradients take most of a
/// gigabyte.
const bench::CapsuleLoad& person_of(std::size_t count) {
    static std::optional<bench::CapsuleLoad> last;
    if (!last || last->count != count) last = bench::make_person(count);
    return *last;
}

void forward_backward(benchmark::State& state) {
    const auto count = static_cast<std::size_t>(state.range(0));
    const bench::CapsuleLoad& load = person_of(count);
    const Camera<float> camera = bench::make_camera(static_cast<int>(state.range(1)));
    cpu::Threads backend(static_cast<std::size_t>(state.range(2)));
    const Rasterizer<cpu::Threads> rasterizer(backend);
    Rasterizer<cpu::Threads>::Cache cache;
    const Background<float> white{vec3<float>(1)};
    Image<float> color(3, camera.height, camera.width), dL_dcolor(3, camera.height, camera.width, 0.5f);
    Splats<cpu::Threads> gradients;
    gradients.resize(count);
    const auto pass = [&] {
        rasterizer.forward(camera, load.view(), white, {color.view()}, cache);
        fill_zero(backend, gradients.view());
        rasterizer.backward(camera, load.view(), white, {dL_dcolor.view()}, cache, gradients.view());
    };
    pass(); // the first one allocates, and touches new pages
    for (auto _ : state) pass();
    state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(forward_backward)
    ->ArgNames({"gaussians", "size", "threads"})
    ->ArgsProduct({{10'000, 30'000, 100'000, 300'000, 1'000'000, 3'000'000}, {270, 540, 1080, 2160}, {1, 2}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

} // namespace
} // namespace gsh
