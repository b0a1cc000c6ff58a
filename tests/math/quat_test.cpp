// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/quat.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("rotation_matrix_backward and normalize_backward are gradients") {
    test::Rng rng(3);
    quat<double> q = rng.quat();
    const mat3<double> weight(rng.vec(), rng.vec(), rng.vec());
    const auto loss = [&] {
        const mat3<double> m = rotation_matrix(normalize(q));
        return dot(m[0], weight[0]) + dot(m[1], weight[1]) + dot(m[2], weight[2]);
    };
    quat<double> dL_dn{0, 0, 0, 0}, dL_dq{0, 0, 0, 0};
    rotation_matrix_backward(normalize(q), weight, dL_dn);
    normalize_backward(q, dL_dn, dL_dq);
    test::check_gradient(loss, test::scalars(q), test::scalars(dL_dq));

    const quat<double> once = dL_dq, once_n = dL_dn;
    normalize_backward(q, dL_dn, dL_dq);
    CHECK(dL_dq.w == 2 * once.w);
    CHECK(dL_dq.z == 2 * once.z);
    rotation_matrix_backward(normalize(q), weight, dL_dn);
    CHECK(dL_dn.x == 2 * once_n.x);
    CHECK(dL_dn.y == 2 * once_n.y);
}

TEST_CASE("quat_from_z_axis turns +z to its argument by the shortest way") {
    test::Rng rng(5);
    std::vector<vec3<double>> directions{{0, 0, 1},     {0, 0, -1},        {1, 0, 0},     {0, -1, 0},
                                         {1e-9, 0, -1}, {1e-5, -2e-5, -1}, {0, 1e-17, -1}};
    for (int i = 0; i < 20; ++i) directions.push_back(rng.vec());
    for (vec3<double> n : directions) {
        n = n * (1 / length(n));
        const quat<double> q = quat_from_z_axis(n);
        CHECK(std::abs(dot(q, q) - 1) < 1e-14);
        CHECK(length(rotation_matrix(q) * vec3<double>(0, 0, 1) - n) < 1e-14);
        CHECK(q.z == 0); // the axis is perpendicular to z, so the rotation is the shortest
        CHECK(q.w >= 0);
    }
}

TEST_CASE("a unit quaternion gives a right-handed rotation about its axis") {
    const double half = 0.35;
    const quat<double> q{std::cos(half), 0, std::sin(half), 0}; // 0.7 rad about y
    const vec3<double> turned = rotation_matrix(q) * vec3<double>(0, 0, 1);
    CHECK(turned.x == doctest::Approx(std::sin(2 * half)));
    CHECK(turned.z == doctest::Approx(std::cos(2 * half)));
}
