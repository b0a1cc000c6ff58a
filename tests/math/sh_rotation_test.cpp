// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/rotation.hpp>
#include <gsh/math/sh_rotation.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

template <int D>
struct RotatedDegree {
    static constexpr int value = D;
};

template <int D>
std::vector<vec3<double>> rotated_sh(const std::vector<vec3<double>>& sh, const mat3<double>& R) {
    std::vector<vec3<double>> result(sh.size());
    ShRotation<D>::forward(sh.data(), R, result.data());
    return result;
}

double largest_difference(const std::vector<vec3<double>>& a, const std::vector<vec3<double>>& b) {
    double largest = 0;
    for (std::size_t k = 0; k < a.size(); ++k) largest = std::max(largest, length(a[k] - b[k]));
    return largest;
}

} // namespace

TEST_CASE_TEMPLATE("a turned function has at a turned direction the value that it had before", D, RotatedDegree<0>,
                   RotatedDegree<1>, RotatedDegree<2>, RotatedDegree<3>, RotatedDegree<4>) {
    test::Rng rng(3);
    for (int trial = 0; trial < 20; ++trial) {
        const auto sh = rng.vecs(ShRotation<D::value>::basis_count);
        const mat3<double> R = rotation_from_axis_angle(rng.vec(-3, 3));
        const auto turned = rotated_sh<D::value>(sh, R);
        for (int k = 0; k < 20; ++k) {
            const vec3<double> dir = normalize(rng.vec());
            const vec3<double> before = SHEval<D::value>::forward(sh.data(), dir),
                               after = SHEval<D::value>::forward(turned.data(), R * dir);
            CHECK(length(after - before) < 1e-13);
        }
    }
}

TEST_CASE("rotations of SH compose, and the identity changes nothing") {
    test::Rng rng(4);
    const auto sh = rng.vecs(25);
    const mat3<double> A = rotation_from_axis_angle(rng.vec(-2, 2)), B = rotation_from_axis_angle(rng.vec(-2, 2));
    CHECK(largest_difference(rotated_sh<4>(sh, mat3<double>(1.0)), sh) < 1e-14);
    CHECK(largest_difference(rotated_sh<4>(rotated_sh<4>(sh, B), A), rotated_sh<4>(sh, A * B)) < 1e-13);
    // A band does not depend on the degree of the others.
    const auto two = rotated_sh<2>({sh.begin(), sh.begin() + 9}, A), four = rotated_sh<4>(sh, A);
    CHECK(largest_difference(two, {four.begin(), four.begin() + 9}) < 1e-14);
}

TEST_CASE("half turns about an axis change the signs that the frames of files are known for") {
    test::Rng rng(5);
    const auto sh = rng.vecs(16);
    const auto signs_of = [&](const mat3<double>& R) {
        const auto turned = rotated_sh<3>(sh, R);
        std::array<int, 16> signs{};
        for (std::size_t k = 0; k < 16; ++k) {
            signs[k] = length(turned[k] - sh[k]) < 1e-14 ? 1 : length(turned[k] + sh[k]) < 1e-14 ? -1 : 0;
        }
        return signs;
    };
    const mat3<double> about_z({-1, 0, 0}, {0, -1, 0}, {0, 0, 1}), about_x({1, 0, 0}, {0, -1, 0}, {0, 0, -1});
    CHECK(signs_of(about_z) == std::array<int, 16>{1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1});
    CHECK(signs_of(about_x) == std::array<int, 16>{1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1});
}

TEST_CASE("band 1 turns as the vector (-c1, -c-1, c0)") {
    test::Rng rng(6);
    const auto sh = rng.vecs(4);
    const mat3<double> R = rotation_from_axis_angle(rng.vec(-2, 2));
    const auto turned = rotated_sh<1>(sh, R);
    for (int channel = 0; channel < 3; ++channel) {
        const auto vector = [&](const std::vector<vec3<double>>& c) {
            return vec3<double>(-c[3][channel], -c[1][channel], c[2][channel]);
        };
        CHECK(length(vector(turned) - R * vector(sh)) < 1e-14);
    }
}

TEST_CASE_TEMPLATE("ShRotation::backward is the gradient of forward", D, RotatedDegree<0>, RotatedDegree<1>,
                   RotatedDegree<2>, RotatedDegree<3>, RotatedDegree<4>) {
    using Rotation = ShRotation<D::value>;
    test::Rng rng(7);
    auto sh = rng.vecs(Rotation::basis_count), dL_dsh = std::vector(sh.size(), vec3<double>(0.0));
    const auto dL_drotated = rng.vecs(Rotation::basis_count);
    mat3<double> R = rotation_from_axis_angle(rng.vec(-2, 2)), dL_dR(0.0);
    const auto loss = [&] {
        const auto turned = rotated_sh<D::value>(sh, R);
        double sum = 0;
        for (std::size_t k = 0; k < turned.size(); ++k) sum += dot(turned[k], dL_drotated[k]);
        return sum;
    };
    Rotation::backward(sh.data(), R, dL_drotated.data(), dL_dsh.data(), dL_dR);
    test::check_gradient(loss, test::scalars(sh), test::scalars(dL_dsh), {.tolerance = 1e-8});
    test::check_gradient(loss, test::scalars(R), test::scalars(dL_dR),
                         {.tolerance = 1e-8, .may_vanish = D::value == 0});

    const auto sh_once = dL_dsh;
    const mat3<double> R_once = dL_dR;
    Rotation::backward(sh.data(), R, dL_drotated.data(), dL_dsh.data(), dL_dR);
    for (std::size_t k = 0; k < sh.size(); ++k) CHECK(length(dL_dsh[k] - sh_once[k] * 2.0) < 1e-12);
    for (int column = 0; column < 3; ++column) CHECK(length(dL_dR[column] - R_once[column] * 2.0) < 1e-12);
}
