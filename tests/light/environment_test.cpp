// SPDX-License-Identifier: Apache-2.0
#include <gsh/light/environment.hpp>

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

namespace gsh {
namespace {

using Radiance = std::function<double(const vec3<double>&)>;

Image<float> environment_of(const Radiance& radiance, int height) {
    Image<float> image(1, height, 2 * height);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < 2 * height; ++x)
            image.at(0, y, x) =
                static_cast<float>(radiance(environment_direction({x + 0.5, y + 0.5}, height, 2 * height)));
    return image;
}

/// A sky that is brighter towards one side, over a dark ground.
double smooth_sky(const vec3<double>& d) { return d.y > 0 ? 1 + d.y + 0.5 * d.x : 0.2 * (1 + d.y); }

/// A disc of 3 degrees about a direction.
Radiance with_sun(const vec3<double>& to_sun, double radiance) {
    return [=](const vec3<double>& d) {
        return smooth_sky(d) + (dot(d, to_sun) > std::cos(3 * std::numbers::pi / 180) ? radiance : 0.0);
    };
}

/// Irradiance by a sum over all pixels.
double summed(const Image<float>& image, const vec3<double>& normal) {
    double sum = 0;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const vec3<double> d = environment_direction({x + 0.5, y + 0.5}, image.height, image.width);
            const double side = std::numbers::pi / image.height;
            sum += static_cast<double>(image.at(0, y, x)) * std::max(0.0, dot(normal, d)) * side * side *
                   std::sqrt(1 - d.y * d.y);
        }
    return sum;
}

/// Irradiance at the origin from the lights.
double lit_from(const LightData& light, const vec3<double>& normal) {
    double sum = 0;
    for (std::size_t k = 0; k < light.size(); ++k) {
        const bool point = k < light.points.size();
        const vec3<double> to = point ? light.points[k] : light.directions[k - light.points.size()];
        const double squared = point ? dot(to, to) : 1.0;
        sum += std::exp(light.log_intensities[k]) * std::max(0.0, dot(normal, normalize(to))) / squared;
    }
    return sum;
}

/// The largest difference of irradiances over normals, where their mean is 1.
double largest_error(const Image<float>& image, const LightData& light) {
    const std::vector<vec3<double>> normals = even_directions(100);
    double mean = 0, mean_lit = 0, worst = 0;
    std::vector<double> expected;
    for (const vec3<double>& n : normals) {
        expected.push_back(summed(image, n)), mean += expected.back() / 100;
        mean_lit += lit_from(light, n) / 100;
    }
    CHECK(mean_lit == doctest::Approx(1).epsilon(0.01)); // of even_light
    for (std::size_t i = 0; i < normals.size(); ++i)
        worst = std::max(worst, std::abs(lit_from(light, normals[i]) - expected[i] / mean));
    return worst;
}

TEST_CASE("the centre of an environment is -z, its right quarter +x, its upper edge +y") {
    const auto near = [](const vec3<double>& a, const vec3<double>& b) { return length(a - b) < 1e-12; };
    CHECK(near(environment_direction({128, 64}, 128, 256), {0, 0, -1}));
    CHECK(near(environment_direction({192, 64}, 128, 256), {1, 0, 0}));
    CHECK(near(environment_direction({64, 64}, 128, 256), {-1, 0, 0}));
    CHECK(near(environment_direction({0, 64}, 128, 256), {0, 0, 1}));
    CHECK(near(environment_direction({70, 0}, 128, 256), {0, 1, 0}));
}

TEST_CASE("the lights of an environment give its irradiance") {
    const vec3<double> to_sun = normalize(vec3<double>(0.5, 0.7, 0.4));
    const auto even = environment_of([](const vec3<double>&) { return 3.0; }, 64);
    CHECK(largest_error(even, environment_light(even.view())) < 0.04);
    const auto sky = environment_of(smooth_sky, 64);
    CHECK(largest_error(sky, environment_light(sky.view())) < 0.04);
    const auto low = environment_of(with_sun(to_sun, 100), 300); // blocks of pixels
    CHECK(largest_error(low, environment_light(low.view())) < 0.04);
    const auto high = environment_of(with_sun(to_sun, 5000), 90);
    CHECK(largest_error(high, environment_light(high.view())) < 0.04);
    const auto coarse = environment_of(smooth_sky, 8);
    CHECK(largest_error(coarse, environment_light(coarse.view(), {.directions = 16})) < 0.08);
}

TEST_CASE("suns and lamps become points, the rest directions") {
    const vec3<double> to_sun = normalize(vec3<double>(0.5, 0.7, 0.4)), to_lamp = normalize(vec3<double>(-1, 0.1, 1));
    const auto sky = environment_light(environment_of(smooth_sky, 64).view());
    CHECK(sky.points.empty());
    CHECK(sky.directions.size() == 24);
    CHECK(sky.gloss.empty());
    CHECK(sky.shadows);
    const auto two = environment_of(
        [&](const vec3<double>& d) {
            return with_sun(to_sun, 2000)(d) + (dot(d, to_lamp) > std::cos(0.1) ? 100 : 0);
        },
        256);
    const vec3<double> center{1, 2, 3};
    const auto light = environment_light(two.view(), {.distance = 50, .center = center});
    REQUIRE(light.points.size() == 2);
    CHECK(light.log_intensities.size() == light.size());
    for (const auto& [point, expected] : {std::pair(0, to_sun), std::pair(1, to_lamp)}) {
        const vec3<double> offset = light.points[static_cast<std::size_t>(point)] - center;
        CHECK(length(offset) == doctest::Approx(50));
        CHECK(dot(normalize(offset), expected) > std::cos(0.02));
    }
    // The sun's solid angle is 2π (1 - cos 3°), that of the lamp 2π (1 - cos 0.1).
    const double solid = (1 - std::cos(3 * std::numbers::pi / 180)) / (1 - std::cos(0.1));
    CHECK(std::exp(light.log_intensities[0] - light.log_intensities[1]) == doctest::Approx(20 * solid).epsilon(0.1));
    CHECK(environment_light(two.view(), {.points = 1}).points.size() == 1);
    CHECK(environment_light(two.view(), {.points = 0}).points.empty());
}

TEST_CASE("an environment that is black but for a lamp is one point") {
    Image<float> image(1, 64, 128, 0.0f);
    image.at(0, 20, 30) = 7;
    const auto light = environment_light(image.view());
    REQUIRE(light.size() == 1);
    CHECK(dot(normalize(light.points[0]), environment_direction({30.5, 20.5}, 64, 128)) > 1 - 1e-6);
    CHECK(std::exp(light.log_intensities[0]) == doctest::Approx(4 * 100.0 * 100.0));
}

TEST_CASE("directions go to where light is") {
    const auto half = environment_of([](const vec3<double>& d) { return d.x > 0 ? 1.0 : 0.0; }, 64);
    const auto light = environment_light(half.view());
    CHECK(light.directions.size() >= 20);
    for (const vec3<double>& d : light.directions) CHECK(d.x > 0);
    CHECK(largest_error(half, light) < 0.04);
}

TEST_CASE("an environment turns about the vertical, and its unit has no meaning") {
    const vec3<double> to_sun = normalize(vec3<double>(0, 0.6, 0.8));
    const auto image = environment_of(with_sun(to_sun, 2000), 64);
    const auto light = environment_light(image.view(), {.turn = std::numbers::pi / 2});
    CHECK(dot(normalize(light.points[0]), vec3<double>(0.8, 0.6, 0)) > 0.9999);

    // A turn is the same as pixels that move to the left.
    Image<float> moved(1, 64, 128), brighter = image;
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 128; ++x) moved.at(0, y, x) = image.at(0, y, (x + 32) % 128);
    const auto same = environment_light(moved.view());
    for (const vec3<double>& n : even_directions(20))
        CHECK(lit_from(light, n) == doctest::Approx(lit_from(same, n)).epsilon(0.03));
    for (float& value : brighter.data) value *= 8;
    CHECK(environment_light(brighter.view()).log_intensities[0] ==
          doctest::Approx(environment_light(image.view()).log_intensities[0]));
}

TEST_CASE("colours count by their luminance") {
    const auto grey = environment_of(smooth_sky, 16);
    Image<float> color(3, 16, 32);
    for (int y = 0; y < 16; ++y)
        for (int x = 0; x < 32; ++x) color.at(1, y, x) = grey.at(0, y, x);
    const auto a = environment_light(grey.view()), b = environment_light(color.view());
    REQUIRE(a.size() == b.size());
    for (std::size_t k = 0; k < a.size(); ++k)
        CHECK(a.log_intensities[k] == doctest::Approx(b.log_intensities[k]).epsilon(1e-3));
}

TEST_CASE("what is no environment is refused") {
    using test::check_throws;
    Image<float> image(3, 4, 8, 1.0f);
    check_throws<ShapeError>([&] { (void)environment_light(Image<float>(3, 4, 6, 1.0f).view()); },
                             {"environment_light", "6 x 4", "twice as wide"});
    check_throws<ShapeError>([&] { (void)environment_light(Image<float>(2, 4, 8, 1.0f).view()); }, {"2 channels"});
    check_throws<ShapeError>([&] { (void)environment_light(Image<float>().view()); }, {"0 x 0"});
    check_throws<ValueError>([&] { (void)environment_light(Image<float>(3, 4, 8).view()); }, {"black"});
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -1.0f}) {
        Image<float> damaged = image;
        damaged.at(1, 2, 5) = bad;
        check_throws<ValueError>([&] { (void)environment_light(damaged.view()); }, {"pixel (5, 2)", "finite"});
    }
    check_throws<ValueError>([&] { (void)environment_light(image.view(), {.directions = 0}); }, {"0 directions"});
    check_throws<ValueError>([&] { (void)environment_light(image.view(), {.points = 100}); }, {"100 points"});
    check_throws<ValueError>([&] { (void)environment_light(image.view(), {.point_angle = 2}); }, {"point_angle"});
    check_throws<ValueError>([&] { (void)environment_light(image.view(), {.distance = 0}); }, {"distance"});
}

} // namespace
} // namespace gsh
