// SPDX-License-Identifier: Apache-2.0
/// @file  Posing 170,000 Gaussians on 55 bones, spherical harmonics of degree 2, and the way back.
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/rotation.hpp>

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000, J = 55, influences = 6, basis = 9;

/// Arrays in the order that Morton-sorted samples have: neighbours hang on the same bones.
struct Scene {
    std::vector<vec3<float>> means, log_scales, sh, splat_means, colors;
    std::vector<quat<float>> quats;
    std::vector<float> logits, weights, opacities;
    std::vector<std::uint16_t> joints;
    std::vector<Affine<float>> bones;
    std::vector<sym3<float>> covariances;

    Scene() {
        Rng rng(1);
        const auto number = [&](double low, double high) { return static_cast<float>(rng.uniform(low, high)); };
        const auto vector = [&](double low, double high) {
            const float x = number(low, high), y = number(low, high), z = number(low, high);
            return vec3<float>(x, y, z);
        };
        for (std::size_t i = 0; i < N; ++i) {
            means.push_back(vector(-1, 1)), log_scales.push_back(vector(-6, -4)), logits.push_back(number(-2, 2));
            quats.push_back({number(0.5, 1), number(-1, 1), number(-1, 1), number(-1, 1)});
            for (std::size_t k = 0; k < basis; ++k) sh.push_back(vector(-0.1, 0.1));
            const std::size_t used = 1 + (i / 64) % 4, first = i * J / N;
            for (std::size_t k = 0; k < influences; ++k) {
                joints.push_back(static_cast<std::uint16_t>((first + k) % J));
                weights.push_back(k < used ? 1.0f / static_cast<float>(used) : 0.0f);
            }
        }
        for (std::size_t j = 0; j < J; ++j) bones.push_back({rotation_from_axis_angle(vector(-1, 1)), vector(-1, 1)});
        splat_means.resize(N), colors.resize(N), opacities.resize(N), covariances.resize(N);
    }
    SkinnedView<const float> view() const {
        return {means, quats, log_scales, logits, sh, {}, {joints, weights, influences}, 0};
    }
    SplatView<float> splats() { return {splat_means, covariances, opacities, colors}; }
};

template <class B>
void forward(benchmark::State& state) {
    Scene scene;
    B backend;
    for (auto _ : state) {
        skinned_splats_forward<2>(backend, scene.view(), scene.bones, vec3<float>(0, 1, 4), scene.splats());
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (152 + 6 * influences + 52)));
}

/// With half of the Gaussians unseen, as on a body, or none.
template <class B>
void backward(benchmark::State& state) {
    Scene scene, gradient;
    B backend;
    skinned_splats_forward<2>(backend, scene.view(), scene.bones, vec3<float>(0, 1, 4), scene.splats());
    for (std::size_t i = 0; i < N; ++i)
        if ((i / 64) % 2 && state.range(0) == 50) {
            scene.splat_means[i] = scene.colors[i] = vec3<float>(0);
            scene.covariances[i] = {}, scene.opacities[i] = 0;
        }
    const SkinnedView<float> out{gradient.means, gradient.quats, gradient.log_scales, gradient.logits, gradient.sh};
    std::vector<vec3<float>> center(1);
    SkinnedSplatsWorkspace<B, float> workspace;
    for (auto _ : state) {
        skinned_splats_backward<2>(backend, scene.view(), scene.bones, vec3<float>(0, 1, 4), scene.splats(), workspace,
                                   out, gradient.bones, center);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (152 + 6 * influences + 52 + 2 * 152)));
}

BENCHMARK(forward<cpu::Serial>)->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->ArgName("unseen_percent")->Arg(0)->Arg(50)->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Threads>)
    ->ArgName("unseen_percent")
    ->Arg(0)
    ->Arg(50)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

} // namespace
} // namespace gsh
