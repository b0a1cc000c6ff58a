// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/rotation.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

using namespace gsh;

namespace {

mat3<double> scaled_axes(const PrincipalAxes<double>& axes) {
    return mat3<double>(axes.R[0] * axes.lengths.x, axes.R[1] * axes.lengths.y, axes.R[2] * axes.lengths.z);
}
double largest_entry(const mat3<double>& m) {
    double largest = 0;
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(m[c][r]));
    return largest;
}
void check_axes(const mat3<double>& M, const PrincipalAxes<double>& axes) {
    const mat3<double> A = scaled_axes(axes), product = M * transpose(M);
    CHECK(largest_entry(A * transpose(A) - product) <= 1e-14 * std::max(largest_entry(product), 1e-300));
    CHECK(largest_entry(transpose(axes.R) * axes.R - mat3<double>(1.0)) < 1e-14);
    CHECK(determinant(axes.R) == doctest::Approx(1));
    CHECK(std::min({axes.lengths.x, axes.lengths.y, axes.lengths.z}) >= 0);
}

} // namespace

TEST_CASE("axes and lengths give back M Mᵀ, for any M") {
    test::Rng rng(1);
    for (int trial = 0; trial < 200; ++trial) {
        mat3<double> M(rng.vec(), rng.vec(), rng.vec());
        if (trial % 3 == 1) M[2] = M[0] * 0.5 - M[1];         // flat
        if (trial % 3 == 2) M[2] = -M[2], M[1] = M[1] * 1e-6; // mirrored or not, and thin
        if (trial == 0) M = mat3<double>(0.0);
        if (trial == 3) M = mat3<double>(rng.vec(), vec3<double>(0), vec3<double>(0)); // a line
        if (trial == 6) M = mat3<double>(0.0), M[2].y = 2;
        check_axes(M, principal_axes(M));
    }
}

TEST_CASE("orthogonal columns are the axes, in their order") {
    test::Rng rng(2);
    const mat3<double> R = rotation_from_axis_angle(rng.vec(-3, 3));
    const auto axes = principal_axes(mat3<double>(R[0] * 0.01, R[1] * 2.0, R[2] * 0.3));
    CHECK(largest_entry(axes.R - R) < 1e-14);
    CHECK(length(axes.lengths - vec3<double>(0.01, 2, 0.3)) < 1e-14);
    // A mirrored matrix has the same axes but for the sign of the shortest.
    const auto mirrored = principal_axes(mat3<double>(R[0] * -0.01, R[1] * 2.0, R[2] * 0.3));
    CHECK(largest_entry(mirrored.R - R) < 1e-14);
}

TEST_CASE("small lengths keep their relative accuracy") {
    test::Rng rng(3);
    const mat3<double> R = rotation_from_axis_angle(rng.vec()), V = rotation_from_axis_angle(rng.vec());
    const mat3<double> M = mat3<double>(R[0], R[1] * 1e-9, R[2] * 1e-4) * transpose(V);
    auto lengths = principal_axes(M).lengths;
    std::sort(&lengths.x, &lengths.x + 3);
    CHECK(lengths.x == doctest::Approx(1e-9).epsilon(1e-5)); // eigenvalues of M Mᵀ would leave nothing of it
    CHECK(lengths.y == doctest::Approx(1e-4).epsilon(1e-10));
    CHECK(lengths.z == doctest::Approx(1).epsilon(1e-14));
}
