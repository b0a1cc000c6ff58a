// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/vec.hpp>

#include "support/gradient.hpp"

using namespace gsh;

TEST_CASE("inverse_backward is the gradient of inverse") {
    test::Rng rng(1);
    mat3<double> m(rng.vec(), rng.vec(), rng.vec()), weight(rng.vec(), rng.vec(), rng.vec());
    m += mat3<double>(2.0); // far from singular
    const auto loss = [&] {
        const mat3<double> inv = inverse(m);
        return dot(inv[0], weight[0]) + dot(inv[1], weight[1]) + dot(inv[2], weight[2]);
    };
    mat3<double> dL_dm(0.0);
    inverse_backward(inverse(m), weight, dL_dm);
    test::check_gradient(loss, test::scalars(m), test::scalars(dL_dm));

    const mat3<double> once = dL_dm;
    inverse_backward(inverse(m), weight, dL_dm);
    CHECK(length(dL_dm[1] - once[1] * 2.0) < 1e-13);

    const mat3<double> identity = m * inverse(m);
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) CHECK(identity[c][r] == doctest::Approx(c == r).epsilon(1e-12));
}

TEST_CASE("normalize_backward is the gradient of normalize") {
    test::Rng rng(2);
    vec3<double> v = rng.vec(), weight = rng.vec(), dL_dv(0.0);
    normalize_backward(v, weight, dL_dv);
    test::check_gradient([&] { return dot(normalize(v), weight); }, test::scalars(v), test::scalars(dL_dv));
    CHECK(length(normalize(v)) == doctest::Approx(1).epsilon(1e-15));
    CHECK(std::abs(dot(v, dL_dv)) < 1e-14); // no component along v
}

TEST_CASE("products have the handedness and layout they promise") {
    test::Rng rng(3);
    const vec3<double> a = rng.vec(), b = rng.vec(), v = rng.vec();
    CHECK(cross(vec3<double>(1, 0, 0), vec3<double>(0, 1, 0)) == vec3<double>(0, 0, 1));
    CHECK(length(outer(a, b) * v - a * dot(b, v)) < 1e-15);
    const mat3<double> m(a, b, v);
    CHECK(length(transposed_times(m, a) - transpose(m) * a) < 1e-15);
    CHECK(transpose(m)[2][0] == m[0][2]);
    CHECK(determinant(m) == doctest::Approx(dot(cross(a, b), v)).epsilon(1e-14));
}
