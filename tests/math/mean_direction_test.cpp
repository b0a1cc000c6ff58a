// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/mean_direction.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <gsh/math/rotation.hpp>

using namespace gsh;

TEST_CASE("the mean of directions is that of the majority, whatever their lengths") {
    MeanDirection mean;
    CHECK(mean.empty());
    CHECK(mean.value() == vec3<double>(0));
    for (const double s : {1.0, -1.0}) mean.add({0.05 * s, 2, 0}), mean.add({0, 5, 0.1 * s});
    CHECK(length(mean.value() - vec3<double>(0, 1, 0)) < 1e-12);
    mean.add({1, 0, 0});
    CHECK(length(mean.value() - vec3<double>(0, 1, 0)) < 0.02); // the plain mean would be off by 14 degrees
    CHECK(mean.weight() == 5);
    mean.add({1, 0, 0}, 100);
    CHECK(mean.value().x > 0.99);
}

TEST_CASE("directions that cancel, zeros and NaN have no mean") {
    MeanDirection mean;
    mean.add(vec3<double>(0)), mean.add({0, 1, 0}, 0), mean.add(vec3<double>(std::nan("")));
    CHECK(mean.empty());
    mean.add({1, 0, 0}), mean.add({-1, 0, 0});
    CHECK(mean.value() == vec3<double>(0));
}

TEST_CASE("axes keep the first direction and turn to the second") {
    test::Rng rng(3);
    for (int n = 0; n < 20; ++n) {
        const vec3<double> a = rng.vec(), b = rng.vec();
        const mat3<double> axes = axes_of(a, b);
        CHECK(is_rotation(axes, 1e-12));
        CHECK(length(axes[0] - normalize(a)) < 1e-12);
        CHECK(dot(axes[1], b) > 0);
        CHECK(std::abs(dot(axes[2], b)) < 1e-12);
        CHECK(is_rotation(axes_of(a, a * -2.0), 1e-9)); // any axes
    }
    CHECK(axes_of(vec3<double>(0), {0, 2, 0}) == mat3<double>(1.0));
}
