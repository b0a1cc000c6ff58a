// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of posing a body's mesh with its vertex normals, and of the adjoint through both.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/posed_surface.hpp>

#include "../prior/body_mesh.hpp"

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

template <class B, bool Backward>
void posed_surface(benchmark::State& state) {
    const BodyModel& body = bench::body();
    B backend;
    const PosedSurface<B> surface(backend, body, {});
    const std::size_t V = body.vertex_count(), J = body.joint_count();
    std::vector<Affine<float>> bones, dL_dbones(J);
    for (const auto& bone : pose_body(body, std::vector<vec3<double>>(J, vec3<double>(0.1, -0.1, 0.2))).bones)
        bones.push_back({mat3<float>(bone.linear), vec3<float>(bone.translation)});
    std::vector<vec3<float>> offsets(V), dL_dvertices(V, vec3<float>(1)), dL_doffsets(V);
    typename PosedSurface<B>::Cache cache;
    surface.forward(bones, offsets, cache);
    for (auto _ : state) {
        if (Backward) surface.backward(bones, offsets, dL_dvertices, dL_dvertices, cache, dL_dbones, dL_doffsets);
        else surface.forward(bones, offsets, cache);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(V));
}

BENCHMARK(posed_surface<cpu::Serial, false>)->Unit(benchmark::kMillisecond);
BENCHMARK(posed_surface<cpu::Threads, false>)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(posed_surface<cpu::Serial, true>)->Unit(benchmark::kMillisecond);
BENCHMARK(posed_surface<cpu::Threads, true>)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
