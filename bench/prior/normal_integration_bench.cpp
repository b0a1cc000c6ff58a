// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of bilateral integration at 512 x 512: the front normals of a body, and an image without background.
#include <gsh/backend/serial.hpp>
#include <gsh/prior/normal_integration.hpp>
#include <gsh/prior/prior_view.hpp>

#include "body_mesh.hpp"

#include <benchmark/benchmark.h>

namespace gsh {
namespace {

void report(benchmark::State& state, const IntegratedDepth& result, std::int64_t pixels) {
    state.SetItemsProcessed(state.iterations() * pixels);
    state.counters["solves"] = result.iterations;
    state.counters["pixels"] = static_cast<double>(pixels);
}

/// With argument 1, the depth of the mesh is the prior.
void body_front(benchmark::State& state) {
    cpu::Serial backend;
    const auto camera = side_camera(bench::body().v_template, BodySide::front);
    const PriorView normals = normal_view(backend, bench::body().v_template, bench::body().faces, camera);
    const PriorView depth = depth_view(backend, bench::body().v_template, bench::body().faces, camera);
    IntegratedDepth result;
    for (auto _ : state) result = integrate_normals(normals, state.range(0) ? &depth : nullptr);
    std::int64_t pixels = 0;
    for (const auto m : normals.map.mask.data) pixels += m;
    report(state, result, pixels);
}
BENCHMARK(body_front)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

/// A ramp beside a plane, with a straight step from one edge of the image to the other.
void full_image(benchmark::State& state) {
    const int size = static_cast<int>(state.range(0));
    OrthographicCamera camera;
    camera.scale = 100, camera.width = camera.height = size;
    PriorView view{camera, {Image<double>(3, size, size), Image<std::uint8_t>(1, size, size, 1)}, {}};
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const vec3<double> n = normalize(vec3<double>(0, x < size / 2 ? 0.5 : 0, -1));
            for (int k = 0; k < 3; ++k) view.map.values.at(k, y, x) = n[k];
        }
    IntegratedDepth result;
    for (auto _ : state) result = integrate_normals(view);
    report(state, result, std::int64_t(size) * size);
}
BENCHMARK(full_image)->Arg(128)->Arg(512)->Unit(benchmark::kMillisecond)->Iterations(1);

} // namespace
} // namespace gsh
