// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of the actor and of rendering its default capture.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <benchmark/benchmark.h>

namespace gsh {
namespace {

void make(benchmark::State& state) {
    std::size_t vertices = 0;
    for (auto _ : state) vertices = make_actor().vertex_count();
    state.counters["vertices"] = static_cast<double>(vertices);
}
BENCHMARK(make)->Name("make_actor")->Unit(benchmark::kMillisecond);

/// One frame of the default capture: seven cameras of 320 x 320 pixels, with 25 camera rays per pixel.
template <class B>
void shoot(benchmark::State& state) {
    B backend;
    const BodyModel actor = make_actor();
    const Motion motion = actor_motion(ActorMotion::talk, 1);
    std::size_t pixels = 0, bytes = 0;
    for (auto _ : state) {
        const Capture capture = film(backend, actor, motion);
        for (const auto& image : capture.images) {
            bytes += image.data.size();
            for (std::size_t i = 3; i < image.data.size(); i += 4) pixels += image.data[i] > 0;
        }
    }
    state.SetItemsProcessed(static_cast<std::int64_t>(pixels)); // pixels that show the body
    state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
}
BENCHMARK(shoot<cpu::Serial>)->Name("film/serial")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(shoot<cpu::Threads>)->Name("film/threads")->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
} // namespace gsh
