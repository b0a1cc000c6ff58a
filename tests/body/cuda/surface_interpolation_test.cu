// SPDX-License-Identifier: Apache-2.0
/// @file  Interpolation on a surface on a GPU agrees with the host, forward and backward.
#include <gsh/backend/serial.hpp>
#include <gsh/body/cuda/surface_interpolation.cuh>
#include <gsh/body/surface_interpolation.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/gradient.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace gsh::surface_interpolation_on_device {
namespace {

using cuda::Device;

template <class Vector>
struct Result {
    std::vector<Vector> points, dL_dvalues, values, dL_dpoints;
};

/// Vector is vec3<T> or vec2<T>.
template <class T, class Vector, class B>
Result<Vector> run(B& backend, std::size_t vertices, std::size_t points, int passes = 1) {
    test::Rng rng(4);
    std::vector<std::array<int, 3>> triangles;
    std::vector<vec3<double>> barycentric;
    std::vector<Vector> values, gradient;
    const auto random = [&] {
        const vec3<double> v = rng.vec();
        Vector result(T(0));
        for (int k = 0; k < Vector::length(); ++k) result[k] = T(v[k]);
        return result;
    };
    for (std::size_t v = 0; v < vertices; ++v) values.push_back(random());
    for (std::size_t i = 0; i < points; ++i) {
        const auto vertex = [&] { return static_cast<int>(i % 3 ? rng.below(vertices) : rng.below(vertices) / 8); };
        const int a = vertex(), b = vertex(), c = vertex();
        triangles.push_back({a, b, c}), barycentric.push_back(rng.vec(0, 1)), gradient.push_back(random());
    }
    const SurfaceInterpolation<B, T> surface(backend, vertices, triangles, barycentric);
    const auto v = uploaded(backend, values), g = uploaded(backend, gradient);
    auto p = uploaded(backend, std::vector<Vector>(points, Vector(T(1))));
    auto d = uploaded(backend, std::vector<Vector>(vertices, Vector(T(0))));
    surface.template forward<Vector>(v, p);
    for (int pass = 0; pass < passes; ++pass) surface.template backward<Vector>(g, d);
    return {test::fetched(backend, p), test::fetched(backend, d), values, gradient};
}

template <class T, class Vector>
void compare(std::size_t vertices, std::size_t points) {
    CAPTURE(vertices);
    CAPTURE(points);
    Device device;
    cpu::Serial serial;
    const auto found = run<T, Vector>(device, vertices, points), expected = run<T, Vector>(serial, vertices, points);
    const double tolerance = sizeof(T) == 8 ? 1e-14 : 2e-6;
    CHECK(test::relative_distance(test::numbers<T>(found.points), test::numbers<T>(expected.points)) < tolerance);
    CHECK(test::relative_distance(test::numbers<T>(found.dL_dvalues), test::numbers<T>(expected.dL_dvalues)) <
          tolerance);
}

TEST_CASE("interpolation on a surface agrees with the host for every number of vertices and points") {
    if (test::skip_without_device()) return;
    for (const std::size_t vertices : {1u, 3u, 4u, 5u, 15u, 16u, 17u, 200u})
        for (const std::size_t points : {0u, 1u, 33u, 1000u}) {
            compare<double, vec3<double>>(vertices, points);
            compare<double, vec2<double>>(vertices, points);
            compare<float, vec3<float>>(vertices, points);
        }
}

TEST_CASE("the adjoint of interpolation is its transpose") {
    if (test::skip_without_device()) return;
    Device device;
    auto r = run<double, vec3<double>>(device, 50, 400);
    for (auto& p : r.points) p -= vec3<double>(1); // where they started
    const auto numbers = [](const auto& vectors) { return test::numbers<double>(vectors); };
    CHECK(test::inner(numbers(r.points), numbers(r.dL_dpoints)) ==
          doctest::Approx(test::inner(numbers(r.values), numbers(r.dL_dvalues))).epsilon(1e-12));
}

TEST_CASE("the adjoint of interpolation adds, and has the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    Device device;
    auto once = run<double, vec3<double>>(device, 50, 400), twice = run<double, vec3<double>>(device, 50, 400, 2);
    for (auto& v : once.dL_dvalues) v *= 2.0;
    CHECK(once.dL_dvalues == twice.dL_dvalues);
    test::in_every_order(
        [] {
            Device other;
            return run<float, vec3<float>>(other, 50, 400);
        },
        [](const Result<vec3<float>>& found, const Result<vec3<float>>& expected) {
            CHECK(test::same_bits(found.dL_dvalues, expected.dL_dvalues));
        });
}

} // namespace
} // namespace gsh::surface_interpolation_on_device
