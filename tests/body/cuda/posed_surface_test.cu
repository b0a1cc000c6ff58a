// SPDX-License-Identifier: Apache-2.0
/// @file  The posed mesh on a GPU agrees with the host, and so do the gradients of bones and offsets.
#include <gsh/backend/serial.hpp>
#include <gsh/body/cuda/posed_surface.cuh>
#include <gsh/body/posed_surface.hpp>

#include <doctest/doctest.h>

#include "support/bodies.hpp"
#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"

#include <cstddef>
#include <vector>

namespace gsh::posed_surface_on_device {
namespace {

using cuda::Device;

template <class T>
struct Result {
    std::vector<vec3<T>> vertices, normals, result, dL_doffsets;
    std::vector<Affine<T>> dL_dbones;
};

struct Inputs {
    BodyModel body;
    std::vector<Affine<double>> bones;
    std::vector<vec3<double>> offsets, normal_offsets, dL_dvertices, dL_dnormals;

    Inputs(std::size_t joints, std::size_t rings, std::size_t sides = 12) : body(test::tube(joints, rings, sides)) {
        test::Rng rng(3);
        const std::size_t V = body.vertex_count();
        bones = pose_body(body, rng.vecs(joints, -0.5, 0.5), {0.3, -0.2, 0.5}).bones;
        offsets = rng.vecs(V, -0.01, 0.01), normal_offsets = rng.vecs(V, -0.2, 0.2);
        dL_dvertices = rng.vecs(V), dL_dnormals = rng.vecs(V);
    }
};

/// dL_dnormals is the gradient of the normals with offsets, and therefore of those without.
template <class T, class B>
Result<T> run(B& backend, const Inputs& inputs, int passes = 1) {
    const auto cast = [&](const std::vector<vec3<double>>& values) {
        return uploaded(backend, std::vector<vec3<T>>(values.begin(), values.end()));
    };
    const BodyModel& body = inputs.body;
    const std::size_t V = body.vertex_count(), joints = inputs.bones.size();
    std::vector<Affine<T>> posed;
    for (const auto& bone : inputs.bones) posed.push_back({mat3<T>(bone.linear), vec3<T>(bone.translation)});
    const auto bones = uploaded(backend, posed);
    const auto offsets = cast(inputs.offsets), normal_offsets = cast(inputs.normal_offsets),
               dL_dvertices = cast(inputs.dL_dvertices), dL_dnormals = cast(inputs.dL_dnormals);
    auto result = cast(std::vector<vec3<double>>(V)), dL_doffsets = cast(std::vector<vec3<double>>(V, vec3<double>(0)));
    auto dL_dbones = uploaded(backend, std::vector<Affine<T>>(joints, Affine<T>::zero()));
    const PosedSurface<B, T> surface(backend, body, {});
    typename PosedSurface<B, T>::Cache cache;
    surface.forward(bones, offsets, cache);
    surface.offset_normals(bones, normal_offsets, cache, result);
    for (int pass = 0; pass < passes; ++pass) {
        surface.offset_normals_backward(bones, normal_offsets, dL_dnormals, cache, dL_dbones, {});
        surface.backward(bones, offsets, dL_dvertices, dL_dnormals, cache, dL_dbones, dL_doffsets);
    }
    return {test::fetched(backend, cache.vertices), test::fetched(backend, cache.normals),
            test::fetched(backend, result), test::fetched(backend, dL_doffsets), test::fetched(backend, dL_dbones)};
}

template <class T, class B>
Result<T> run(B& backend, std::size_t joints, std::size_t rings, int passes = 1) {
    return run<T>(backend, Inputs(joints, rings), passes);
}

template <class T>
void check_near(const Result<T>& found, const Result<T>& expected, double tolerance) {
    const auto distance = [](const auto& a, const auto& b) {
        return test::relative_distance(test::numbers<T>(a), test::numbers<T>(b));
    };
    CHECK(distance(found.vertices, expected.vertices) < tolerance);
    CHECK(distance(found.normals, expected.normals) < tolerance);
    CHECK(distance(found.result, expected.result) < tolerance);
    CHECK(distance(found.dL_doffsets, expected.dL_doffsets) < tolerance);
    CHECK(distance(found.dL_dbones, expected.dL_dbones) < tolerance);
}

TEST_CASE("the posed mesh and its adjoint agree with the host's for few and many vertices of a bone") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::size_t joints : {1u, 4u})
        for (const std::size_t rings : {2u, 5u, 20u, 60u}) { // up to 12 pieces of 64 vertices for a bone
            CAPTURE(joints);
            CAPTURE(rings);
            check_near(run<double>(device, joints, rings), run<double>(serial, joints, rings), 1e-12);
            check_near(run<float>(device, joints, rings), run<float>(serial, joints, rings), 1e-4);
        }
}

TEST_CASE("the posed mesh agrees for numbers of vertices about a piece, a block, and a warp of pieces of one bone") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    struct Size {
        std::size_t rings, sides, vertices, pieces;
    };
    for (const Size& size : {Size{20, 3, 65, 2}, {16, 15, 257, 5}, {68, 12, 830, 13}, {88, 23, 2049, 33}}) {
        CAPTURE(size.vertices);
        const Inputs inputs(1, size.rings, size.sides);
        REQUIRE(inputs.body.vertex_count() == size.vertices);
        REQUIRE((size.vertices + 63) / 64 == size.pieces); // 64 vertices each
        check_near(run<double>(device, inputs), run<double>(serial, inputs), 1e-12);
        check_near(run<float>(device, inputs), run<float>(serial, inputs), 1e-4);
    }
}

TEST_CASE("the adjoint of the posed mesh is its gradient") {
    if (test::skip_without_device()) return;
    Device device;
    Inputs inputs(4, 20);
    Result<double> gradient = run<double>(device, inputs);
    const auto loss = [&] {
        const Result<double> r = run<double>(device, inputs, 0);
        return test::inner(test::numbers<double>(r.vertices), test::numbers<double>(inputs.dL_dvertices)) +
               test::inner(test::numbers<double>(r.result), test::numbers<double>(inputs.dL_dnormals));
    };
    test::check_gradient(loss, test::scalars(inputs.bones), test::scalars(gradient.dL_dbones));
    test::check_gradient(loss, test::scalars(inputs.offsets), test::scalars(gradient.dL_doffsets), {.stride = 17});
}

TEST_CASE("the adjoint of the posed mesh adds, and has the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    Device device;
    Result<double> once = run<double>(device, 4, 20);
    for (auto& bone : once.dL_dbones) bone.linear *= 2.0, bone.translation *= 2.0;
    for (auto& v : once.dL_doffsets) v *= 2.0;
    check_near(run<double>(device, 4, 20, 2), once, 1e-14);
    test::in_every_order(
        [] {
            Device other;
            return run<float>(other, 4, 20);
        },
        [](const Result<float>& found, const Result<float>& expected) {
            CHECK(test::same_bits(found.vertices, expected.vertices));
            CHECK(test::same_bits(found.dL_doffsets, expected.dL_doffsets));
            CHECK(test::same_bits(found.dL_dbones, expected.dL_dbones));
        });
}

} // namespace
} // namespace gsh::posed_surface_on_device
