// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of depth and normal features of 170,000 points on a body, computed once per avatar.
#include <gsh/backend/serial.hpp>
#include <gsh/prior/prior_features.hpp>

#include "body_mesh.hpp"

#include <benchmark/benchmark.h>

namespace gsh {
namespace {

void features(benchmark::State& state) {
    cpu::Serial backend;
    const BodyModel& model = bench::body();
    const auto depth = four_depth_views(backend, model.v_template, model.faces);
    const auto normals = two_normal_views(backend, model.v_template, model.faces);
    std::vector<vec3<double>> points;
    for (std::size_t i = 0; points.size() < 170000; ++i)
        points.push_back(model.v_template[i * 7919 % model.vertex_count()]);
    for (auto _ : state) {
        benchmark::DoNotOptimize(depth_features(points, depth));
        benchmark::DoNotOptimize(normal_features(points, normals));
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(points.size()));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(points.size() * (2 * 24 + 10 * 8)));
}
BENCHMARK(features)->Unit(benchmark::kMillisecond);

} // namespace
} // namespace gsh
