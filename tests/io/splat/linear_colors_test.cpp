// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/linear_colors.hpp>

#include "io/splat_clouds.hpp"

#include <gsh/core/rng.hpp>

#include <cmath>

using namespace gsh;

TEST_CASE("with bands, the fit is nearer to the converted colours than the curve's slope at the constant colour") {
    auto cloud = test::splat_cloud(30, 3);
    test::Rng rng(5);
    for (std::size_t k = 0; k < cloud.sh.size(); ++k) // bright enough to stay above 0
        cloud.sh[k] = k % 16 ? vec3<float>(rng.vec() * 0.05) : vec3<float>(rng.vec(-0.5, 1.2));
    auto converted = cloud, sloped = cloud;
    constexpr double Y = 0.28209479177387814;
    for (std::size_t k = 0; k < sloped.sh.size(); ++k)
        for (int c = 0; c < 3; ++c) {
            const double constant = double(cloud.sh[k / 16 * 16][c]) * Y + 0.5;
            double slope = 0;
            linear_to_srgb_backward(constant, 1.0, slope);
            sloped.sh[k][c] =
                static_cast<float>(k % 16 ? double(cloud.sh[k][c]) * slope : (linear_to_srgb(constant) - 0.5) / Y);
        }
    const double stated = detail::convert_linear_colors(converted);
    double of_fit = 0, of_slope = 0;
    constexpr int directions = 500;
    for (std::size_t i = 0; i < cloud.size(); ++i)
        for (int d = 0; d < directions; ++d) {
            const vec3<float> dir(normalize(rng.vec()));
            const auto color = [&](const GaussianCloud<float>& of) {
                return shade<3>(&of.sh[i * 16], dir, 1.0f, ColorClamp::below);
            };
            const vec3<float> linear = color(cloud);
            for (int c = 0; c < 3; ++c) {
                const double wanted = std::min(linear_to_srgb(double(linear[c])), 1.0);
                of_fit += std::pow(std::min<double>(color(converted)[c], 1) - wanted, 2);
                of_slope += std::pow(std::min<double>(color(sloped)[c], 1) - wanted, 2);
            }
        }
    const double share = 1.0 / (3 * directions * double(cloud.size()));
    CHECK(std::sqrt(of_fit * share) == doctest::Approx(stated).epsilon(0.2));
    CHECK(of_fit < 0.8 * of_slope);
    CHECK(stated > 1e-4);
    CHECK(stated < 0.02);
}
