// SPDX-License-Identifier: Apache-2.0
/// @file  Shadow maps on a GPU agree with the host's, with casters of every size and in any order of blocks.
#include <gsh/light/cuda/shadow_map.cuh>
#include <gsh/light/shadow_map.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/lit_sphere.hpp"
#include "support/plain_backend.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh::shadow_map_on_device {
namespace {

using cuda::Device;

template <class T>
struct Scene {
    std::vector<test::LitMesh<T>> casters;
    std::vector<vec3<T>> points, directions;
    test::LitMesh<T> receiver;
    ShadowMapParams params;

    explicit Scene(std::size_t rings, bool closed = true, std::size_t lights = 3) {
        params = {.point_resolution = 40, .direction_resolution = 33, .closed = closed};
        test::Rng rng(2);
        for (std::size_t l = 0; l < lights; ++l) {
            points.push_back(vec3<T>(normalize(rng.vec()) * rng.uniform(1.5, 3)));
            directions.push_back(vec3<T>(normalize(rng.vec())));
        }
        casters.push_back(test::sphere<T>(vec3<T>(T(0), T(0), T(0)), 0.3, rings));
        casters.push_back(test::sphere<T>(vec3<T>(T(0.2), T(0.6), T(0.1)), 0.2, rings));
        receiver = casters.front();
    }
};

template <class T>
struct Result {
    std::vector<T> visibility, texels; // of the maps, within their frames
};

template <class T, class B>
Result<T> run(B& backend, const Scene<T>& scene) {
    const auto bring = [&](const auto& host) { return uploaded(backend, host); };
    std::vector<decltype(bring(scene.points))> vertices;
    std::vector<decltype(bring(scene.receiver.triangles))> triangles;
    for (const auto& caster : scene.casters)
        vertices.push_back(bring(caster.vertices)), triangles.push_back(bring(caster.triangles));
    std::vector<ShadowCaster<T>> casters;
    for (std::size_t c = 0; c < vertices.size(); ++c) casters.push_back({vertices[c], triangles[c]});
    const auto points = bring(scene.points), directions = bring(scene.directions), at = bring(scene.receiver.vertices),
               normals = bring(scene.receiver.normals);
    const std::size_t L = scene.points.size() + scene.directions.size();
    typename B::template Buffer<T> visibility(scene.receiver.vertices.size() * L);
    const ShadowMaps<B, T> maps(backend, scene.params);
    typename ShadowMaps<B, T>::Cache cache;
    maps.forward(casters, LightView<const T>{.points = points, .directions = directions}, at, normals, visibility,
                 cache);
    Result<T> result{test::fetched(backend, visibility), {}};
    const auto all = test::fetched(backend, cache.maps);
    for (const ShadowFrame<T>& frame : test::fetched(backend, cache.frames))
        for (int row = 0; row < frame.height; ++row)
            for (int column = 0; column < frame.width; ++column)
                result.texels.push_back(all[frame.begin + static_cast<std::size_t>(row * frame.stride + column)]);
    return result;
}

/// In the emulation, the bits of the host. On a GPU, products are fused with sums: a vertex may be rounded to the next
/// sixteenth of a texel, and single texels at the edge of a triangle may differ.
template <class T>
void check_same(const Result<T>& found, const Result<T>& expected) {
#if defined(GSH_CUDA_EMULATION)
    CHECK(found.texels == expected.texels);
    CHECK(found.visibility == expected.visibility);
#else
    REQUIRE(found.visibility.size() == expected.visibility.size());
    std::size_t differ = 0;
    for (std::size_t i = 0; i < found.visibility.size(); ++i)
        differ += !(std::abs(found.visibility[i] - expected.visibility[i]) < T(1e-4));
    CHECK(differ <= found.visibility.size() / 100);
#endif
}

template <class T>
void compare(const Scene<T>& scene) {
    Device device;
    const Result<T> found = run<T>(device, scene);
    test::with_references([&](auto& backend) { check_same(found, run<T>(backend, scene)); });
}

TEST_CASE("maps and visibility agree with the host's for fine and coarse casters, closed and open") {
    if (test::skip_without_device()) return;
    for (const std::size_t rings : {2u, 5u, 24u}) // a triangle covers hundreds of texels, and less than one
        for (const bool closed : {true, false}) {
            CAPTURE(rings);
            CAPTURE(closed);
            compare(Scene<float>(rings, closed));
            compare(Scene<double>(rings, closed));
        }
}

TEST_CASE("a caster hides its far side from a light, and not its near side") {
    if (test::skip_without_device()) return;
    Device device;
    Scene<float> scene(20);
    scene.casters.resize(1), scene.points.clear(), scene.directions = {vec3<float>(0, 1, 0)};
    const Result<float> found = run<float>(device, scene);
    CHECK(found.visibility.front() == 1); // the upper pole
    CHECK(found.visibility.back() == 0);
    CHECK(*std::max_element(found.texels.begin(), found.texels.end()) > -1);
    CHECK(found.texels.front() == -1e30f); // the margin
}

TEST_CASE("maps agree with points or directions alone, and without casters, triangles, lights or receivers") {
    if (test::skip_without_device()) return;
    const Scene<double> scene(6);
    for (int fault = 0; fault < 6; ++fault) {
        CAPTURE(fault);
        Scene<double> some = scene;
        if (fault == 0) some.points.clear();
        if (fault == 1) some.directions.clear();
        if (fault == 2) some.points.clear(), some.directions.clear();
        if (fault == 3) some.casters.clear();
        if (fault == 4) some.casters[0].triangles.clear(), some.casters[1] = {};
        if (fault == 5) some.receiver = {};
        compare(some);
    }
}

TEST_CASE("maps agree for numbers of vertices and triangles about the size of a block") {
    if (test::skip_without_device()) return;
    const Scene<float> scene(8);
    for (const std::size_t count : {1u, 31u, 32u, 33u, 63u, 64u, 65u, 127u, 128u, 129u}) {
        CAPTURE(count);
        Scene<float> some = scene;
        some.casters.resize(1);
        some.casters[0].triangles.resize(count);
        some.receiver.vertices.resize(count), some.receiver.normals.resize(count);
        compare(some);
        Scene<float> soup = some; // triangles at random vertices, as many as there are triangles
        test::Rng rng(count);
        soup.casters[0].vertices.clear();
        for (std::size_t v = 0; v < count; ++v) soup.casters[0].vertices.push_back(vec3<float>(rng.vec(-0.3, 0.3)));
        for (auto& t : soup.casters[0].triangles)
            t = {std::uint32_t(rng.below(count)), std::uint32_t(rng.below(count)), std::uint32_t(rng.below(count))};
        soup.params.closed = false;
        compare(soup);
    }
}

TEST_CASE("casters and receivers that are not finite give visibility in [0, 1]") {
    if (test::skip_without_device()) return;
    Scene<float> scene(12);
    scene.casters[0].vertices[7] = vec3<float>(std::numeric_limits<float>::quiet_NaN());
    scene.casters[1].vertices[90] = vec3<float>(std::numeric_limits<float>::infinity(), 0, 0);
    scene.receiver = scene.casters[0];
    Device device;
    for (const float v : run<float>(device, scene).visibility) CHECK((v >= 0 && v <= 1));
}

TEST_CASE("maps have the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    for (const std::size_t rings : {3u, 16u}) {
        const Scene<float> scene(rings, false);
        test::in_every_order(
            [&] {
                Device device;
                return run<float>(device, scene);
            },
            [](const Result<float>& found, const Result<float>& expected) {
                CHECK(test::same_bits(found.texels, expected.texels));
                CHECK(test::same_bits(found.visibility, expected.visibility));
            });
    }
}

} // namespace
} // namespace gsh::shadow_map_on_device
