// SPDX-License-Identifier: Apache-2.0
/// @file  Forward kinematics on a GPU agrees with the loop on the host for every shape of a skeleton.
#include <gsh/backend/serial.hpp>
#include <gsh/body/cuda/bone_transforms.cuh>
#include <gsh/body/skeleton.hpp>
#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/linear.hpp"

#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh::bone_transforms_on_device {
namespace {

using cuda::Device;

std::vector<int> skeleton(std::string_view kind, std::size_t joints) {
    test::Rng rng(joints);
    std::vector<int> parents;
    for (std::size_t j = 0; j < joints; ++j) {
        const int last = static_cast<int>(j) - 1;
        if (j == 0 || kind == "chain")
            parents.push_back(last);
        else if (kind == "star") parents.push_back(0);
        else parents.push_back(static_cast<int>(rng.below(j)));
    }
    return parents;
}

template <class T>
struct Result {
    std::vector<Affine<T>> bones;
    std::vector<mat3<T>> dL_drotations;
    std::vector<vec3<T>> dL_djoints, dL_dtransl;
};

template <class T>
struct Inputs {
    std::vector<mat3<T>> rotations;
    std::vector<vec3<T>> joints, transl;
    std::vector<Affine<T>> dL_dbones;

    explicit Inputs(std::size_t J) {
        test::Rng rng(11);
        transl = {vec3<T>(rng.vec())};
        for (std::size_t j = 0; j < J; ++j) {
            rotations.push_back(mat3<T>(rotation_from_axis_angle(rng.vec())));
            joints.push_back(vec3<T>(rng.vec(-0.1, 0.1)));
            const Affine<double> gradient = test::random_affine(rng);
            dL_dbones.push_back({mat3<T>(gradient.linear), vec3<T>(gradient.translation)});
        }
    }
};

template <class T, class B>
Result<T> run(B& backend, const std::vector<int>& parents, const Inputs<T>& inputs, int passes = 1) {
    const std::size_t J = parents.size();
    const auto& [rotations, joints, transl, dL_dbones] = inputs;
    Skeleton<B, T> skeleton(backend, parents);
    const auto R = uploaded(backend, rotations);
    const auto x = uploaded(backend, joints), t = uploaded(backend, transl);
    const auto g = uploaded(backend, dL_dbones);
    typename B::template Buffer<Affine<T>> bones(J);
    skeleton.bones(R, x, t, bones);
    auto dR = uploaded(backend, std::vector<mat3<T>>(J, mat3<T>(T(0))));
    auto dx = uploaded(backend, std::vector<vec3<T>>(J, vec3<T>(T(0))));
    auto dt = uploaded(backend, std::vector<vec3<T>>(1, vec3<T>(T(0))));
    for (int pass = 0; pass < passes; ++pass) skeleton.bones_backward(R, x, bones, g, dR, dx, dt);
    return {test::fetched(backend, bones), test::fetched(backend, dR), test::fetched(backend, dx),
            test::fetched(backend, dt)};
}

template <class T, class B>
Result<T> run(B& backend, const std::vector<int>& parents, int passes = 1) {
    return run(backend, parents, Inputs<T>(parents.size()), passes);
}

template <class T>
void check_near(const Result<T>& found, const Result<T>& expected, double tolerance) {
    const auto distance = [](const auto& a, const auto& b) {
        return test::relative_distance(test::numbers<T>(a), test::numbers<T>(b));
    };
    CHECK(distance(found.bones, expected.bones) < tolerance);
    CHECK(distance(found.dL_drotations, expected.dL_drotations) < tolerance);
    CHECK(distance(found.dL_djoints, expected.dL_djoints) < tolerance);
    CHECK(distance(found.dL_dtransl, expected.dL_dtransl) < tolerance);
}

/// Without fused operations, which only a GPU's compiler makes, the bits of the host.
template <class T>
constexpr double tolerance() {
#if defined(GSH_CUDA_EMULATION)
    return 1e-300;
#else
    return sizeof(T) == 8 ? 1e-12 : 1e-4;
#endif
}

TEST_CASE("bones and their adjoints agree with the host's for chains, stars and trees of every size") {
    if (test::skip_without_device()) return;
    Device device;
    cpu::Serial serial;
    for (const std::string_view kind : {"chain", "star", "tree"})
        for (const std::size_t joints : {0u, 1u, 2u, 31u, 32u, 33u, 55u, 127u, 128u, 129u}) {
            CAPTURE(kind);
            CAPTURE(joints);
            const auto parents = skeleton(kind, joints);
            check_near(run<double>(device, parents), run<double>(serial, parents), tolerance<double>());
            // A long chain adds up rounding.
            check_near(run<float>(device, parents), run<float>(serial, parents), tolerance<float>());
        }
}

TEST_CASE("the adjoint of bones is their gradient") {
    if (test::skip_without_device()) return;
    Device device;
    for (const std::string_view kind : {"chain", "star", "tree"}) {
        const auto parents = skeleton(kind, 34);
        Inputs<double> inputs(34);
        Result<double> gradient = run(device, parents, inputs);
        const auto loss = [&] {
            return test::inner(test::numbers<double>(run(device, parents, inputs, 0).bones),
                               test::numbers<double>(inputs.dL_dbones));
        };
        test::check_gradient(loss, test::scalars(inputs.rotations), test::scalars(gradient.dL_drotations),
                             {.stride = 11});
        test::check_gradient(loss, test::scalars(inputs.joints), test::scalars(gradient.dL_djoints), {.stride = 7});
        test::check_gradient(loss, test::scalars(inputs.transl), test::scalars(gradient.dL_dtransl));
    }
}

TEST_CASE("backward along bones adds") {
    if (test::skip_without_device()) return;
    Device device;
    const auto parents = skeleton("tree", 55);
    Result<double> one = run<double>(device, parents), two = run<double>(device, parents, 2);
    for (auto& m : one.dL_drotations) m *= 2.0;
    for (auto& v : one.dL_djoints) v *= 2.0;
    for (auto& v : one.dL_dtransl) v *= 2.0;
    check_near(two, one, 1e-15);
}

TEST_CASE("bones have the same bits in any order of threads") {
    if (test::skip_without_device()) return;
    const auto parents = skeleton("tree", 55);
    test::in_every_order(
        [&] {
            Device device;
            return run<float>(device, parents);
        },
        [](const Result<float>& found, const Result<float>& expected) {
            CHECK(test::same_bits(found.bones, expected.bones));
            CHECK(test::same_bits(found.dL_drotations, expected.dL_drotations));
            CHECK(test::same_bits(found.dL_djoints, expected.dL_djoints));
            CHECK(test::same_bits(found.dL_dtransl, expected.dL_dtransl));
        });
}

} // namespace
} // namespace gsh::bone_transforms_on_device
