// SPDX-License-Identifier: Apache-2.0
/// @file  Clouds for tests of splat formats, and bounds on what a format may change.
#pragma once

#include "support/gradient.hpp"

#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/activation.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace gsh::test {

/// Gaussians as of a person: within a box of two metres, a few millimetres to centimetres large.
inline GaussianCloud<float> splat_cloud(std::size_t count, int degree, std::uint64_t seed = 8) {
    GaussianCloud<float> cloud(count, degree);
    Rng rng(seed);
    const auto basis = static_cast<std::size_t>((degree + 1) * (degree + 1));
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec3<float>(rng.vec());
        cloud.log_scales[i] = vec3<float>(rng.vec(-7, -3));
        const auto q = rng.quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.opacity_logits[i] = static_cast<float>(rng.uniform(-4, 4));
        for (std::size_t k = 0; k < basis; ++k) cloud.sh[i * basis + k] = vec3<float>(rng.vec() * (k ? 0.4 : 1.7));
    }
    return cloud;
}

/// The largest differences that a format may make. Rotations: of an entry of their matrices.
struct SplatTolerance {
    double mean = 0, log_scale = 0, rotation = 0, opacity = 0, dc = 0, rest = 0;
};

inline void check_near(const GaussianCloud<float>& found, const GaussianCloud<float>& expected,
                       const SplatTolerance& tolerance) {
    REQUIRE(found.size() == expected.size());
    REQUIRE(found.sh_degree == expected.sh_degree);
    const auto basis = static_cast<std::size_t>(sh_basis_count(expected.sh_degree));
    SplatTolerance largest;
    const auto raise = [](double& value, const vec3<float>& difference) {
        for (int k = 0; k < 3; ++k) value = std::max(value, double(std::abs(difference[k])));
    };
    for (std::size_t i = 0; i < expected.size(); ++i) {
        raise(largest.mean, found.means[i] - expected.means[i]);
        raise(largest.log_scale, found.log_scales[i] - expected.log_scales[i]);
        const mat3<float> a = rotation_matrix(normalize(found.quats[i])),
                          b = rotation_matrix(normalize(expected.quats[i]));
        for (int c = 0; c < 3; ++c) raise(largest.rotation, a[c] - b[c]);
        largest.opacity = std::max<double>(
            largest.opacity, std::abs(sigmoid(found.opacity_logits[i]) - sigmoid(expected.opacity_logits[i])));
        for (std::size_t k = 0; k < basis; ++k)
            raise(k ? largest.rest : largest.dc, found.sh[i * basis + k] - expected.sh[i * basis + k]);
    }
    CHECK(largest.mean <= tolerance.mean);
    CHECK(largest.log_scale <= tolerance.log_scale);
    CHECK(largest.rotation <= tolerance.rotation);
    CHECK(largest.opacity <= tolerance.opacity);
    CHECK(largest.dc <= tolerance.dc);
    CHECK(largest.rest <= tolerance.rest);
}

} // namespace gsh::test
