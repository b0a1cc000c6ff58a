// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/loss/lpips.hpp>

#include <benchmark/benchmark.h>

#include <cmath>

using namespace gsh;

namespace {

/// Random weights; the time does not depend on the values of the weights.
LpipsNetwork with_random_weights(LpipsNetwork network) {
    Rng rng(1);
    std::size_t inputs = 3;
    const auto numbers = [&](std::size_t count, double low, double high) {
        std::vector<float> values(count);
        for (float& x : values) x = float(low + (high - low) * rng.uniform());
        return values;
    };
    for (const LpipsStep& step : network.steps) {
        if (step.is_convolution()) {
            const std::size_t fan_in = inputs * std::size_t(step.kernel * step.kernel);
            const double amplitude = std::sqrt(6 / double(fan_in));
            inputs = std::size_t(step.channels);
            network.convolutions.push_back(
                {numbers(inputs * fan_in, -amplitude, amplitude), numbers(inputs, -0.1, 0.1)});
        }
        if (step.compared) network.lins.push_back(numbers(inputs, 0, 1));
    }
    return network;
}

/// The number of multiply-adds of one forward pass.
double work(const LpipsNetwork& network, int side) {
    double sum = 0, inputs = 3;
    for (const LpipsStep& step : network.steps) {
        side = step.output(side);
        if (!step.is_convolution()) continue;
        sum += double(side) * side * step.channels * step.kernel * step.kernel * inputs;
        inputs = step.channels;
    }
    return sum;
}

/// Compares one image of side range(0) with stored features, as in an evaluation of many configurations.
template <class B>
void forward_distance(benchmark::State& state, const LpipsNetwork& structure) {
    const LpipsNetwork network = with_random_weights(structure);
    const int side = int(state.range(0));
    Image<float> image(3, side, side), truth = image;
    Rng rng(2);
    for (float& x : image.data) x = float(rng.uniform());
    for (float& x : truth.data) x = float(rng.uniform());
    B backend;
    const Lpips<B> lpips(backend, network);
    typename Lpips<B>::Features features, wanted;
    lpips.forward(truth.view(), wanted);
    for (auto _ : state) {
        lpips.forward(image.view(), features);
        benchmark::DoNotOptimize(lpips.distance(features, wanted));
    }
    state.SetItemsProcessed(state.iterations() * std::int64_t(image.data.size()));
    state.counters["flop/s"] = {2.0 * work(network, side), benchmark::Counter::kIsIterationInvariantRate};
}

void alexnet_serial(benchmark::State& state) { forward_distance<cpu::Serial>(state, lpips_alexnet()); }
void alexnet_threads(benchmark::State& state) { forward_distance<cpu::Threads>(state, lpips_alexnet()); }
void vgg16_serial(benchmark::State& state) { forward_distance<cpu::Serial>(state, lpips_vgg16()); }
BENCHMARK(alexnet_serial)->Arg(540)->Unit(benchmark::kMillisecond);
BENCHMARK(alexnet_threads)->Arg(540)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(vgg16_serial)->Arg(540)->Unit(benchmark::kMillisecond);

} // namespace
