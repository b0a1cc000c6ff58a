// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of projecting an avatar's points, and of the adjoint to points and camera; memory-bound.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/rng.hpp>

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t count = 170'000; // Gaussians of an avatar

struct Project {
    Camera<float> camera;
    Span<const vec3<float>> points;
    Span<vec2<float>> pixels;
    void operator()(std::size_t i) const { pixels[i] = to_pixel(camera, to_camera(camera, points[i])); }
};

/// The camera gradient is summed in a row of partial sums, as in the rasterizer, where each thread has a few.
struct ProjectBackward {
    Camera<float> camera;
    Span<const vec3<float>> points;
    Span<const vec2<float>> dL_dpixels;
    Span<vec3<float>> dL_dpoints;
    Span<CameraGradient<float>> dL_dcameras;
    void operator()(std::size_t i) const {
        const vec3<float> p = to_camera(camera, points[i]);
        vec3<float> dL_dp(0.0f);
        to_pixel_backward(camera, p, dL_dpixels[i], dL_dp, dL_dcameras[i % dL_dcameras.size()]);
        to_camera_backward(camera, points[i], dL_dp, dL_dpoints[i], dL_dcameras[i % dL_dcameras.size()]);
    }
};

struct Data {
    Camera<float> camera = look_at<float>({0, 1, 3}, {0, 1, 0}, {0, 1, 0}, 0.6f, 540, 540);
    std::vector<vec3<float>> points, dL_dpoints = std::vector<vec3<float>>(count, vec3<float>(0.0f));
    std::vector<vec2<float>> pixels = std::vector<vec2<float>>(count);
    std::vector<CameraGradient<float>> dL_dcameras = std::vector<CameraGradient<float>>(512);

    Data() {
        Rng rng(1);
        const auto number = [&] { return static_cast<float>(rng.uniform(-1, 1)); };
        for (std::size_t i = 0; i < count; ++i) points.push_back({number(), number(), number()});
    }
};

template <class B>
void project(benchmark::State& state) {
    Data data;
    B backend;
    for (auto _ : state) {
        backend.for_each(count, Project{data.camera, data.points, data.pixels});
        benchmark::DoNotOptimize(data.pixels.data());
    }
    state.SetBytesProcessed(state.iterations() * std::int64_t(count * (sizeof(vec3<float>) + sizeof(vec2<float>))));
}

void project_backward(benchmark::State& state) { // on one thread, because points share the partial sums
    Data data;
    cpu::Serial backend;
    for (auto _ : state) {
        backend.for_each(count,
                         ProjectBackward{data.camera, data.points, data.pixels, data.dL_dpoints, data.dL_dcameras});
        benchmark::DoNotOptimize(data.dL_dpoints.data());
    }
    state.SetBytesProcessed(state.iterations() * std::int64_t(count * (3 * sizeof(vec3<float>) + sizeof(vec2<float>))));
}

BENCHMARK_TEMPLATE(project, cpu::Serial)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(project, cpu::Threads)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(project_backward)->Unit(benchmark::kMillisecond);

} // namespace
