// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of sampling 170,000 points on a mesh of SMPL-X's size, which is done once per avatar.
#include <gsh/body/surface_samples.hpp>

#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>

namespace gsh {
namespace {

/// A closed surface of 100 x 105 vertices with two joints.
BodyModel torus() {
    BodyModel model;
    constexpr int rings = 100, sides = 105;
    for (int r = 0; r < rings; ++r)
        for (int s = 0; s < sides; ++s) {
            const double a = 2 * std::numbers::pi * r / rings, b = 2 * std::numbers::pi * s / sides;
            const double radius = 0.6 + 0.25 * std::cos(b);
            model.v_template.push_back({radius * std::cos(a), 0.25 * std::sin(b), radius * std::sin(a)});
            const double w = 0.5 + 0.5 * std::cos(a);
            model.weights.push_back(w), model.weights.push_back(1 - w);
            const int i = r * sides + s, right = r * sides + (s + 1) % sides, up = (r + 1) % rings * sides + s,
                      both = (r + 1) % rings * sides + (s + 1) % sides;
            model.faces.push_back({i, right, both}), model.faces.push_back({i, both, up});
        }
    model.parents = {-1, 0};
    return model;
}

void sample(benchmark::State& state) {
    const BodyModel model = torus();
    const std::vector<double> K(model.vertex_count(), 15);
    for (auto _ : state)
        benchmark::DoNotOptimize(sample_surface(model, model.v_template, K, 1, {.total = 170000}));
    state.SetItemsProcessed(state.iterations() * 170000);
    state.SetBytesProcessed(state.iterations() * 170000 * static_cast<std::int64_t>(24 * 3 + 12 + 4 + 8 + 20));
}
BENCHMARK(sample)->Unit(benchmark::kMillisecond);

} // namespace
} // namespace gsh
