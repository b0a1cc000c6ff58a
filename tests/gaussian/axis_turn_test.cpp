// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/axis_turn.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/math/sh.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

GaussianCloud<double> cloud_to_turn(std::size_t count, int degree) {
    GaussianCloud<double> cloud(count, degree);
    test::Rng rng(5);
    for (std::size_t i = 0; i < count; ++i)
        cloud.means[i] = rng.vec(), cloud.log_scales[i] = rng.vec(-3, 0), cloud.quats[i] = rng.quat();
    for (auto& sh : cloud.sh) sh = rng.vec();
    return cloud;
}

mat3<double> stored_covariance(const GaussianCloud<double>& cloud, std::size_t i) {
    const mat3<double> F = covariance_factor(cloud.quats[i], cloud.log_scales[i]);
    return F * transpose(F);
}

/// Largest difference of an entry.
double difference(const mat3<double>& a, const mat3<double>& b) {
    double largest = 0;
    for (int c = 0; c < 3; ++c) largest = std::max(largest, length(a[c] - b[c]));
    return largest;
}

void check_turned(const mat3<double>& A) {
    const auto cloud = cloud_to_turn(10, 4);
    auto turned = cloud;
    turn_axes(turned, A);
    test::Rng rng(9);
    for (std::size_t i = 0; i < 10; ++i) {
        CHECK(length(turned.means[i] - A * cloud.means[i]) < 1e-14);
        CHECK(difference(stored_covariance(turned, i), A * stored_covariance(cloud, i) * transpose(A)) < 1e-13);
        // What was seen along d is seen along A d, also in a mirror.
        const vec3<double> d = normalize(rng.vec());
        CHECK(length(SHEval<4>::forward(turned.sh.data() + 25 * i, A * d) -
                     SHEval<4>::forward(cloud.sh.data() + 25 * i, d)) < 1e-12);
    }
}

} // namespace

TEST_CASE("every change and every exchange of the axes moves places, shapes and colours together") {
    const int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    for (const auto& order : orders)
        for (int signs = 0; signs < 8; ++signs) {
            CAPTURE(signs);
            mat3<double> A(0.0);
            for (int k = 0; k < 3; ++k) A[k][order[k]] = signs >> k & 1 ? -1.0 : 1.0;
            check_turned(A);
        }
    test::Rng rng(3);
    check_turned(rotation_from_quat(rng.quat()));
}

TEST_CASE("changes of signs round nothing, and twice they are nothing") {
    const auto cloud = cloud_to_turn(20, 4);
    for (const vec3<double> signs : {vec3<double>(1, -1, -1), vec3<double>(-1, -1, 1), vec3<double>(-1, 1, 1)}) {
        auto turned = cloud;
        flip_axes(turned, signs);
        for (std::size_t i = 0; i < 20; ++i) CHECK(turned.means[i] == cloud.means[i] * signs);
        flip_axes(turned, signs);
        CHECK(turned.means == cloud.means);
        CHECK(turned.sh == cloud.sh);
        for (std::size_t i = 0; i < 20; ++i) {
            CHECK(turned.quats[i].w == cloud.quats[i].w);
            CHECK(turned.quats[i].y == cloud.quats[i].y);
        }
    }
    // Half a turn about x, as the pairs of signs in other programs have it: (1), (- - +), (2: - + + - +), …
    GaussianCloud<double> ones(1, 3);
    for (auto& sh : ones.sh) sh = vec3<double>(1.0);
    flip_axes(ones, vec3<double>(1, -1, -1));
    const int expected[16] = {1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1};
    for (std::size_t k = 0; k < 16; ++k) CHECK(ones.sh[k].x == expected[k]);
}
