// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of rasterizing a body's mesh at 512 x 512: front view, pinhole camera, and the four depth views.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/prior/prior_view.hpp>

#include "body_mesh.hpp"

#include <benchmark/benchmark.h>

namespace gsh {
namespace {

template <class Draw>
void measure(benchmark::State& state, const Draw& draw, int images) {
    for (auto _ : state) benchmark::DoNotOptimize(draw());
    const auto faces = static_cast<std::int64_t>(bench::body().faces.size());
    state.SetItemsProcessed(state.iterations() * images * faces);
    state.SetBytesProcessed(state.iterations() * images * (512 * 512 * (4 + 8 + 24) + faces * 12));
}

template <class B>
void orthographic(benchmark::State& state) {
    B backend;
    const auto camera = side_camera(bench::body().v_template, BodySide::front);
    measure(state, [&] { return rasterize_mesh(backend, bench::body().v_template, bench::body().faces, camera); }, 1);
}
BENCHMARK_TEMPLATE(orthographic, cpu::Serial)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(orthographic, cpu::Threads)->Unit(benchmark::kMillisecond)->UseRealTime();

template <class B>
void pinhole(benchmark::State& state) {
    B backend;
    const auto camera = look_at<double>({0, 0, 3.2}, {0, 0, 0}, {0, 1, 0}, 0.6, 512, 512);
    measure(state, [&] { return rasterize_mesh(backend, bench::body().v_template, bench::body().faces, camera); }, 1);
}
BENCHMARK_TEMPLATE(pinhole, cpu::Serial)->Unit(benchmark::kMillisecond);

void four_depths(benchmark::State& state) {
    cpu::Serial backend;
    measure(state, [&] { return four_depth_views(backend, bench::body().v_template, bench::body().faces); }, 4);
}
BENCHMARK(four_depths)->Unit(benchmark::kMillisecond);

} // namespace
} // namespace gsh
