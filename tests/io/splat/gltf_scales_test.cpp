// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/gltf_scales.hpp>

#include "io/splat_clouds.hpp"

#include <gsh/core/rng.hpp>

#include <cmath>

using namespace gsh;

namespace {

/// A town of 400 Gaussians: 100 units wide, scales of 2 to 8 units.
GaussianCloud<float> town() {
    auto cloud = test::splat_cloud(400, 0);
    test::Rng rng(3);
    for (auto& mean : cloud.means) mean = vec3<float>(rng.vec() * 50.0);
    for (auto& s : cloud.log_scales) s = vec3<float>(rng.vec(0.7, 2.1));
    return cloud;
}

} // namespace

TEST_CASE("positive scales that are logarithms are suspected, lengths are not") {
    GaussianCloud<float> logarithms = town(), lengths = logarithms;
    for (auto& s : lengths.log_scales)
        for (int k = 0; k < 3; ++k) s[k] = std::exp(s[k]);
    CHECK(detail::may_be_logarithms(logarithms));
    CHECK(!detail::may_be_logarithms(lengths));
    CHECK(!detail::has_negative_scale(logarithms));
    logarithms.log_scales[7].y = -0.1f;
    CHECK(detail::has_negative_scale(logarithms));
    // Small Gaussians, far apart, in metres: those of a person, and dust.
    for (const double size : {1e-3, 0.05}) {
        auto person = test::splat_cloud(500, 0);
        for (auto& s : person.log_scales) s = vec3<float>(static_cast<float>(size));
        CHECK(!detail::may_be_logarithms(person));
    }
    CHECK(!detail::may_be_logarithms(GaussianCloud<float>(3, 0)));
}

TEST_CASE("lengths become logarithms, and logarithms stay") {
    GaussianCloud<float> cloud(2, 0), same(1, 0);
    cloud.log_scales = {{1, 0.5f, 0}, {2, 3, 4}};
    detail::finish_gltf_scales(cloud, false);
    CHECK(cloud.log_scales[0].x == 0);
    CHECK(cloud.log_scales[0].y == doctest::Approx(-0.693147));
    CHECK(cloud.log_scales[0].z == doctest::Approx(-20.7233));
    same.log_scales = {{-5, 1, 2}};
    detail::finish_gltf_scales(same, true);
    CHECK(same.log_scales[0] == vec3<float>(-5, 1, 2));
}
