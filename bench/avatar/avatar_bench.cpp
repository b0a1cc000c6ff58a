// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of one frame of an avatar of 170,000 Gaussians, from pose to splats: without shadows (0), with shadows
///        by pose (1), in a light of 4 points and 12 directions (2).
#include <gsh/avatar/avatar.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/synthetic/actor.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000;

/// The actor. `shading` is the benches' argument; a field has the sizes of the trained networks.
const AvatarData& avatar(std::int64_t shading) {
    static const auto make = [](bool with_field, bool with_light) {
        const BodyModel body = make_actor();
        const std::vector<double> betas(static_cast<std::size_t>(body.shape_count), 0.0);
        const auto samples =
            sample_surface(body, shaped_vertices(body, betas),
                           std::vector<double>(body.vertex_count(), double(N) / double(body.vertex_count())), 1);
        AvatarData data{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 2)};
        for (std::size_t i = 0; i < samples.size(); ++i) {
            data.gaussians.means[i] = vec3<float>(samples.positions[i]);
            data.gaussians.quats[i] = {1, 0, 0, 0};
            data.gaussians.log_scales[i] = vec3<float>(-5);
        }
        if (with_field) {
            OcclusionFieldData& field = data.occlusion_field.emplace();
            Rng rng(2);
            const auto fill = [&](std::vector<float>& values, std::size_t count) {
                values.resize(count);
                for (float& value : values) value = static_cast<float>(rng.uniform(-0.3, 0.3));
            };
            fill(field.neurons, samples.size() * 64);
            fill(field.pose_weights, 64 * 9 * (data.rig.joint_count() - 1));
            fill(field.weights, field.network().parameter_count());
        }
        if (with_light) data.light = even_light(4, 12, {0, 0, 0}, 4);
        return data;
    };
    static const AvatarData plain = make(false, false), shadowed = make(true, false), lit = make(false, true);
    return shading == 2 ? lit : shading == 1 ? shadowed : plain;
}

template <class B>
struct Frame {
    B backend;
    Avatar<B> shown;
    RigPose<B, float> pose;
    Splats<B, float> splats;
    typename Avatar<B>::Cache cache;

    explicit Frame(const benchmark::State& state) : shown(backend, avatar(state.range(0))) {
        Motion motion = rest_motion(avatar(0).rig);
        for (auto& angle : motion.pose) angle = vec3<double>(0.1, -0.1, 0.2);
        shown.rig().upload_pose(motion, 0, pose);
        splats.resize(shown.size());
    }
    void forward() { shown.pose(pose, {0, 1, 4}, splats.view(), cache); }
};

template <class B>
void forward(benchmark::State& state) {
    Frame<B> frame(state);
    for (auto _ : state) frame.forward();
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(frame.shown.size()));
}

template <class B>
void backward(benchmark::State& state) {
    Frame<B> frame(state);
    frame.forward();
    std::vector<vec3<float>> dL_dpose(avatar(0).rig.joint_count());
    for (auto _ : state)
        frame.shown.backward_to_pose(frame.pose, {0, 1, 4}, std::as_const(frame.splats).view(), frame.cache,
                                  {dL_dpose, {}, {}});
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(frame.shown.size()));
}

void shadings(benchmark::internal::Benchmark* bench) { bench->ArgName("shading")->DenseRange(0, 2); }

BENCHMARK(forward<cpu::Serial>)->Apply(shadings)->Unit(benchmark::kMillisecond);
BENCHMARK(forward<cpu::Threads>)->Apply(shadings)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(backward<cpu::Serial>)->Apply(shadings)->Unit(benchmark::kMillisecond);
BENCHMARK(backward<cpu::Threads>)->Apply(shadings)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
