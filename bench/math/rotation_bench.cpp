// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/wide.hpp>

#include <benchmark/benchmark.h>

#include <vector>

using namespace gsh;

namespace {

/// A body has 55 rotations per frame. The bench uses 100,000 to measure the cost of one.
constexpr std::size_t count = 100'000;

template <Lane T>
struct Forward {
    Span<const vec3<T>> v;
    Span<mat3<T>> R;
    void operator()(std::size_t i) const { R[i] = rotation_from_axis_angle(v[i]); }
};

template <Lane T>
struct Backward {
    Span<const vec3<T>> v;
    Span<const mat3<T>> dL_dR;
    Span<vec3<T>> dL_dv;
    void operator()(std::size_t i) const { rotation_from_axis_angle_backward(v[i], dL_dR[i], dL_dv[i]); }
};

template <class B, class T>
void axis_angle(benchmark::State& state, bool backward) {
    constexpr std::size_t n = count / LaneTraits<T>::width;
    std::vector<vec3<T>> v(n), dL_dv(n, vec3<T>(T(0)));
    std::vector<mat3<T>> R(n, mat3<T>(T(1)));
    Rng rng(1);
    const auto number = [&] { return T(static_cast<ScalarOf<T>>(rng.uniform(-2, 2))); };
    for (auto& value : v) value = {number(), number(), number()};
    B backend;
    for (auto _ : state) {
        if (backward)
            backend.for_each(n, Backward<T>{v, R, dL_dv});
        else
            backend.for_each(n, Forward<T>{v, R});
        benchmark::DoNotOptimize(R.data());
        benchmark::DoNotOptimize(dL_dv.data());
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(n * LaneTraits<T>::width));
    state.SetBytesProcessed(state.iterations() *
                            std::int64_t(n * (sizeof(vec3<T>) * (backward ? 3 : 1) + sizeof(mat3<T>))));
}

template <class B, class T>
void axis_angle_forward(benchmark::State& state) {
    axis_angle<B, T>(state, false);
}
template <class B, class T>
void axis_angle_backward(benchmark::State& state) {
    axis_angle<B, T>(state, true);
}

BENCHMARK_TEMPLATE(axis_angle_forward, cpu::Serial, float)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(axis_angle_forward, cpu::Serial, Wide<float>)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(axis_angle_forward, cpu::Threads, float)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_TEMPLATE(axis_angle_backward, cpu::Serial, float)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(axis_angle_backward, cpu::Serial, Wide<float>)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(axis_angle_backward, cpu::Threads, float)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
