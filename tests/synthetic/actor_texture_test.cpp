// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/core/rng.hpp>
#include <gsh/synthetic/actor_texture.hpp>

using namespace gsh;

namespace {
double brightness(const vec3<double>& p) {
    const vec3<double> c = actor_color(p).albedo;
    return (c.x + c.y + c.z) / 3;
}
} // namespace

TEST_CASE("colours stay within what paint can do, all over the space around the body") {
    Rng rng(3);
    for (int i = 0; i < 20000; ++i) {
        const double x = rng.uniform(-0.87, 0.87), y = rng.uniform(-0.93, 0.8), z = rng.uniform(-0.14, 0.21);
        const SurfaceColor c = actor_color({x, y, z});
        for (int k = 0; k < 3; ++k) {
            CHECK(c.albedo[k] >= 0);
            CHECK(c.albedo[k] <= 1);
        }
        CHECK(c.gloss >= 0);
        CHECK(c.gloss <= 1);
    }
}

TEST_CASE("parts have their colours") {
    const vec3<double> eye = actor_joint(smplx::left_eye);
    CHECK(brightness(eye + vec3<double>(0, 0, 0.0134)) < 0.02);          // pupil
    CHECK(brightness(eye + vec3<double>(0.0095, 0.0002, 0.0095)) > 0.6); // white of the eye
    const auto jeans = actor_color({0.10, -0.60, 0.06}).albedo, shoe = actor_color({0.14, -0.88, 0.13}).albedo;
    CHECK(jeans.z > 2 * jeans.x);
    CHECK(shoe.x > 3 * shoe.z);
    const auto arm = actor_color({0.5, 0.49, 0}).albedo, lip = actor_color({0, 0.600, 0.1375}).albedo;
    CHECK(arm.x > arm.z);
    CHECK(lip.x / lip.y > arm.x / arm.y);      // redder than skin
    CHECK(brightness({0, 0.77, 0.03}) < 0.15); // hair
}

TEST_CASE("the shirt is checked: it changes across a few centimetres") {
    double low = 1, high = 0;
    for (int i = 0; i < 200; ++i) {
        const double b = brightness({0.03 + 0.0003 * i, 0.235, 0.13});
        low = std::min(low, b), high = std::max(high, b);
    }
    CHECK(high - low > 0.25);
}
