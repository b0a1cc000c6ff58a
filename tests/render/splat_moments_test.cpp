// SPDX-License-Identifier: Apache-2.0
#include <gsh/render/splat_moments.hpp>
#include <gsh/render/tiles.hpp>

#include "support/gradient.hpp"

#include <cmath>
#include <vector>

using namespace gsh;

TEST_CASE("moments of a splat's pixels give the gradients of its place and shape on the image") {
    test::Rng rng(7);
    struct Splat {
        vec2<double> mean2d{3.3, 4.6};
        sym2<double> covariance{2.5, 0.7, 1.4};
    } splat;
    const double opacity = 0.8;
    struct Pixel {
        double x, y, dL_dalpha;
    };
    std::vector<Pixel> pixels;
    for (int i = 0; i < 40; ++i) pixels.push_back({rng.uniform(0, 7), rng.uniform(0, 8), rng.uniform(-1, 1)});

    const auto alpha_at = [&](const Pixel& p) { // by the inverse, without whitening
        const auto& s = splat.covariance;
        const double dx = p.x - splat.mean2d.x, dy = p.y - splat.mean2d.y, det = s.xx * s.yy - s.xy * s.xy;
        return opacity * std::exp(-0.5 * (s.yy * dx * dx - 2 * s.xy * dx * dy + s.xx * dy * dy) / det);
    };
    const auto loss = [&] {
        double sum = 0;
        for (const Pixel& p : pixels) sum += p.dL_dalpha * alpha_at(p);
        return sum;
    };

    const Whitening<double> W = whiten(splat.covariance);
    SplatMoments<double> moments{};
    for (const Pixel& p : pixels) {
        const double dx = p.x - splat.mean2d.x, dy = p.y - splat.mean2d.y;
        const double u = W.ux * dx + W.uy * dy, v = W.vy * dy, G = p.dL_dalpha * alpha_at(p);
        CHECK(opacity * std::exp2(-(u * u + v * v)) == doctest::Approx(alpha_at(p)));
        moments.u += G * u, moments.v += G * v;
        moments.uu += G * u * u, moments.uv += G * u * v, moments.vv += G * v * v;
    }
    Projection<double> dL{};
    dL.depth = 5, dL.opacity_factor = 6; // stay
    moments_backward(W, moments, dL);
    test::check_gradient(loss, test::scalars(splat.mean2d), test::scalars(dL.mean2d));
    test::check_gradient(loss, test::scalars(splat.covariance), test::scalars(dL.covariance));
    CHECK(dL.depth == 5);
    CHECK(dL.opacity_factor == 6);
}
