// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of rasterizing a body of 170,000 small Gaussians and a harder scene, at two image sizes, and by stage.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include <benchmark/benchmark.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000;

struct Capsule {
    vec3<double> from, to;
    double radius;
    double area() const { return 2 * std::numbers::pi * radius * (length(to - from) + 2 * radius); }
};

/// Points on the surfaces of capsules, evenly by area, in order along each capsule's axis. Neighbours in memory are
/// therefore near each other, as in a trained avatar.
struct Load {
    std::vector<vec3<float>> means, colors;
    std::vector<sym3<float>> covariances;
    std::vector<float> opacities;
    Rng rng{1};

    SplatView<const float> view() const { return {means, covariances, opacities, colors}; }

    template <class Visit>
    void sample(const std::vector<Capsule>& body, const Visit& visit) {
        double total = 0, before = 0;
        for (const Capsule& capsule : body) total += capsule.area();
        std::size_t done = 0;
        for (const Capsule& capsule : body) {
            before += capsule.area();
            const auto end = static_cast<std::size_t>(before / total * static_cast<double>(N) + 0.5);
            const std::size_t begin = done;
            const vec3<double> axis = normalize(capsule.to - capsule.from);
            const vec3<double> side = normalize(cross(axis, vec3<double>(0.3, 0.2, 0.9))), other = cross(axis, side);
            const double r = capsule.radius, count = static_cast<double>(end - begin);
            const double span = length(capsule.to - capsule.from) + 2 * r; // along it, equal steps have equal areas
            for (; done < end; ++done) {
                const double h = span * (static_cast<double>(done - begin) + rng.uniform()) / count - r;
                const double angle = rng.uniform(0, 2 * std::numbers::pi);
                const double beyond = h < 0 ? h : std::max(0.0, h - (span - 2 * r)); // depth in a cap
                const double across = std::sqrt(std::max(0.0, r * r - beyond * beyond)) / r;
                const vec3<double> normal =
                    normalize((side * std::cos(angle) + other * std::sin(angle)) * across + axis * (beyond / r));
                visit(capsule.from + axis * (h - beyond) + normal * r, normal);
            }
        }
    }
    void add(const vec3<double>& mean, const mat3<double>& axes, double opacity) {
        const sym3<double> c = gram(axes);
        const double red = rng.uniform(), green = rng.uniform(), blue = rng.uniform();
        means.push_back(vec3<float>(mean)), opacities.push_back(static_cast<float>(opacity));
        covariances.push_back({float(c.xx), float(c.xy), float(c.xz), float(c.yy), float(c.yz), float(c.zz)});
        colors.push_back(vec3<float>(float(red), float(green), float(blue)));
    }
};

/// A person of capsules, 1.7 m tall. Flat Gaussians on the surface have 0.6 of their spacing as size; most are opaque.
Load make_body() {
    const std::vector<Capsule> body = {
        {{0, -0.62, 0}, {0, -0.76, 0}, 0.10},        {{0, -0.40, 0}, {0, 0.0, 0}, 0.15},
        {{0.18, -0.42, 0}, {0.36, -0.05, 0.05}, 0.045}, {{0.36, -0.05, 0.05}, {0.44, 0.25, 0}, 0.04},
        {{-0.18, -0.42, 0}, {-0.36, -0.05, 0.05}, 0.045}, {{-0.36, -0.05, 0.05}, {-0.44, 0.25, 0}, 0.04},
        {{0.09, 0.08, 0}, {0.13, 0.45, -0.02}, 0.075}, {{0.13, 0.45, -0.02}, {0.14, 0.80, 0}, 0.055},
        {{-0.09, 0.08, 0}, {-0.13, 0.45, -0.02}, 0.075}, {{-0.13, 0.45, -0.02}, {-0.14, 0.80, 0}, 0.055}};
    double area = 0;
    for (const Capsule& capsule : body) area += capsule.area();
    const double size = 0.6 * std::sqrt(area / static_cast<double>(N));
    Load load;
    load.sample(body, [&](const vec3<double>& p, const vec3<double>& normal) {
        const vec3<double> a = normalize(cross(normal, vec3<double>(0.41, 0.77, 0.49))), b = cross(normal, a);
        const double s0 = size * std::exp(0.4 * load.rng.normal()), s1 = size * std::exp(0.4 * load.rng.normal());
        const double opacity = load.rng.uniform() < 0.7 ? load.rng.uniform(0.9, 1) : load.rng.uniform(0.05, 0.9);
        load.add(p, mat3<double>(a * s0, b * s1, normal * (0.3 * size)), opacity);
    });
    return load;
}

/// One thick capsule with jitter. The Gaussians have all directions, a median size of 4 mm, and form many transparent
/// layers.
Load make_stress() {
    Load load;
    load.sample({{{0, -0.6, 0}, {0, 0.6, 0}, 0.25}}, [&](const vec3<double>& p, const vec3<double>& normal) {
        Rng& rng = load.rng;
        const quat<double> q{rng.normal(), rng.normal(), rng.normal(), rng.normal()}; // braces: evaluated in order
        mat3<double> axes = rotation_matrix(normalize(q));
        for (int k = 0; k < 3; ++k) axes[k] *= 0.004 * std::exp(0.5 * rng.normal());
        const vec3<double> mean = p + normal * (0.002 * rng.normal());
        load.add(mean, axes, rng.uniform(0.1, 0.9));
    });
    return load;
}

const Load& load_of(std::int64_t index) {
    static const Load loads[] = {make_body(), make_stress()};
    return loads[index];
}

Camera<float> make_camera(int size) {
    Camera<float> camera;
    camera.t = vec3<float>(0, 0, 2.5f);
    camera.fx = camera.fy = 0.9f * static_cast<float>(size) * 2.5f / 1.7f;
    camera.cx = camera.cy = 0.5f * static_cast<float>(size);
    camera.width = camera.height = size;
    return camera;
}

template <class B>
struct Setup {
    B backend;
    const Load& load;
    Camera<float> camera;
    Rasterizer<B, float> rasterizer{backend};
    typename Rasterizer<B, float>::Cache cache;
    Image<float> color, dL_dcolor;
    Load dL;
    Background<float> background{vec3<float>(1)};

    explicit Setup(benchmark::State& state)
        : load(load_of(state.range(0))), camera(make_camera(static_cast<int>(state.range(1)))),
          color(3, camera.height, camera.width), dL_dcolor(3, camera.height, camera.width) {
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < camera.height; ++y)
                for (int x = 0; x < camera.width; ++x)
                    dL_dcolor.at(c, y, x) =
                        0.5f * std::sin(0.05f * static_cast<float>(x * (c + 1)) + 0.03f * static_cast<float>(y));
        dL.means.resize(N), dL.colors.resize(N), dL.covariances.resize(N), dL.opacities.resize(N);
    }
    SplatView<float> gradients() { return {dL.means, dL.covariances, dL.opacities, dL.colors}; }
    void forward() { rasterizer.forward(camera, load.view(), background, {color.view()}, cache); }
    void backward() { rasterizer.backward(camera, load.view(), background, {dL_dcolor.view()}, cache, gradients()); }

    void report(benchmark::State& state, std::size_t bytes) {
        std::size_t covered = 0;
        for (std::size_t i = 0; i < color.view().plane_size(); ++i) covered += color.data[i] != 1.0f;
        state.counters["pairs"] = static_cast<double>(cache.scratch.instances.size());
        state.counters["tiles"] = cache.scratch.active_tiles;
        state.counters["covered"] = static_cast<double>(covered) / static_cast<double>(color.view().plane_size());
        state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(N));
        state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
    }
};

template <class B>
void forward(benchmark::State& state) {
    Setup<B> setup(state);
    for (auto _ : state) setup.forward();
    setup.report(state, N * 52 + setup.color.data.size() * 4);
}

template <class B>
void forward_backward(benchmark::State& state) {
    Setup<B> setup(state);
    for (auto _ : state) {
        setup.forward();
        setup.backward();
    }
    setup.report(state, N * 52 * 4 + setup.color.data.size() * 8);
}

/// The time of each stage, in ms.
template <class B>
void stages(benchmark::State& state) {
    Setup<B> s(state);
    const RasterParams<float>& params = s.rasterizer.params();
    std::array<double, 6> ms{};
    for (auto _ : state) {
        auto start = std::chrono::steady_clock::now();
        const auto lap = [&](std::size_t stage) {
            const auto now = std::chrono::steady_clock::now();
            ms[stage] += std::chrono::duration<double, std::milli>(now - start).count();
            start = now;
        };
        benchmark::DoNotOptimize(cpu::project_splats(s.backend, s.camera, s.load.view(), params, s.cache));
        lap(0);
        const auto order = cpu::sort_by_depth(s.backend, s.cache);
        lap(1);
        cpu::bin_splats(s.backend, order, s.cache);
        lap(2);
        cpu::blend_tiles(s.backend, s.background, params, {s.color.view()}, s.cache);
        lap(3);
        cpu::blend_tiles_backward(s.backend, s.background, params, {s.dL_dcolor.view()}, s.cache, {});
        lap(4);
        cpu::project_splats_backward(s.backend, s.camera, s.load.view(), params, s.cache, s.gradients(), {});
        lap(5);
    }
    const char* const names[] = {"1_project", "2_sort", "3_bin", "4_blend", "5_blend_back", "6_project_back"};
    for (std::size_t i = 0; i < ms.size(); ++i)
        state.counters[names[i]] = ms[i] / static_cast<double>(state.iterations());
    s.report(state, N * 52 * 4 + s.color.data.size() * 8);
}

void cases(benchmark::internal::Benchmark* b) {
    b->ArgNames({"stress", "size"})->Unit(benchmark::kMillisecond)->UseRealTime();
    for (const std::int64_t load : {0, 1})
        for (const std::int64_t size : {540, 1080}) b->Args({load, size});
}
BENCHMARK(forward<cpu::Threads>)->Apply(cases);
BENCHMARK(forward_backward<cpu::Threads>)->Apply(cases);
BENCHMARK(stages<cpu::Threads>)->Apply(cases);
BENCHMARK(stages<cpu::Serial>)->Apply(cases);

} // namespace
} // namespace gsh
