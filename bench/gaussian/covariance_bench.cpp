// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/wide.hpp>

#include <benchmark/benchmark.h>

#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t count = 170'000; // Gaussians of an avatar

template <Lane T>
struct Forward {
    Span<const quat<T>> quats;
    Span<const vec3<T>> log_scales;
    Span<const T> logits;
    Span<sym3<T>> covariances;
    Span<T> opacities;
    void operator()(std::size_t i) const {
        covariances[i] = covariance(quats[i], log_scales[i]);
        opacities[i] = sigmoid(logits[i]);
    }
};

template <Lane T>
struct Backward {
    Span<const quat<T>> quats;
    Span<const vec3<T>> log_scales;
    Span<const sym3<T>> dL_dcovariances;
    Span<quat<T>> dL_dquats;
    Span<vec3<T>> dL_dlog_scales;
    void operator()(std::size_t i) const {
        covariance_backward(quats[i], log_scales[i], dL_dcovariances[i], dL_dquats[i], dL_dlog_scales[i]);
    }
};

template <class B, class T>
void run(benchmark::State& state, bool backward) {
    constexpr std::size_t n = count / LaneTraits<T>::width;
    std::vector<quat<T>> quats(n), dL_dquats(n);
    std::vector<vec3<T>> log_scales(n), dL_dlog_scales(n, vec3<T>(T(0)));
    std::vector<sym3<T>> covariances(n);
    std::vector<T> logits(n, T(0)), opacities(n, T(0));
    Rng rng(1);
    const auto number = [&] { return T(static_cast<ScalarOf<T>>(rng.uniform(-1, 1))); };
    for (auto& q : quats) q = {number(), number(), number(), number()};
    for (auto& s : log_scales) s = {number(), number(), number()};
    for (auto& c : covariances) c = {number(), number(), number(), number(), number(), number()};
    B backend;
    for (auto _ : state) {
        if (backward)
            backend.for_each(n, Backward<T>{quats, log_scales, covariances, dL_dquats, dL_dlog_scales});
        else
            backend.for_each(n, Forward<T>{quats, log_scales, logits, covariances, opacities});
        benchmark::DoNotOptimize(covariances.data());
        benchmark::DoNotOptimize(dL_dquats.data());
    }
    const std::size_t numbers = backward ? 4 + 3 + 6 + 2 * 7 : 4 + 3 + 1 + 6 + 1;
    state.SetItemsProcessed(state.iterations() * std::int64_t(n * LaneTraits<T>::width));
    state.SetBytesProcessed(state.iterations() * std::int64_t(n * numbers * sizeof(T)));
}

template <class B, class T>
void covariance_and_opacity_forward(benchmark::State& state) {
    run<B, T>(state, false);
}
template <class B, class T>
void covariance_backward_only(benchmark::State& state) {
    run<B, T>(state, true);
}

BENCHMARK_TEMPLATE(covariance_and_opacity_forward, cpu::Serial, float)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(covariance_and_opacity_forward, cpu::Serial, Wide<float>)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(covariance_and_opacity_forward, cpu::Threads, float)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_TEMPLATE(covariance_backward_only, cpu::Serial, float)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(covariance_backward_only, cpu::Serial, Wide<float>)->Unit(benchmark::kMillisecond);
BENCHMARK_TEMPLATE(covariance_backward_only, cpu::Threads, float)->Unit(benchmark::kMillisecond)->UseRealTime();

} // namespace
