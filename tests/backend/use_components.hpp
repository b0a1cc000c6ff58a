// SPDX-License-Identifier: Apache-2.0
/// @file  Calls both passes of every component that needs overloads of its backend.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/field/hash_field.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/loss/photometric.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/gradient.hpp"
#include "support/skinned_scene.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::test {

template <class B>
void use_rasterizer(B& backend) {
    const Rasterizer<B> rasterizer(backend);
    typename Rasterizer<B>::Cache cache;
    Camera<float> camera;
    camera.width = 3, camera.height = 2;
    std::vector<float> pixels(18);
    const ImageView<float> image{pixels, 3, 2, 3};
    rasterizer.forward(camera, {}, {}, {.color = image}, cache);
    rasterizer.backward(camera, {}, {}, {.color = image}, cache, {});
}

template <class B>
void use_hash_grid(B& backend) {
    const HashGrid<2, 2> grid({.table_size = 64});
    const std::vector<vec3<float>> points(3, vec3<float>(0.5f));
    typename HashGrid<2, 2>::template Query<B> query;
    grid.prepare(backend, Span<const vec3<float>>(points), query);
    std::vector<float> table(grid.parameter_count()), features(12);
    grid.forward(backend, Span<const float>(table), query, row_major(Span<float>(features), 4));
    grid.backward(backend, row_major(Span<const float>(features), 4), query, Span<float>(table));
}

template <class B>
void use_field(B& backend) {
    using Field = HashField<2, 2>;
    const Field field({.table_size = 64}, {.outputs = 1, .width = 4});
    const std::vector<vec3<float>> points(3, vec3<float>(0.5f));
    typename Field::template Query<B> query;
    typename Field::template Cache<B> cache;
    field.prepare(backend, Span<const vec3<float>>(points), query);
    std::vector<float> table(field.table_parameter_count(query)), weights(field.mlp().parameter_count()), outputs(3);
    field.forward(backend, Span<const float>(table), Span<const float>(weights), query, Span<float>(outputs), cache);
    field.backward(backend, Span<const float>(weights), query, Span<const float>(outputs), cache, Span<float>(table),
                   Span<float>(weights));
}

template <class B>
void use_photometric_loss(B& backend) {
    std::vector<float> pixels(3 * 40 * 40, 0.5f);
    const ImageView<float> image{pixels, 3, 40, 40};
    const PhotometricLoss<B> loss(backend);
    typename PhotometricLoss<B>::Cache cache;
    loss.forward(image, image, cache);
    loss.backward(image, image, 1.0f, cache, image);
    (void)loss.values(cache);
}

template <class B>
void use_lpips(B& backend, const LpipsNetwork& network) {
    const std::vector<float> pixels(3 * 40 * 40, 0.5f);
    const ImageView<const float> image{pixels, 3, 40, 40};
    const Lpips<B> lpips(backend, network);
    (void)lpips.distance(image, image);
}

template <class B>
void use_adam(B& backend) {
    std::vector<float> p(6), g(6), m(6), v(6);
    const std::vector<std::uint32_t> rows{1};
    const Adam adam;
    adam.step(backend, Span<float>(p), Span<float>(g), Span<float>(m), Span<float>(v), 0.1, 1);
    adam.step_rows(backend, Span<float>(p), Span<float>(g), Span<float>(m), Span<float>(v), rows, 3, 0.1, 1);
    adam.step_columns(backend, Span<float>(p), Span<float>(g), Span<float>(m), Span<float>(v), 3, 1, 0.1, 0.2, 1);
}

template <class B>
void use_skinned_splats(B& backend) {
    for (const Deformation deformation : {Deformation::linear, Deformation::polar, Deformation::dual_quaternion}) {
        SkinnedScene<float> scene(2, 9, 9, 1), gradient = scene;
        SplatArrays<float> splats(2);
        const SkinnedSplats<B, 2> skin(backend, {.deformation = deformation});
        typename SkinnedSplats<B, 2>::Cache cache;
        skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
        skin.backward(scene.input(), scene.bones, scene.center[0], SplatView<const float>(splats.view()), cache,
                      gradient.view(), gradient.bones, gradient.center);
    }
}

template <class B>
void use_static_gaussians(B& backend) {
    const StaticSplats<B, 0> to_splats(backend);
    typename StaticSplats<B, 0>::Cache cache;
    std::vector<vec3<float>> dL_dcenter(1);
    to_splats.backward({}, vec3<float>(0), {}, cache, GaussiansView<float>{}, dL_dcenter);
}

template <class B>
void use_blend_shapes(B& backend) {
    const std::vector<vec3<double>> directions(4);
    const BlendShapes<B> shapes(backend, 2, {Span<const vec3<double>>(directions)});
    std::vector<float> coefficients(2);
    std::vector<vec3<float>> offsets(2);
    typename BlendShapes<B>::Workspace workspace;
    shapes.forward(coefficients, offsets);
    shapes.backward(offsets, coefficients, workspace);
}

template <class B>
void use_shadow_maps(B& backend) {
    const ShadowMaps<B> maps(backend);
    typename ShadowMaps<B>::Cache cache;
    const std::vector<vec3<float>> vertices{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, normals(3, vec3<float>(0, 0, 1));
    const std::vector<vec3<std::uint32_t>> triangles{{0, 1, 2}};
    const std::vector<ShadowCaster<float>> casters{{vertices, triangles}};
    std::vector<float> visibility(3);
    const LightView<const float> light{.directions = Span<const vec3<float>>(normals).subspan(0, 1)};
    maps.forward(casters, light, vertices, normals, visibility, cache);
}

template <class B>
void use_occlusion_field(B& backend) {
    OcclusionFieldData data{.width = 3, .hidden_layers = 1};
    data.neurons.resize(2 * 3), data.pose_weights.resize(3 * 9), data.weights.resize(data.network().parameter_count());
    const Skeleton<B> skeleton(backend, std::vector<int>{-1, 0});
    const OcclusionField<B> field(backend, data, 2, 2);
    std::vector<mat3<float>> rotations(2, mat3<float>(1.0f));
    std::vector<float> ao(2);
    typename OcclusionField<B>::Cache cache;
    field.forward(skeleton, rotations, ao, cache);
    field.backward(skeleton, ao, ao, cache, rotations);
    const Mlp network({.inputs = 2, .outputs = 1, .width = 3, .hidden_layers = 1});
    const std::vector<float> weights(network.parameter_count()), features(2);
    (void)bake_occlusion_field(backend, network, weights, row_major(Span<const float>(features), 1), 0, 1);
}

template <class B>
void use_lit_splats(B& backend) {
    const std::vector<std::array<int, 3>> triangles{{0, 1, 0}};
    const LitSplats<B> lit(backend, 2, triangles, std::vector<vec3<double>>(1));
    std::vector<vec3<float>> one(1), two(2);
    const std::vector<float> intensity(1), visibility(2);
    const LitSplatsInput<float> input{{.points = one, .log_intensities = intensity}, two, two, visibility, one, {}};
    typename LitSplats<B>::Cache cache;
    std::vector<vec3<float>> colors(1);
    lit.forward(input, colors, cache);
    lit.backward(input, colors, cache, {.normals = two});
}

} // namespace gsh::test
