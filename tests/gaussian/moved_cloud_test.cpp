// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/moved_cloud.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

using namespace gsh;

namespace {

GaussianCloud<double> random_cloud(std::size_t count, int degree) {
    GaussianCloud<double> cloud(count, degree);
    test::Rng rng(5);
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = rng.vec(), cloud.log_scales[i] = rng.vec(-4, -1), cloud.quats[i] = rng.quat();
        cloud.opacity_logits[i] = rng.normal();
    }
    for (auto& c : cloud.sh) c = rng.vec();
    return cloud;
}

mat3<double> covariance_of(const GaussianCloud<double>& cloud, std::size_t i) {
    const mat3<double> F = covariance_factor(cloud.quats[i], cloud.log_scales[i]);
    return F * transpose(F);
}

double largest_entry(const mat3<double>& A) {
    double largest = 0;
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) largest = std::max(largest, std::abs(A[c][r]));
    return largest;
}

} // namespace

TEST_CASE("a moved cloud has the covariances A Σ Aᵀ, and its means are mapped") {
    const auto before = random_cloud(20, 0);
    test::Rng rng(2);
    const Affine<double> rigid(rotation_from_axis_angle(vec3<double>(0.4, -1, 2)), {1, 2, 3}),
        sheared(mat3<double>(rng.vec(), rng.vec(), rng.vec()), {0, -1, 0});
    REQUIRE(std::abs(determinant(sheared.linear)) > 0.01);
    for (const Affine<double>& map : {rigid, sheared}) {
        auto after = before;
        move_cloud(after, map);
        for (std::size_t i = 0; i < 20; ++i) {
            CHECK(length(after.means[i] - map(before.means[i])) < 1e-12);
            const mat3<double> expected = map.linear * covariance_of(before, i) * transpose(map.linear);
            CHECK(largest_entry(covariance_of(after, i) - expected) < 1e-9);
        }
        CHECK(after.opacity_logits == before.opacity_logits);
    }
}

TEST_CASE("colours turn with a cloud: from R d it looks as it did from d") {
    const mat3<double> R = rotation_from_axis_angle(vec3<double>(0.4, -1, 2));
    test::Rng rng(3);
    for (int degree = 0; degree <= 4; ++degree) {
        const auto before = random_cloud(5, degree);
        auto after = before;
        move_cloud(after, Affine<double>(R * 2.0, vec3<double>(1, 0, 0))); // the scale does not matter
        with_sh_degree(degree, [&](auto d) {
            using SH = SHEval<decltype(d)::value>;
            for (std::size_t i = 0; i < 5; ++i) {
                const vec3<double> dir = normalize(rng.vec());
                const auto at = i * SH::basis_count;
                CHECK(length(SH::forward(&after.sh[at], R * dir) - SH::forward(&before.sh[at], dir)) < 1e-12);
            }
        });
    }
}

TEST_CASE("a mirror: from the mirrored direction a cloud looks as it did, and its covariances are mirrored") {
    const mat3<double> R = rotation_from_axis_angle(vec3<double>(0.4, -1, 2)),
                       M = R * mat3<double>({-1, 0, 0}, {0, 1, 0}, {0, 0, 1});
    test::Rng rng(4);
    for (int degree = 0; degree <= 4; ++degree) {
        const auto before = random_cloud(5, degree);
        auto after = before;
        move_cloud(after, Affine<double>(M * 0.5, vec3<double>(1, 0, 0)));
        with_sh_degree(degree, [&](auto d) {
            using SH = SHEval<decltype(d)::value>;
            for (std::size_t i = 0; i < 5; ++i) {
                const vec3<double> dir = normalize(rng.vec());
                const auto at = i * SH::basis_count;
                CHECK(length(SH::forward(&after.sh[at], M * dir) - SH::forward(&before.sh[at], dir)) < 1e-12);
                const mat3<double> expected = M * covariance_of(before, i) * transpose(M) * 0.25;
                CHECK(largest_entry(covariance_of(after, i) - expected) < 1e-9);
            }
        });
    }
}
