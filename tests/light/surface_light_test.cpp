// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <gsh/body/posed_surface.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/light/lit_splats.hpp>
#include <gsh/light/surface_light.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {
namespace {

/// A bent tube with Gaussians about its surface, under two points and three directions with gloss.
template <class T>
struct LitTube {
    BodyModel body = test::tube(4, 10, 8);
    std::vector<double> betas = {0.2, -0.3};
    SurfaceSamples samples = sample_surface(body, shaped_vertices(body, betas),
                                            std::vector<double>(body.vertex_count(), 0.4), 3);
    std::vector<Affine<T>> bones;
    std::vector<vec3<T>> offsets, normal_offsets, points, directions, means, base, center, dL_dmeans, dL_dcolors;
    std::vector<T> log_intensities, gloss{T(-1), T(1.5)};

    /// `bent`: with normal offsets.
    explicit LitTube(bool bent = false) {
        test::Rng rng(4);
        for (std::size_t j = 0; j < body.joint_count(); ++j) { // each bends on from the one before it, forwards
            const double angle = 0.7 * static_cast<double>(j), c = std::cos(angle), s = std::sin(angle);
            const double y = 0.4 * static_cast<double>(j);
            Affine<T> bone = Affine<T>::zero();
            bone.linear = mat3<T>(vec3<T>(T(1), T(0), T(0)), vec3<T>(T(0), T(c), T(s)), vec3<T>(T(0), T(-s), T(c)));
            bone.translation = vec3<T>(T(0), T(y * (1 - c)), T(-y * s));
            bones.push_back(bone);
        }
        const auto bring = [&](std::vector<vec3<T>>& to, std::size_t count, double low, double high) {
            for (std::size_t i = 0; i < count; ++i) to.push_back(vec3<T>(rng.vec(low, high)));
        };
        bring(offsets, body.vertex_count(), -0.01, 0.01);
        if (bent) bring(normal_offsets, body.vertex_count(), -0.4, 0.4);
        const LightData light = even_light(2, 3, {0, 0.8, 0}, 3);
        for (const auto& point : light.points) points.push_back(vec3<T>(point));
        for (const auto& direction : light.directions) directions.push_back(vec3<T>(direction));
        for (const double number : light.log_intensities) log_intensities.push_back(T(number + rng.uniform(-0.5, 0.5)));
        for (const auto& position : samples.positions) means.push_back(vec3<T>(position + rng.vec(-0.02, 0.02)));
        bring(base, means.size(), 0.1, 0.9);
        bring(dL_dmeans, means.size(), -1, 1);
        bring(dL_dcolors, means.size(), -1, 1);
        center.push_back(vec3<T>(T(0.5), T(1), T(3)));
    }
    LitSurface<T> posed() const { return {bones, offsets, normal_offsets}; }
    LightView<const T> light() const { return {points, directions, log_intensities, gloss}; }
    template <class B>
    SurfaceLight<B, T> shade(B& backend, const SurfaceLightParams& params = {}) const {
        return SurfaceLight<B, T>(backend, body, betas, samples.triangles, samples.barycentric, params);
    }
    /// The same tube at another place, as a caster.
    std::vector<Affine<T>> moved(const vec3<T>& by) const {
        std::vector<Affine<T>> result = bones;
        for (Affine<T>& bone : result) bone.translation += by;
        return result;
    }
};

/// What backward adds to, and what it writes.
template <class T>
struct LitTubeGradient {
    std::vector<Affine<T>> bones;
    std::vector<vec3<T>> offsets, normal_offsets, points, center, base;
    std::vector<T> log_intensities, gloss;

    explicit LitTubeGradient(const LitTube<T>& tube)
        : bones(tube.bones.size(), Affine<T>::zero()), offsets(tube.offsets.size(), vec3<T>(T(0))),
          normal_offsets(tube.normal_offsets.size(), vec3<T>(T(0))), points(tube.points.size(), vec3<T>(T(0))),
          center(1, vec3<T>(T(0))), log_intensities(tube.log_intensities.size(), T(0)), gloss(2, T(0)) {}

    template <class B>
    void add(const LitTube<T>& tube, const SurfaceLight<B, T>& light, typename SurfaceLight<B, T>::Cache& cache) {
        light.backward(tube.posed(), tube.light(), tube.center[0], tube.dL_dcolors, cache,
                       {.light = {points, {}, log_intensities, gloss},
                        .bones = bones,
                        .offsets = offsets,
                        .normal_offsets = normal_offsets,
                        .center = center});
        base.assign(cache.dL_dbase.begin(), cache.dL_dbase.end());
    }
};

template <class B, class T>
std::vector<vec3<T>> lit_colors(const LitTube<T>& tube, const SurfaceLight<B, T>& light,
                                typename SurfaceLight<B, T>::Cache& cache,
                                const std::vector<ShadowCaster<T>>& others = {}) {
    std::vector<vec3<T>> colors(tube.base.size());
    cache.base.resize(tube.base.size());
    std::copy(tube.base.begin(), tube.base.end(), cache.base.data());
    light.forward(tube.posed(), tube.light(), others, tube.center[0], colors, cache);
    return colors;
}

} // namespace

TEST_CASE("SurfaceLight is its parts, and its adjoint their gradient with visibility held constant") {
    cpu::Serial backend;
    for (const auto& [shadows, bent] : {std::pair(true, false), {false, false}, {true, true}}) {
        CAPTURE(shadows);
        CAPTURE(bent);
        LitTube<double> tube(bent);
        const auto light = tube.shade(backend, {.shadows = shadows, .clamping = ColorClamp::below});
        SurfaceLight<cpu::Serial, double>::Cache cache;
        const auto colors = lit_colors(tube, light, cache);
        const std::vector<double> visibility(cache.visibility.begin(), cache.visibility.end());
        const auto partly =
            std::count_if(visibility.begin(), visibility.end(), [](double v) { return v > 0 && v < 1; });
        const auto dark = std::count(visibility.begin(), visibility.end(), 0.0);
        CHECK((partly > 5) == shadows);
        CHECK((dark > 50) == shadows);

        const PosedSurface<cpu::Serial, double> surface(backend, tube.body, tube.betas);
        const LitSplats<cpu::Serial, double> lit(backend, tube.body.vertex_count(), tube.samples.triangles,
                                                 tube.samples.barycentric);
        PosedSurface<cpu::Serial, double>::Cache posed;
        LitSplats<cpu::Serial, double>::Cache lit_cache;
        std::vector<vec3<double>> found(colors.size());
        const auto loss = [&] {
            surface.forward(tube.bones, tube.offsets, posed);
            std::vector<vec3<double>> normals(posed.normals.begin(), posed.normals.end());
            if (bent) surface.offset_normals(tube.bones, tube.normal_offsets, posed, normals);
            lit.forward({tube.light(), posed.vertices, normals, visibility, tube.base, tube.center[0]}, found, lit_cache);
            double sum = 0;
            for (std::size_t i = 0; i < found.size(); ++i) sum += dot(found[i], tube.dL_dcolors[i]);
            return sum;
        };
        loss();
        CHECK(found == colors);

        LitTubeGradient<double> gradient(tube);
        gradient.add(tube, light, cache);
        const LitTubeGradient<double> once = gradient;
        const auto check = [&](auto& values, auto& dL_dvalues, std::size_t stride = 1) {
            test::check_gradient(loss, test::scalars(values), test::scalars(dL_dvalues), {.stride = stride});
        };
        check(tube.bones, gradient.bones);
        check(tube.offsets, gradient.offsets, 11);
        if (bent) check(tube.normal_offsets, gradient.normal_offsets, 11);
        check(tube.points, gradient.points);
        check(tube.log_intensities, gradient.log_intensities);
        check(tube.gloss, gradient.gloss);
        check(tube.center, gradient.center);
        check(tube.base, gradient.base, 7);

        gradient.add(tube, light, cache);
        CHECK(gradient.base == once.base); // written, all else is added
        for (std::size_t j = 0; j < once.bones.size(); ++j)
            CHECK(length(gradient.bones[j].translation - 2.0 * once.bones[j].translation) < 1e-12);
        for (std::size_t v = 0; v < once.offsets.size(); ++v)
            CHECK(length(gradient.offsets[v] - 2.0 * once.offsets[v]) < 1e-12);
        for (std::size_t k = 0; k < once.log_intensities.size(); ++k)
            CHECK(gradient.log_intensities[k] == doctest::Approx(2 * once.log_intensities[k]));
    }
}

TEST_CASE("a gradient that nobody asks for is not computed and changes no other") {
    cpu::Serial backend;
    const LitTube<double> tube;
    const auto light = tube.shade(backend);
    SurfaceLight<cpu::Serial, double>::Cache cache;
    (void)lit_colors(tube, light, cache);
    LitTubeGradient<double> all(tube);
    all.add(tube, light, cache);
    light.backward(tube.posed(), tube.light(), tube.center[0], tube.dL_dcolors, cache, {});
    CHECK(std::equal(all.base.begin(), all.base.end(), cache.dL_dbase.begin()));
    std::vector<Affine<double>> bones(tube.bones.size(), Affine<double>::zero());
    light.backward(tube.posed(), tube.light(), tube.center[0], tube.dL_dcolors, cache, {.bones = bones});
    for (std::size_t j = 0; j < bones.size(); ++j) CHECK(bones[j].translation == all.bones[j].translation);
}

TEST_CASE("SurfaceLight is the same on threads bit for bit") {
    const LitTube<float> tube(true);
    cpu::Serial serial;
    const auto expected_light = tube.shade(serial);
    SurfaceLight<cpu::Serial>::Cache expected_cache;
    const auto expected = lit_colors(tube, expected_light, expected_cache);
    LitTubeGradient<float> expected_gradient(tube);
    expected_gradient.add(tube, expected_light, expected_cache);
    for (const unsigned threads : {1u, 3u}) {
        cpu::Threads backend(threads);
        const auto light = tube.shade(backend);
        SurfaceLight<cpu::Threads>::Cache cache;
        CHECK(lit_colors(tube, light, cache) == expected);
        LitTubeGradient<float> gradient(tube);
        gradient.add(tube, light, cache);
        CHECK(gradient.offsets == expected_gradient.offsets);
        CHECK(gradient.normal_offsets == expected_gradient.normal_offsets);
        CHECK(gradient.points == expected_gradient.points);
        CHECK(gradient.log_intensities == expected_gradient.log_intensities);
        CHECK(gradient.gloss == expected_gradient.gloss);
        CHECK(gradient.center == expected_gradient.center);
        CHECK(gradient.base == expected_gradient.base);
        for (std::size_t j = 0; j < gradient.bones.size(); ++j) {
            CHECK(gradient.bones[j].linear == expected_gradient.bones[j].linear);
            CHECK(gradient.bones[j].translation == expected_gradient.bones[j].translation);
        }
    }
}

TEST_CASE("another body between a light and this one darkens it, and brightens nothing") {
    cpu::Serial backend;
    LitTube<double> tube;
    tube.points = {{0, 0.8, 3}}, tube.directions.clear(), tube.log_intensities = {2.2};
    tube.gloss.clear();
    const auto light = tube.shade(backend);
    SurfaceLight<cpu::Serial, double>::Cache cache, other;
    const auto alone = lit_colors(tube, light, cache);
    // 1.2 m nearer to the light; then beyond this body, where it hides nothing from it
    const auto near_bones = tube.moved({0, 0, 1.2}), far_bones = tube.moved({0, 0, -3});
    const auto near = light.caster({near_bones, tube.offsets}, other);
    const auto hidden = lit_colors(tube, light, cache, {near});
    SurfaceLight<cpu::Serial, double>::Cache far_cache;
    const auto far = light.caster({far_bones, tube.offsets}, far_cache);
    const auto behind = lit_colors(tube, light, cache, {far});
    double of_alone = 0, of_hidden = 0, of_behind = 0;
    for (std::size_t i = 0; i < alone.size(); ++i) {
        of_alone += alone[i].y, of_hidden += hidden[i].y, of_behind += behind[i].y;
        CHECK(hidden[i].y <= alone[i].y + 0.05); // the map that covers both bodies is coarser
    }
    CHECK(of_hidden < 0.6 * of_alone);
    CHECK(of_behind == doctest::Approx(of_alone).epsilon(0.03));
    // Without shadows nobody hides anything.
    const auto open = tube.shade(backend, {.shadows = false});
    CHECK(lit_colors(tube, open, cache, {near}) == lit_colors(tube, open, other));
}

TEST_CASE("a body without triangles, and arguments of another size, are refused") {
    cpu::Serial backend;
    LitTube<double> tube;
    const auto light = tube.shade(backend);
    SurfaceLight<cpu::Serial, double>::Cache cache;
    std::vector<vec3<double>> colors = tube.base;
    const std::vector<vec3<double>> fewer(tube.offsets.begin(), tube.offsets.end() - 1);
    CHECK_THROWS_AS(light.forward({tube.bones, fewer}, tube.light(), {}, tube.center[0], colors, cache),
                    ShapeError);
    CHECK_THROWS_AS(light.forward({tube.bones, tube.offsets, fewer}, tube.light(), {}, tube.center[0], colors, cache),
                    ShapeError);
    colors.pop_back();
    CHECK_THROWS_AS(light.forward(tube.posed(), tube.light(), {}, tube.center[0], colors, cache),
                    ShapeError);
    tube.body.faces.clear();
    CHECK_THROWS_AS((void)tube.shade(backend), ValueError);
}

} // namespace gsh
