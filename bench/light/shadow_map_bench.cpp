// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of the visibility of a body's vertices from 4 points and 12 directions, by its own mesh (0) or by the
///        coarse caster (1).
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/cpu/shadow_map.hpp>
#include <gsh/light/shadow_map.hpp>

#include "../prior/body_mesh.hpp"

#include <benchmark/benchmark.h>

#include <array>
#include <numbers>
#include <vector>

namespace gsh {
namespace {

template <class B>
void shadow_maps(benchmark::State& state) {
    const BodyModel& body = bench::body();
    B backend;
    const PosedBody posed = pose_body(body, std::vector<vec3<double>>(body.joint_count(), vec3<double>(0.1, -0.1, 0.2)));
    const auto surface_normals = vertex_normals(posed.vertices, body.faces);
    const std::vector<vec3<float>> vertices(posed.vertices.begin(), posed.vertices.end());
    const std::vector<vec3<float>> normals(surface_normals.begin(), surface_normals.end());
    std::vector<vec3<std::uint32_t>> triangles;
    for (const auto& f : body.faces)
        triangles.push_back({static_cast<std::uint32_t>(f[0]), static_cast<std::uint32_t>(f[1]),
                             static_cast<std::uint32_t>(f[2])});
    const std::vector<vec3<float>> points{{2, 3, 2}, {-3, 1.5f, 1}, {0.5f, 2, -3}, {0, -0.2f, 4}};
    std::vector<vec3<float>> directions;
    const float g = std::numbers::phi_v<float>;
    for (const float s : {-1.0f, 1.0f})
        for (const float t : {-g, g})
            for (const auto& d : {vec3<float>(0, s, t), vec3<float>(s, t, 0), vec3<float>(t, 0, s)})
                directions.push_back(normalize(d));

    const ShadowMaps<B> maps(backend);
    const CoarseCaster<B> coarse(backend, body.v_template, body.faces);
    typename ShadowMaps<B>::Cache cache;
    typename CoarseCaster<B>::Cache picked;
    std::vector<float> visibility(vertices.size() * 16);
    for (auto _ : state) {
        const std::array<ShadowCaster<float>, 1> casters{
            state.range(0) ? coarse.forward(vertices, picked) : ShadowCaster<float>{vertices, triangles}};
        maps.forward(casters, {.points = points, .directions = directions}, vertices, normals, visibility, cache);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(visibility.size()));
}

BENCHMARK(shadow_maps<cpu::Serial>)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);
BENCHMARK(shadow_maps<cpu::Threads>)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
