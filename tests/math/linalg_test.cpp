// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/linalg.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("Eigen and GLM hold the same matrices") {
    test::Rng rng(1);
    const mat3<double> m(rng.vec(), rng.vec(), rng.vec());
    const vec3<double> v = rng.vec();
    const Eigen::Matrix3d e = to_eigen(m);
    CHECK(e(0, 2) == m[2][0]); // row 0, column 2
    const Eigen::Vector3d product = e * to_eigen(v);
    CHECK(length(from_eigen<double>(product) - m * v) < 1e-15);
    CHECK(from_eigen<double>(e) == m);
}

TEST_CASE("a span is an Eigen column without a copy") {
    std::vector<float> values{3, 4};
    auto column = eigen_map(Span<float>(values));
    CHECK(column.norm() == 5);
    column *= 2;
    CHECK(values[1] == 8);
    CHECK(eigen_map(Span<const float>(values)).sum() == 14);
    CHECK(eigen_map(Span<float>()).size() == 0);
}
