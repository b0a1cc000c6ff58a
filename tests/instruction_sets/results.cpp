// SPDX-License-Identifier: Apache-2.0
/// @file  Compiled once for each instruction set. GSH_TEST_RESULTS is the name of its only public function.

#include "instruction_sets/results.hpp"

#include "support/skinned_scene.hpp"

#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/config.hpp>
#include <gsh/cpu.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/render/rasterizer.hpp>

#include <utility>

// Internal linkage, so each unit has its own helpers.
namespace {

using namespace gsh;

void append(std::vector<double>& to, Span<const float> values) {
    to.insert(to.end(), values.begin(), values.end());
}
template <class V>
void append_all(std::vector<double>& to, const std::vector<V>& values) {
    append(to, {reinterpret_cast<const float*>(values.data()), values.size() * sizeof(V) / sizeof(float)});
}

std::vector<double> posed() {
    constexpr std::size_t count = 37, basis = 9; // not a multiple of any register's width
    test::SkinnedScene<float> scene(count, basis, basis, 5), gradient(count, basis, basis, 6);
    test::SplatArrays<float> splats(count);
    const test::SplatArrays<float> dL_dsplats(count, 7);
    gradient.clear();
    cpu::Serial backend;
    const SkinnedSplats<cpu::Serial, 2> skin(backend);
    SkinnedSplats<cpu::Serial, 2>::Cache cache;
    skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                  gradient.bones, gradient.center);
    std::vector<double> all;
    append_all(all, splats.means), append_all(all, splats.covariances), append_all(all, splats.colors);
    append_all(all, gradient.means), append_all(all, gradient.quats), append_all(all, gradient.sh);
    append_all(all, gradient.bones), append_all(all, gradient.center);
    return all;
}

std::vector<double> field() {
    constexpr std::size_t count = 301;
    using Field = HashField<4, 2>;
    const Field hash_field({.base = 4, .growth = 2, .table_size = 1024},
                           {.outputs = 5, .width = 20, .hidden_layers = 2});
    cpu::Serial backend;
    test::Rng rng(11);
    std::vector<vec3<float>> points;
    for (const auto& point : rng.vecs(count, 0, 1)) points.push_back(vec3<float>(point));
    std::vector<float> table, weights = hash_field.mlp().initial_weights<float>(3), outputs(5 * count), dL_doutputs;
    for (const double x : rng.numbers(hash_field.grid().parameter_count())) table.push_back(static_cast<float>(x));
    for (const double x : rng.numbers(outputs.size())) dL_doutputs.push_back(static_cast<float>(x));
    std::vector<float> dL_dtable(table.size()), dL_dweights(weights.size());
    Field::Query<cpu::Serial, float> query;
    Field::Cache<cpu::Serial, float> cache;
    hash_field.prepare(backend, points, query);
    hash_field.forward(backend, table, weights, query, outputs, cache);
    hash_field.backward(backend, weights, query, dL_doutputs, cache, dL_dtable, dL_dweights);
    std::vector<double> all;
    append(all, outputs), append(all, dL_dtable), append(all, dL_dweights);
    return all;
}

std::vector<double> rasterized() {
    constexpr std::size_t count = 60;
    constexpr int size = 40;
    test::Rng rng(13);
    std::vector<vec3<float>> means, colors;
    std::vector<sym3<float>> covariances;
    std::vector<float> opacities;
    for (std::size_t i = 0; i < count; ++i) {
        means.push_back(vec3<float>(rng.vec(-0.5, 0.5))), colors.push_back(vec3<float>(rng.vec(0, 1)));
        covariances.push_back({0.01f, 0.001f, 0.0f, 0.008f, -0.001f, 0.012f});
        opacities.push_back(static_cast<float>(rng.uniform(0.2, 0.9)));
    }
    const SplatView<const float> splats{means, covariances, opacities, colors};
    std::vector<float> color(3 * size * size), dL_dcolor;
    for (const double x : rng.numbers(color.size())) dL_dcolor.push_back(static_cast<float>(x));
    std::vector<vec3<float>> dL_dmeans(count, vec3<float>(0)), dL_dcolors(count, vec3<float>(0));
    cpu::Serial backend;
    const Rasterizer<cpu::Serial> rasterizer(backend);
    Rasterizer<cpu::Serial>::Cache cache;
    const Camera<float> camera = look_at<double>({0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.6, size, size).cast<float>();
    rasterizer.forward(camera, splats, {}, {.color = {color, 3, size, size}}, cache);
    rasterizer.backward(camera, splats, {}, {.color = {dL_dcolor, 3, size, size}}, cache,
                        {.means = dL_dmeans, .covariances = {}, .opacities = {}, .colors = dL_dcolors});
    std::vector<double> all;
    append(all, color), append_all(all, dL_dmeans), append_all(all, dL_dcolors);
    return all;
}

} // namespace

gsh::test::SetResults gsh::test::GSH_TEST_RESULTS() {
    return {GSH_TEXT(GSH_ISA), GSH_VECTOR_BYTES, posed(), field(), rasterized()};
}
