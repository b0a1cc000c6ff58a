// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of posing 170,000 Gaussians on 55 bones with SH of degree 2, and of the adjoint, for each deformation.
#include <gsh/avatar/cpu/skinned_splats.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/rotation.hpp>

#include <benchmark/benchmark.h>

#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000, J = 55, influences = 6, basis = 9;

/// Arrays in an order like that of Morton-sorted samples: neighbours have the same bones.
struct Scene {
    std::vector<vec3<float>> means, log_scales, sh, splat_means, colors;
    std::vector<quat<float>> quats;
    std::vector<float> logits, ao, weights, opacities;
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
            ao.push_back(number(0.5, 1));
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
    SkinnedView<const float> view(bool shaded) const {
        return {means, quats, log_scales, logits, sh, shaded ? Span<const float>(ao) : Span<const float>(),
                {joints, weights, influences}, 0};
    }
    SplatView<float> splats() { return {splat_means, covariances, opacities, colors}; }
};

/// Arguments: the Deformation; ambient occlusion or none; for backward, the percentage of Gaussians that no pixel
/// shows, which is half of them on a body.
Deformation deformation(const benchmark::State& state) { return static_cast<Deformation>(state.range(0)); }

template <class B>
void forward(benchmark::State& state) {
    Scene scene;
    B backend;
    const SkinnedSplats<B, 2> skin(backend, {.deformation = deformation(state)});
    typename SkinnedSplats<B, 2>::Cache cache;
    for (auto _ : state) {
        skin.forward(scene.view(state.range(1)), scene.bones, vec3<float>(0, 1, 4), scene.splats(), cache);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (152 + 6 * influences + 52)));
}

template <class B>
void backward(benchmark::State& state) {
    Scene scene, gradient;
    B backend;
    const auto view = scene.view(state.range(1));
    const SkinnedSplats<B, 2> skin(backend, {.deformation = deformation(state)});
    typename SkinnedSplats<B, 2>::Cache cache;
    skin.forward(view, scene.bones, vec3<float>(0, 1, 4), scene.splats(), cache);
    for (std::size_t i = 0; i < N; ++i)
        if ((i / 64) % 2 && state.range(2) == 50) {
            scene.splat_means[i] = scene.colors[i] = vec3<float>(0);
            scene.covariances[i] = {}, scene.opacities[i] = 0;
        }
    const SkinnedView<float> out{
        gradient.means, gradient.quats, gradient.log_scales, gradient.logits,
        gradient.sh,    state.range(1) ? Span<float>(gradient.ao) : Span<float>()};
    std::vector<vec3<float>> center(1);
    for (auto _ : state) {
        skin.backward(view, scene.bones, vec3<float>(0, 1, 4), scene.splats(), cache, out, gradient.bones, center);
        benchmark::ClobberMemory();
    }
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(N * (152 + 6 * influences + 52 + 2 * 152)));
}

constexpr long linear = static_cast<long>(Deformation::linear), polar = static_cast<long>(Deformation::polar),
               dual = static_cast<long>(Deformation::dual_quaternion);

void forward_cases(benchmark::internal::Benchmark* bench) {
    bench->ArgNames({"deformation", "ao"})->Unit(benchmark::kMillisecond);
    bench->Args({linear, 0})->Args({linear, 1})->Args({polar, 0})->Args({dual, 0});
}
void backward_cases(benchmark::internal::Benchmark* bench) {
    bench->ArgNames({"deformation", "ao", "unseen_percent"})->Unit(benchmark::kMillisecond);
    bench->Args({linear, 0, 0})->Args({linear, 1, 0})->Args({polar, 0, 0})->Args({dual, 0, 0});
    bench->Args({linear, 0, 50})->Args({polar, 0, 50})->Args({dual, 0, 50});
}
BENCHMARK(forward<cpu::Serial>)->Apply(forward_cases);
BENCHMARK(forward<cpu::Threads>)->Apply(forward_cases)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->Apply(backward_cases);
BENCHMARK(backward<cpu::Threads>)->Apply(backward_cases)->UseRealTime();

} // namespace
} // namespace gsh
