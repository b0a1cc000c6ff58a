// SPDX-License-Identifier: Apache-2.0
/// @file  The field of ambient occlusion on a GPU agrees with the host, forward and backward.
#include <gsh/avatar/cuda/occlusion_field.cuh>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"
#include "support/plain_backend.hpp"

#include <cstddef>
#include <vector>

namespace gsh::occlusion_field_on_device {
namespace {

using cuda::Device;

constexpr std::size_t J = 4;
const std::vector<int> parents{-1, 0, 1, 1};

OcclusionFieldData field_data(std::size_t points, int width, int hidden_layers) {
    OcclusionFieldData data{.width = width, .hidden_layers = hidden_layers, .bias = 0.3, .largest = 1.3};
    test::Rng rng(7);
    const auto fill = [&](std::vector<float>& values, std::size_t count, double size) {
        for (const double value : rng.numbers(count, -size, size)) values.push_back(static_cast<float>(value));
    };
    fill(data.neurons, points * static_cast<std::size_t>(width), 1);
    fill(data.pose_weights, static_cast<std::size_t>(width) * 9 * (J - 1), 0.5);
    fill(data.weights, data.network().parameter_count(), 0.3);
    return data;
}

template <class T>
struct Result {
    std::vector<T> ao;
    std::vector<mat3<T>> dL_drotations;
};

std::size_t point_count(const OcclusionFieldData& data) {
    return data.neurons.size() / static_cast<std::size_t>(data.width);
}
std::vector<mat3<double>> pose() {
    std::vector<mat3<double>> rotations;
    for (const auto& angle : test::Rng(8).vecs(J, -0.8, 0.8)) rotations.push_back(rotation_from_axis_angle(angle));
    return rotations;
}
std::vector<double> ao_gradient(const OcclusionFieldData& data) { return test::Rng(9).numbers(point_count(data)); }

template <class T, class B>
Result<T> run(B& backend, const OcclusionFieldData& data, int passes = 1,
              const std::vector<mat3<double>>& rotations_in_double = pose()) {
    const std::size_t count = point_count(data);
    std::vector<mat3<T>> rotations;
    for (const auto& R : rotations_in_double) rotations.push_back(mat3<T>(R));
    std::vector<T> dL_dao;
    for (const double value : ao_gradient(data)) dL_dao.push_back(T(value));
    const Skeleton<B, T> skeleton(backend, parents);
    const OcclusionField<B, T> field(backend, data, count, J);
    const auto R = uploaded(backend, rotations);
    const auto gradient = uploaded(backend, dL_dao);
    auto dR = uploaded(backend, std::vector<mat3<T>>(J, mat3<T>(T(0))));
    typename B::template Buffer<T> ao(count);
    typename OcclusionField<B, T>::Cache cache;
    field.forward(skeleton, R, ao, cache);
    for (int pass = 0; pass < passes; ++pass) field.backward(skeleton, ao, gradient, cache, dR);
    return {test::fetched(backend, ao), test::fetched(backend, dR)};
}

template <class T>
void check_near(const Result<T>& found, const Result<T>& expected, double tolerance) {
    CHECK(test::relative_distance(test::numbers<T>(found.ao), test::numbers<T>(expected.ao)) < tolerance);
    CHECK(test::relative_distance(test::numbers<T>(found.dL_drotations), test::numbers<T>(expected.dL_drotations)) <
          tolerance);
}

template <class T>
void compare(std::size_t count, int width, int hidden_layers) {
    CAPTURE(count);
    CAPTURE(width);
    CAPTURE(hidden_layers);
    const OcclusionFieldData data = field_data(count, width, hidden_layers);
    Device device;
    const Result<T> found = run<T>(device, data);
    test::with_references(
        [&](auto& backend) { check_near(found, run<T>(backend, data), sizeof(T) == 8 ? 1e-10 : 1e-4); });
}

TEST_CASE("occlusion agrees with the host for every number of Gaussians") {
    if (test::skip_without_device()) return;
    for (const std::size_t count : {0u, 1u, 31u, 32u, 33u, 127u, 128u, 129u}) compare<double>(count, 20, 2);
    for (const std::size_t count : {0u, 1u, 31u, 32u, 33u, 129u, 300u}) compare<float>(count, 64, 2);
}

TEST_CASE("occlusion agrees for every width and number of layers") {
    if (test::skip_without_device()) return;
    for (const int layers : {1, 2, 3, 4})
        for (const int width : {1, 16, 65}) compare<double>(130, width, layers);
    compare<double>(130, 130, 2);
    compare<float>(150, 64, 3);
}

TEST_CASE("the adjoint of occlusion is its gradient") {
    if (test::skip_without_device()) return;
    Device device;
    for (const int layers : {2, 3}) {
        const OcclusionFieldData data = field_data(70, 20, layers);
        std::vector<mat3<double>> rotations = pose();
        Result<double> gradient = run<double>(device, data, 1, rotations);
        const auto loss = [&] { return test::inner(run<double>(device, data, 0, rotations).ao, ao_gradient(data)); };
        test::check_gradient(loss, test::scalars(rotations).subspan(9, 9 * (J - 1)), // the root's does not count
                             test::scalars(gradient.dL_drotations).subspan(9, 9 * (J - 1)));
    }
}

TEST_CASE("the adjoint of occlusion adds") {
    if (test::skip_without_device()) return;
    const OcclusionFieldData data = field_data(150, 30, 3);
    Device device;
    Result<double> once = run<double>(device, data);
    for (auto& m : once.dL_drotations) m *= 2.0;
    check_near(run<double>(device, data, 2), once, 1e-15);
}

TEST_CASE("the gradient of the pose is that of all blocks, for more blocks than threads join them") {
    if (test::skip_without_device()) return;
    using Join = cuda::detail::JoinPose<double>;
    const std::size_t blocks = 2 * Join::block_size + 9, width = 3;
    const std::vector<double> partials = test::Rng(3).numbers(width * blocks);
    std::vector<double> expected(width, 1);
    for (std::size_t n = 0; n < partials.size(); ++n) expected[n / blocks] += partials[n];
    Device device;
    const auto from = uploaded(device, partials);
    auto to = uploaded(device, std::vector<double>(width, 1));
    device.launch(width, Join{from, to, blocks});
    CHECK(test::relative_distance(test::fetched(device, to), expected) < 1e-14);
}

TEST_CASE("occlusion has the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    for (const int layers : {2, 4}) {
        const OcclusionFieldData data = field_data(300, 24, layers);
        test::in_every_order(
            [&] {
                Device device;
                return run<float>(device, data);
            },
            [](const Result<float>& found, const Result<float>& expected) {
                CHECK(test::same_bits(found.ao, expected.ao));
                CHECK(test::same_bits(found.dL_drotations, expected.dL_drotations));
            });
    }
}

} // namespace
} // namespace gsh::occlusion_field_on_device
