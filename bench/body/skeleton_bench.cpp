// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of forward kinematics with 55 joints, and of its adjoint.
#include <gsh/backend/threads.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/rng.hpp>

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

constexpr std::size_t J = 55;

vec3<double> vector(Rng& rng) {
    const double x = rng.uniform(-1, 1), y = rng.uniform(-1, 1), z = rng.uniform(-1, 1);
    return {x, y, z};
}

void count(benchmark::State& state, std::size_t items, std::size_t bytes) {
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(items));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

template <bool Backward>
void kinematics(benchmark::State& state) {
    cpu::Threads backend;
    std::vector<int> parents(J);
    for (std::size_t j = 0; j < J; ++j) parents[j] = static_cast<int>((j + 1) / 2) - 1;
    Skeleton<cpu::Threads, float> skeleton(backend, parents);
    Rng rng(1);
    std::vector<vec3<float>> pose, joints, transl(1), dL_dpose(J), dL_djoints(J);
    std::vector<mat3<float>> rotations(J), dL_drotations(J);
    std::vector<Affine<float>> bones(J);
    for (std::size_t j = 0; j < J; ++j)
        pose.push_back(vec3<float>(vector(rng))), joints.push_back(vec3<float>(vector(rng)));
    for (auto _ : state) {
        skeleton.rotations(pose, rotations);
        skeleton.bones(rotations, joints, transl, bones);
        if (Backward) {
            skeleton.bones_backward(rotations, joints, bones, bones, dL_drotations, dL_djoints, transl);
            skeleton.rotations_backward(pose, dL_drotations, dL_dpose);
        }
        benchmark::ClobberMemory();
    }
    count(state, J, J * (12 + 36 + 12 + 48) * (Backward ? 2 : 1));
}

BENCHMARK(kinematics<false>);
BENCHMARK(kinematics<true>);

} // namespace
} // namespace gsh
