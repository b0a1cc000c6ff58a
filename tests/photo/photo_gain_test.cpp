// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/image/color.hpp>
#include <gsh/photo/photo_gain.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Photographs 0, 2, 4, … of camera 0 and 1, 3, 5, … of camera 1; their pixels are not read.
std::vector<Photo> photos_of_two_cameras(std::size_t count) {
    std::vector<Photo> photos(count);
    for (std::size_t p = 0; p < count; ++p) photos[p].name = std::to_string(p), photos[p].camera_index = p % 2;
    return photos;
}

using Gains = PhotoGains<cpu::Serial, double>;

/// Gains that differ, by steps with given gradients: that of a sum of splats' colours.
void scatter(Gains& gains, std::size_t photos) {
    for (std::size_t visit = 1; visit < 4; ++visit)
        for (std::size_t p = 0; p < photos; ++p) {
            const std::vector<vec3<double>> colors{{0.3, 0.5, 0.7}};
            const double sign = p % 3 == 0 ? -1 : 1;
            std::vector<vec3<double>> dL{{sign, -2 * sign, 0.1 * static_cast<double>(p + visit) - 0.4}};
            gains.backward(p, colors, dL);
            gains.step(p, static_cast<std::int64_t>(visit));
        }
}

} // namespace

TEST_CASE("a gain multiplies linear light: exactly above the toe of the sRGB curve, to 0.005 below") {
    for (double log_gain = -0.69; log_gain < 0.7; log_gain += 0.06) {
        CAPTURE(log_gain);
        const Gain<double> gain(log_gain);
        double largest = 0, jump = 0, before = gain(-0.1);
        for (double s = -0.1; s <= 1; s += 1e-3) {
            const double exact = linear_to_srgb(std::exp(log_gain) * srgb_to_linear(s)), found = gain(s);
            if (s > 0.04045 && exact > 0.04045) CHECK(found == doctest::Approx(exact).epsilon(1e-12));
            if (s >= 0) largest = std::max(largest, std::abs(found - exact));
            jump = std::max(jump, std::abs(found - before));
            before = found;
        }
        CHECK(largest < 5e-3);
        CHECK(jump < 3e-3); // in steps of 0.001: no jump
    }
    for (const double s : {-0.2, 0.0, 0.02, 0.3, 1.0}) CHECK(Gain<double>(0.0)(s) == doctest::Approx(s).epsilon(1e-14));
}

TEST_CASE("the adjoint of gains is the gradient, with respect to colours and to log gains") {
    cpu::Serial backend;
    Gains gains(backend, photos_of_two_cameras(5), {.rate = 0.2});
    scatter(gains, 5);
    test::Rng rng(3);
    std::vector<vec3<double>> colors = rng.vecs(40, -0.1, 1.1), weights = rng.vecs(40);
    std::vector<vec3<double>> results = colors, dL_dcolors = weights;
    gains.apply(3, results);
    gains.backward(3, results, dL_dcolors);
    const vec3<double> dL_dlog_gains = gains.gradient()[0];

    const auto value = [&](const std::vector<vec3<double>>& of, const vec3<double>& log_gains) {
        double sum = 0;
        for (std::size_t i = 0; i < of.size(); ++i)
            for (int c = 0; c < 3; ++c) sum += weights[i][c] * Gain<double>(log_gains[c])(of[i][c]);
        return sum;
    };
    const std::array<double, 3> gain = gains.gains()[3];
    vec3<double> log_gains(std::log(gain[0]), std::log(gain[1]), std::log(gain[2]));
    CHECK(std::abs(log_gains.x) > 0.05); // else the test shows little
    double sum = 0;
    for (std::size_t i = 0; i < results.size(); ++i) sum += dot(weights[i], results[i]);
    CHECK(value(colors, log_gains) == doctest::Approx(sum).epsilon(1e-12));
    const auto of_both = [&] { return value(colors, log_gains); };
    test::check_gradient(of_both, test::scalars(colors), test::scalars(dL_dcolors));
    test::check_gradient(of_both, test::scalars(log_gains), Span<const double>(&dL_dlog_gains.x, 3));

    gains.backward(3, results, weights); // adds
    CHECK(length(gains.gradient()[0] - 2.0 * dL_dlog_gains) < 1e-12 * length(dL_dlog_gains));
    gains.forget_gradient();
    CHECK(gains.gradient()[0] == vec3<double>(0));
}

TEST_CASE("a step moves one photograph and the mean of its camera stays") {
    cpu::Serial backend;
    Gains gains(backend, photos_of_two_cameras(7), {.rate = 0.1});
    scatter(gains, 7);
    const auto before = gains.gains();
    std::vector<vec3<double>> dL{{1, 1, -1}};
    gains.backward(4, std::vector<vec3<double>>{{0.5, 0.5, 0.5}}, dL);
    gains.step(4, 4);
    const auto after = gains.gains();
    for (std::size_t c = 0; c < 3; ++c) {
        double sum[2] = {};
        for (std::size_t p = 0; p < 7; ++p) {
            sum[p % 2] += std::log(after[p][c]);
            if (p % 2) CHECK(after[p][c] == before[p][c]); // the other camera
            else if (p != 4)
                CHECK(std::log(after[p][c] / before[p][c]) == doctest::Approx(std::log(after[0][c] / before[0][c])));
        }
        CHECK(std::abs(sum[0]) < 1e-12);
        CHECK(std::abs(sum[1]) < 1e-12);
        CHECK(std::log(after[4][c] / before[4][c]) == doctest::Approx(-3 * std::log(after[0][c] / before[0][c])));
    }
}

TEST_CASE("gains of photographs are recovered, up to their mean over a camera") {
    constexpr std::size_t count = 12;
    cpu::Serial backend;
    Gains gains(backend, photos_of_two_cameras(count), {.rate = 0.03});
    test::Rng rng(9);
    const std::vector<vec3<double>> scene = rng.vecs(50, 0.1, 0.9);
    std::vector<std::array<double, 3>> truth(count); // logarithms
    for (auto& photo : truth)
        for (double& number : photo) number = rng.uniform(-0.2, 0.2);
    for (std::size_t camera = 0; camera < 2; ++camera)
        for (std::size_t c = 0; c < 3; ++c) {
            double mean = 0;
            for (std::size_t p = camera; p < count; p += 2) mean += truth[p][c] / (count / 2);
            for (std::size_t p = camera; p < count; p += 2) truth[p][c] -= mean;
        }
    for (std::int64_t visit = 1; visit <= 120; ++visit)
        for (std::size_t p = 0; p < count; ++p) {
            std::vector<vec3<double>> seen = scene, dL(scene.size());
            gains.apply(p, seen);
            for (std::size_t i = 0; i < scene.size(); ++i)
                for (int c = 0; c < 3; ++c)
                    dL[i][c] = seen[i][c] - Gain<double>(truth[p][static_cast<std::size_t>(c)])(scene[i][c]);
            gains.backward(p, seen, dL);
            gains.step(p, visit, visit < 80 ? 1 : 0.1);
        }
    const auto found = gains.gains();
    double worst = 0;
    for (std::size_t p = 0; p < count; ++p)
        for (std::size_t c = 0; c < 3; ++c) worst = std::max(worst, std::abs(std::log(found[p][c]) - truth[p][c]));
    CHECK(worst < 0.01);
}

TEST_CASE("without a rate nothing is multiplied, and wrong input is refused") {
    cpu::Serial backend;
    Gains none(backend, photos_of_two_cameras(2));
    std::vector<vec3<double>> colors{{0.1, 0.2, 0.3}};
    none.apply(0, colors);
    CHECK(colors[0] == vec3<double>(0.1, 0.2, 0.3));
    CHECK(!none.learns(1));
    CHECK_THROWS_WITH_AS(Gains(backend, {}, {.rate = -1}),
                         "PhotoGains: gain.rate is -1, expected a finite number of at least 0", ValueError);
    Gains gains(backend, photos_of_two_cameras(2), {.rate = 1, .start = 0.5});
    CHECK(!gains.learns(0.4));
    CHECK(gains.learns(0.5));
    CHECK_THROWS_AS(gains.apply(2, colors), ValueError);
    std::vector<vec3<double>> two(2);
    CHECK_THROWS_AS(gains.backward(0, colors, two), ShapeError);
}
