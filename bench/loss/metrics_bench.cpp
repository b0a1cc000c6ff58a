// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/rng.hpp>
#include <gsh/loss/metrics.hpp>

#include <benchmark/benchmark.h>

using namespace gsh;

namespace {

Image<float> random_image(std::uint64_t seed) {
    Image<float> image(3, 540, 540);
    Rng rng(seed);
    for (float& x : image.data) x = float(rng.uniform());
    return image;
}

void psnr_540(benchmark::State& state) {
    const auto a = random_image(1), b = random_image(2);
    for (auto _ : state) benchmark::DoNotOptimize(psnr(a.view(), b.view()));
    state.SetItemsProcessed(state.iterations() * std::int64_t(a.data.size()));
    state.SetBytesProcessed(state.iterations() * std::int64_t(a.data.size() * 8));
}
BENCHMARK(psnr_540)->Unit(benchmark::kMillisecond);

void ssim_540(benchmark::State& state) {
    const auto a = random_image(1), b = random_image(2);
    for (auto _ : state) benchmark::DoNotOptimize(ssim(a.view(), b.view()));
    state.SetItemsProcessed(state.iterations() * std::int64_t(a.data.size()));
    state.SetBytesProcessed(state.iterations() * std::int64_t(a.data.size() * 8));
}
BENCHMARK(ssim_540)->Unit(benchmark::kMillisecond);

} // namespace
