// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/thinned_interpolation.hpp>
#include <gsh/cpu.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

/// Interpolated values of points that have `values` at every stride-th one.
std::vector<double> interpolated(const std::vector<vec3<double>>& points, std::size_t stride,
                                 const std::vector<double>& values) {
    cpu::Serial backend;
    const auto interpolation = thinned_interpolation<cpu::Serial, double>(backend, points, stride);
    std::vector<double> all(points.size(), 0.0);
    interpolation.forward<double>(values, all);
    return all;
}

} // namespace

TEST_CASE("interpolation from a part of the points keeps its values, constants, and what lies between") {
    test::Rng rng(3);
    const std::vector<vec3<double>> points = rng.vecs(200);
    const std::size_t stride = 4, part = 50;
    const std::vector<double> ones = interpolated(points, stride, std::vector<double>(part, 1.0));
    for (const double one : ones) CHECK(one == doctest::Approx(1).epsilon(1e-12));

    const std::vector<double> values = rng.numbers(part);
    const std::vector<double> all = interpolated(points, stride, values);
    for (std::size_t i = 0; i < part; ++i) CHECK(all[stride * i] == values[i]);
    for (const double value : all) CHECK(std::abs(value) <= 1);
}

TEST_CASE("interpolation is continuous where another point becomes one of the nearest") {
    // Vertices on a line, and a point that moves along it: weights of the third one fall to zero.
    std::vector<double> values;
    std::vector<vec3<double>> vertices;
    test::Rng rng(5);
    for (int i = 0; i < 12; ++i) vertices.push_back({0.1 * i + 0.01 * rng.uniform(-1, 1), 0, 0}), values.push_back(rng.uniform(-1, 1));
    const int steps = 4000;
    std::vector<vec3<double>> points;
    std::vector<double> at;
    for (int i = 0; i < 12; ++i) {
        points.push_back(vertices[static_cast<std::size_t>(i)]);
        for (int k = 0; k < steps; ++k) points.push_back({0.2 + 0.7 * (i * steps + k) / (12 * steps), 0.03, 0});
    }
    const std::vector<double> all = interpolated(points, steps + 1, values);
    std::vector<double> moving;
    for (std::size_t i = 0; i < all.size(); ++i)
        if (i % (steps + 1)) moving.push_back(all[i]);
    double largest = 0;
    for (std::size_t i = 1; i < moving.size(); ++i) largest = std::max(largest, std::abs(moving[i] - moving[i - 1]));
    CHECK(largest < 2e-3); // a jump would be of the size of the values
    CHECK(largest > 1e-6);
}

TEST_CASE("interpolation from fewer than four points, and from points in one place") {
    const std::vector<vec3<double>> points{{0, 0, 0}, {0.25, 0, 0}, {1, 0, 0}, {0.5, 0, 0}};
    const std::vector<double> all = interpolated(points, 2, {3, 5});
    CHECK(all[1] == doctest::Approx((3 * 9 + 5 * 1) / 10.0)); // weights 1 / d²
    CHECK(all[3] == doctest::Approx(4));
    CHECK(interpolated(points, 4, {7}) == std::vector<double>{7, 7, 7, 7});
    const std::vector<vec3<double>> same(8, vec3<double>(0.5));
    CHECK(interpolated(same, 1, std::vector<double>(8, 2.0)) == std::vector<double>(8, 2.0));
}

TEST_CASE("interpolation refuses no points and no stride") {
    cpu::Serial backend;
    const std::vector<vec3<double>> none, one{{0, 0, 0}};
    CHECK_THROWS_AS((void)thinned_interpolation(backend, Span<const vec3<double>>(none), 1), ValueError);
    CHECK_THROWS_AS((void)thinned_interpolation(backend, Span<const vec3<double>>(one), 0), ValueError);
}
