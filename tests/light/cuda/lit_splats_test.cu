// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians under a light on a GPU agree with the host, forward and backward.
#include <gsh/light/cuda/lit_splats.cuh>
#include <gsh/light/lit_splats.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/lit_scene.hpp"
#include "support/plain_backend.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh::lit_splats_on_device {
namespace {

using cuda::Device;

struct Case {
    std::size_t count = 90, points = 4, directions = 12, vertices = 50;
    bool glossy = true;
    ColorClamp clamping = ColorClamp::below;
    bool light = true, center = true, vertices_too = true;
    int passes = 1;      ///< backward is called so often
    bool broken = false; ///< an unseen vertex has numbers that are not finite
};

template <class T>
struct Result {
    std::vector<T> colors, base, vertices, light, center;
    std::vector<std::size_t> sizes_in_vertices, sizes_in_light; ///< of the arrays that follow each other there
};

template <class T>
struct Inputs {
    test::LitScene<T> scene;
    std::vector<vec3<T>> dL_dcolors;

    explicit Inputs(const Case& c)
        : scene(c.count, c.points, c.directions, c.glossy, 5, c.vertices),
          dL_dcolors(test::color_gradient<T>(c.count, 6)) {
        for (std::size_t i = 0; i < c.count; ++i) {
            // Some Gaussians are not seen, nor some vertices, of which some fill whole warps.
            if (i % 3 == 1) dL_dcolors[i] = vec3<T>(T(0));
            for (int& v : scene.triangles[i])
                if (v == 1 || (v >= 64 && v < 160)) v = 0;
        }
        if (c.broken) scene.vertices[1] = scene.normals[1] = vec3<T>(std::numeric_limits<T>::quiet_NaN());
    }
};

template <class T, class B>
Result<T> run(B& backend, const Case& c, const Inputs<T>& inputs) {
    const auto& [scene, dL_dcolors] = inputs;
    auto zero = scene;
    zero.clear();
    const auto bring = [&](const auto& host) { return uploaded(backend, host); };
    const LitSplats<B, T> lit(backend, scene.V, scene.triangles, scene.barycentric, c.clamping);
    const auto points = bring(scene.points), directions = bring(scene.directions), vertices = bring(scene.vertices),
               base = bring(scene.base), normals = bring(scene.normals), gradient = bring(dL_dcolors);
    const auto log_intensities = bring(scene.log_intensities), gloss = bring(scene.gloss),
               visibility = bring(scene.visibility);
    const LitSplatsInput<T> input{
        {points, directions, log_intensities, gloss}, vertices, normals, visibility, base, scene.center[0]};
    typename LitSplats<B, T>::Cache cache;
    auto colors = bring(zero.base);
    lit.forward(input, colors, cache);

    auto d_points = bring(zero.points), d_vertices = bring(zero.vertices), d_base = bring(zero.base),
         d_normals = bring(zero.normals), d_center = bring(zero.center);
    auto d_log_intensities = bring(zero.log_intensities), d_gloss = bring(zero.gloss);
    LitSplatsGradient<T> dL_din{{d_points, {}, d_log_intensities, d_gloss}, d_vertices, d_normals, d_base, d_center};
    if (!c.light) dL_din.light = {};
    if (!c.center) dL_din.center = {};
    if (!c.vertices_too) dL_din.vertices = {}, dL_din.normals = {};
    for (int pass = 0; pass < c.passes; ++pass) lit.backward(input, gradient, cache, dL_din);

    Result<T> result;
    const auto append = [&](std::vector<T>& to, const auto& buffer) {
        const auto values = test::fetched(backend, buffer);
        const T* const first = reinterpret_cast<const T*>(values.data());
        to.insert(to.end(), first, first + values.size() * sizeof(values[0]) / sizeof(T));
    };
    append(result.colors, colors), append(result.base, d_base), append(result.center, d_center);
    append(result.vertices, d_vertices), append(result.vertices, d_normals);
    append(result.light, d_points), append(result.light, d_log_intensities), append(result.light, d_gloss);
    result.sizes_in_vertices = {3 * d_vertices.size(), 3 * d_normals.size()};
    result.sizes_in_light = {3 * d_points.size(), d_log_intensities.size(), d_gloss.size()};
    return result;
}

template <class T, class B>
Result<T> run(B& backend, const Case& c) {
    return run(backend, c, Inputs<T>(c));
}

template <class T>
double distance(const std::vector<T>& a, const std::vector<T>& b) {
    return test::relative_distance({a.begin(), a.end()}, {b.begin(), b.end()});
}

template <class T>
void check_near(const Result<T>& found, const Result<T>& expected, double tolerance) {
    CHECK(distance(found.colors, expected.colors) < tolerance);
    CHECK(distance(found.base, expected.base) < tolerance);
    CHECK(test::largest_distance(found.vertices, expected.vertices, expected.sizes_in_vertices) < tolerance);
    CHECK(test::largest_distance(found.light, expected.light, expected.sizes_in_light) < tolerance);
    CHECK(distance(found.center, expected.center) < tolerance);
}

template <class T>
void compare(const Case& c) {
    CAPTURE(c.count);
    CAPTURE(c.vertices);
    CAPTURE(c.points);
    CAPTURE(c.directions);
    CAPTURE(c.glossy);
    Device device;
    const Result<T> found = run<T>(device, c);
    test::with_references([&](auto& backend) { check_near(found, run<T>(backend, c), sizeof(T) == 8 ? 1e-10 : 1e-4); });
}

TEST_CASE("shading agrees with the host for every number of Gaussians and vertices") {
    if (test::skip_without_device()) return;
    for (const std::size_t count : {0u, 1u, 31u, 32u, 33u, 63u, 64u, 65u, 257u}) {
        compare<float>({.count = count});
        compare<double>({.count = count});
        if (count > 0) compare<double>({.count = 300, .vertices = count});
    }
}

TEST_CASE("shading agrees for every kind of light, and where colours end at one") {
    if (test::skip_without_device()) return;
    for (const auto& [points, directions] :
         {std::pair(3u, 0u), std::pair(0u, 7u), std::pair(1u, 1u), std::pair(0u, 0u), std::pair(5u, 40u)})
        for (const bool glossy : {true, false})
            for (const ColorClamp clamping : {ColorClamp::below, ColorClamp::both})
                compare<double>({.points = points, .directions = directions, .glossy = glossy, .clamping = clamping});
}

TEST_CASE("backward under a light is the gradient of shading") {
    if (test::skip_without_device()) return;
    Device device;
    Case c{.count = 40}, forward{.count = 40, .passes = 0};
    Inputs<double> inputs(c);
    const Result<double> gradient = run(device, c, inputs);
    const auto loss = [&] {
        return test::inner(run(device, forward, inputs).colors, test::numbers<double>(inputs.dL_dcolors));
    };
    // Two lists one after the other, as the result has them.
    const auto check = [&](Span<double> values, const std::vector<double>& all, std::size_t first, std::size_t stride) {
        test::check_gradient(loss, values, Span<const double>(all).subspan(first, values.size()), {.stride = stride});
        return first + values.size();
    };
    auto& scene = inputs.scene;
    check(test::scalars(scene.base), gradient.base, 0, 5);
    check(test::scalars(scene.center), gradient.center, 0, 1);
    const std::size_t normals = check(test::scalars(scene.vertices), gradient.vertices, 0, 7);
    check(test::scalars(scene.normals), gradient.vertices, normals, 7);
    std::size_t next = check(test::scalars(scene.points), gradient.light, 0, 1);
    next = check(scene.log_intensities, gradient.light, next, 1);
    CHECK(check(scene.gloss, gradient.light, next, 1) == gradient.light.size());
}

TEST_CASE("backward under a light adds, and leaves alone what nobody asks for") {
    if (test::skip_without_device()) return;
    Device device;
    const Result<double> two = run<double>(device, {.passes = 2}), one = run<double>(device, {});
    Result<double> doubled = one;
    for (auto* values : {&doubled.base, &doubled.vertices, &doubled.light, &doubled.center})
        for (double& x : *values) x *= 2;
    check_near(two, doubled, 1e-15);
    const Result<double> some = run<double>(device, {.light = false, .center = false, .vertices_too = false});
    CHECK(some.base == one.base);
    for (const auto* values : {&some.light, &some.center, &some.vertices})
        CHECK(std::all_of(values->begin(), values->end(), [](double x) { return x == 0; }));
    const Result<double> light = run<double>(device, {.center = false, .vertices_too = false});
    CHECK(light.light == one.light);
}

TEST_CASE("a vertex that nobody sees does not spoil the sums") {
    if (test::skip_without_device()) return;
    Device device;
    const Result<double> found = run<double>(device, {.broken = true}), whole = run<double>(device, {});
    CHECK(found.light == whole.light);
    CHECK(found.center == whole.center);
    CHECK(found.vertices == whole.vertices);
}

TEST_CASE("sums of a light are those of all warps, for more warps than threads join them") {
    if (test::skip_without_device()) return;
    using Join = cuda::detail::JoinLight<double>;
    const std::size_t warps = 2 * Join::block_size + 33, points = 2, lights = 5;
    const cuda::detail::LightSumPlaces places(points, lights);
    const std::vector<double> sums = test::Rng(3).numbers(places.size * warps);
    std::vector<double> expected(places.size, 1);
    for (std::size_t k = 0; k < places.size; ++k)
        for (std::size_t w = 0; w < warps; ++w) expected[k] += sums[k * warps + w];
    Device device;
    const auto from = uploaded(device, sums);
    auto to = uploaded(device, std::vector<double>(places.size, 1));
    const Span<double> all = to;
    device.launch(places.size, Join{from,
                                    warps,
                                    points,
                                    lights,
                                    {view_as<vec3<double>>(all.subspan(0, 3 * points)),
                                     {},
                                     all.subspan(places.log_intensities, lights),
                                     all.subspan(places.gloss, 2)},
                                    view_as<vec3<double>>(all.subspan(places.center, 3))});
    CHECK(test::relative_distance(test::fetched(device, to), expected) < 1e-14);
}

TEST_CASE("shading has the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    test::in_every_order(
        [] {
            Device device;
            return run<float>(device, {.count = 700, .vertices = 300});
        },
        [](const Result<float>& found, const Result<float>& expected) {
            CHECK(test::same_bits(found.colors, expected.colors));
            CHECK(test::same_bits(found.base, expected.base));
            CHECK(test::same_bits(found.vertices, expected.vertices));
            CHECK(test::same_bits(found.light, expected.light));
            CHECK(test::same_bits(found.center, expected.center));
        });
}

} // namespace
} // namespace gsh::lit_splats_on_device
