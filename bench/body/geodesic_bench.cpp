// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of distances along a body's surface from face and hands, which a region mask needs once per avatar.
#include <gsh/body/region_mask.hpp>
#include <gsh/synthetic/actor.hpp>

#include <benchmark/benchmark.h>

namespace gsh {
namespace {

const BodyModel& body() {
    static const BodyModel model = make_actor();
    return model;
}

void prepare(benchmark::State& state) {
    const BodyModel& model = body();
    for (auto _ : state) benchmark::DoNotOptimize(GeodesicDistance(model.v_template, model.faces));
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(body().vertex_count()));
}
BENCHMARK(prepare)->Unit(benchmark::kMillisecond);

/// Argument: the largest distance in millimetres; 0: the whole body.
void from_face_and_hands(benchmark::State& state) {
    const GeodesicDistance geodesic(body().v_template, body().faces);
    const std::vector<int> high = body_regions(body()).high();
    const double reach = state.range(0) ? 1e-3 * static_cast<double>(state.range(0)) : GeodesicDistance::unreachable;
    for (auto _ : state) benchmark::DoNotOptimize(geodesic.from(high, reach));
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(body().vertex_count()));
    state.counters["vertices"] = static_cast<double>(body().vertex_count());
    state.counters["sources"] = static_cast<double>(high.size());
}
BENCHMARK(from_face_and_hands)->Arg(90)->Arg(180)->Arg(0)->Unit(benchmark::kMillisecond);

/// The most expensive case: the distances of all vertices from one vertex.
void from_one_vertex(benchmark::State& state) {
    const GeodesicDistance geodesic(body().v_template, body().faces);
    const std::vector<int> source{0};
    for (auto _ : state) benchmark::DoNotOptimize(geodesic.from(source));
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(body().vertex_count()));
}
BENCHMARK(from_one_vertex)->Unit(benchmark::kMillisecond);

} // namespace
} // namespace gsh
