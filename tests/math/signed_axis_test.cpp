// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/signed_axis.hpp>

#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include <cmath>

using namespace gsh;

TEST_CASE("every signed axis is found, named, and turned to y by a rotation that keeps a horizontal axis") {
    for (int index = 0; index < 3; ++index)
        for (const int sign : {1, -1}) {
            vec3<double> v(0.3, -0.2, 0.1);
            v[index] = 0.9 * sign;
            const auto axis = signed_axis_along(v, 0.8);
            REQUIRE(axis);
            CHECK(*axis == SignedAxis{index, sign});
            CHECK(axis->name() == (sign < 0 ? "-" : "") + std::string(1, static_cast<char>('x' + index)));
            const mat3<double> A = turn_to_y(*axis);
            CHECK(is_rotation(A, 1e-15));
            vec3<double> up(0);
            up[index] = sign;
            CHECK(A * up == vec3<double>(0, 1, 0));
            const vec3<double> kept = index == 0 ? vec3<double>(0, 0, 1) : vec3<double>(1, 0, 0);
            CHECK(A * kept == kept);
        }
    CHECK(turn_to_y({}) == mat3<double>(1.0));
}

TEST_CASE("a vector that is short, askew or NaN has no axis") {
    CHECK(!signed_axis_along({0.5, 0.5, 0.5}, 0.6));
    CHECK(!signed_axis_along({0, 0, 0}, 0));
    CHECK(!signed_axis_along(vec3<double>(std::nan("")), 0.1));
}
