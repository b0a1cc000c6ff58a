// SPDX-License-Identifier: Apache-2.0
/// @file  A merged Gaussian has the moments of a mixture and covers as much, compared with sums over a grid.
#include <gsh/gaussian/merged_gaussian.hpp>

#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

using namespace gsh;

namespace {

PlainGaussian some_gaussian(test::Rng& rng) {
    return {rng.vec(-0.02, 0.02),
            {rng.normal(), rng.normal(), rng.normal(), rng.normal()},
            rng.vec(-6, -3.5),
            rng.uniform(-2, 2)};
}

/// A disc in the plane z = 0 with a standard deviation along x and one along y.
PlainGaussian disc(double x, double y, double along_x, double along_y, double opacity) {
    return {{x, y, 0}, {1, 0, 0, 0}, {std::log(along_x), std::log(along_y), std::log(1e-4)}, logit(opacity)};
}

/// What discs cover in the plane z = 0: the integral of 1 - Π (1 - α_i g_i).
double covered_on_grid(const std::vector<PlainGaussian>& discs) {
    constexpr double step = 2e-4, reach = 0.1;
    double sum = 0;
    for (double y = -reach; y < reach; y += step)
        for (double x = -reach; x < reach; x += step) {
            double through = 1;
            for (const PlainGaussian& d : discs) {
                const double u = (x - d.mean.x) / std::exp(d.log_scale.x), v = (y - d.mean.y) / std::exp(d.log_scale.y);
                through *= 1 - sigmoid(d.opacity_logit) * std::exp(-0.5 * (u * u + v * v));
            }
            sum += (1 - through) * step * step;
        }
    return sum;
}

double area_of(const PlainGaussian& gaussian) {
    return detail::covered_area(glm::exp(gaussian.log_scale));
}

} // namespace

TEST_CASE("a mixture has the moments of its Gaussians in whatever order they are added") {
    test::Rng rng(4);
    std::vector<PlainGaussian> all;
    for (int i = 0; i < 6; ++i) all.push_back(some_gaussian(rng));
    double mass = 0;
    vec3<double> mean(0);
    for (const PlainGaussian& g : all) {
        const double m = sigmoid(g.opacity_logit) * area_of(g);
        mass += m, mean += g.mean * m;
    }
    mean = mean * (1 / mass);
    mat3<double> second(0.0); // about the mean
    for (const PlainGaussian& g : all) {
        const vec3<double> d = g.mean - mean;
        second +=
            (full_matrix(covariance(g.q, g.log_scale)) + outer(d, d)) * (sigmoid(g.opacity_logit) * area_of(g) / mass);
    }
    const auto check = [&](const GaussianMixture& found) {
        CHECK(found.mass == doctest::Approx(mass).epsilon(1e-12));
        CHECK(length(found.mean - mean) < 1e-14);
        const mat3<double> covariance = full_matrix(found.covariance);
        for (int c = 0; c < 3; ++c) CHECK(length(covariance[c] - second[c]) < 1e-16);
    };
    GaussianMixture row = mixture_of(all[0]);
    for (std::size_t i = 1; i < all.size(); ++i) row = merged(row, mixture_of(all[i]));
    check(row);
    check(
        merged(merged(mixture_of(all[5]), mixture_of(all[2])),
               merged(merged(mixture_of(all[0]), mixture_of(all[4])), merged(mixture_of(all[1]), mixture_of(all[3])))));
}

TEST_CASE("the Gaussian of a mixture has its moments") {
    test::Rng rng(5);
    for (int round = 0; round < 20; ++round) {
        PlainGaussian a = some_gaussian(rng), b = some_gaussian(rng);
        a.opacity_logit = b.opacity_logit = -3; // faint enough to keep the area of the moments
        const GaussianMixture both = merged(mixture_of(a), mixture_of(b));
        const PlainGaussian found = gaussian_of(both);
        CHECK(found.mean == both.mean);
        const mat3<double> covariance = full_matrix(gsh::covariance(found.q, found.log_scale)),
                           expected = full_matrix(both.covariance);
        for (int c = 0; c < 3; ++c) CHECK(length(covariance[c] - expected[c]) < 1e-12);
        CHECK(sigmoid(found.opacity_logit) * area_of(found) == doctest::Approx(both.coverage));
    }
}

TEST_CASE("a mixture of one is its Gaussian") {
    test::Rng rng(6);
    for (int round = 0; round < 10; ++round) {
        const PlainGaussian one = some_gaussian(rng), again = gaussian_of(mixture_of(one));
        CHECK(length(again.mean - one.mean) == 0);
        CHECK(again.opacity_logit == doctest::Approx(one.opacity_logit).epsilon(1e-6));
        const mat3<double> a = full_matrix(covariance(one.q, one.log_scale)),
                           b = full_matrix(covariance(again.q, again.log_scale));
        for (int c = 0; c < 3; ++c) CHECK(length(a[c] - b[c]) < 1e-12);
    }
}

TEST_CASE("two discs cover together what a sum over pixels says") {
    for (const double apart : {0.0, 0.005, 0.02, 0.06})
        for (const double opacity : {0.2, 0.7, 0.95}) {
            const PlainGaussian a = disc(-apart / 2, 0.002, 0.01, 0.006, opacity),
                                b = disc(apart / 2, -0.002, 0.005, 0.012, 0.6);
            CHECK(merged(mixture_of(a), mixture_of(b)).coverage ==
                  doctest::Approx(covered_on_grid({a, b})).epsilon(1e-4));
        }
}

TEST_CASE("opacities end at 0.99, and what covers more gets a larger area") {
    // Ten opaque discs behind one another in a plane cover hardly more than one does.
    const PlainGaussian one = disc(0, 0, 0.01, 0.01, 0.9);
    GaussianMixture stack = mixture_of(one);
    for (int i = 0; i < 9; ++i) stack = merged(stack, mixture_of(one));
    const PlainGaussian found = gaussian_of(stack);
    CHECK(sigmoid(found.opacity_logit) == doctest::Approx(0.99));
    CHECK(area_of(found) <= 2 * area_of(one) * (1 + 1e-9));
    // Two of them side by side overlap little, and their mixture covers no more area than they do.
    const PlainGaussian left = disc(-0.01, 0, 0.01, 0.01, 0.95), right = disc(0.01, 0, 0.01, 0.01, 0.95);
    const GaussianMixture pair = merged(mixture_of(left), mixture_of(right));
    const PlainGaussian joined = gaussian_of(pair);
    CHECK(sigmoid(joined.opacity_logit) == doctest::Approx(0.99));
    CHECK(0.99 * area_of(joined) == doctest::Approx(pair.coverage));
    CHECK(std::exp(joined.log_scale.x + joined.log_scale.y + joined.log_scale.z) > 0);
}

TEST_CASE("an invisible Gaussian changes nothing but is not lost alone") {
    PlainGaussian faint = disc(0.01, 0, 0.01, 0.01, 0.5), seen = disc(0, 0, 0.01, 0.01, 0.5);
    faint.opacity_logit = -1000;
    const GaussianMixture both = merged(mixture_of(seen), mixture_of(faint));
    CHECK(length(both.mean) < 1e-12);
    const GaussianMixture none = merged(mixture_of(faint), mixture_of(faint));
    CHECK(length(none.mean - faint.mean) < 1e-15);
    CHECK(std::isfinite(gaussian_of(none).opacity_logit));
    CHECK(sigmoid(gaussian_of(none).opacity_logit) < 1e-5);
}
