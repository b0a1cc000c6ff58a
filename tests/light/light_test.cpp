// SPDX-License-Identifier: Apache-2.0
#include <gsh/light/light.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace gsh {

TEST_CASE("even directions are unit vectors that are spread over the sphere and have no preferred side") {
    CHECK(even_directions(0).empty());
    for (const std::size_t count : {1, 2, 12, 128}) {
        const std::vector<vec3<double>> directions = even_directions(count);
        REQUIRE(directions.size() == count);
        vec3<double> sum(0);
        for (const auto& d : directions) {
            CHECK(length(d) == doctest::Approx(1));
            sum += d;
        }
        if (count >= 12) CHECK(length(sum) < 0.1 * static_cast<double>(count));
        double nearest = 2;
        for (std::size_t i = 0; i < count; ++i)
            for (std::size_t k = 0; k < i; ++k) nearest = std::min(nearest, length(directions[i] - directions[k]));
        if (count >= 12) CHECK(nearest > 1.5 / std::sqrt(static_cast<double>(count))); // evenly: about 3.5
    }
}

TEST_CASE("an even light gives a facing surface an irradiance of about 1, whichever way it faces") {
    for (const auto& [points, directions] : {std::pair<std::size_t, std::size_t>(0, 64), {64, 0}, {30, 40}}) {
        const vec3<double> center(0.3, 1, -2);
        const LightData light = even_light(points, directions, center, 5);
        REQUIRE(light.size() == points + directions);
        check_light("test", light);
        for (const vec3<double>& normal : even_directions(7)) {
            double irradiance = 0;
            for (std::size_t k = 0; k < light.size(); ++k) {
                const bool is_point = k < points;
                const vec3<double> to = is_point ? light.points[k] - center : light.directions[k - points];
                irradiance += std::exp(light.log_intensities[k]) * std::max(0.0, dot(normal, normalize(to))) /
                              (is_point ? dot(to, to) : 1);
            }
            CHECK(irradiance == doctest::Approx(1).epsilon(0.15));
        }
    }
}

TEST_CASE("a light whose sizes do not fit, that is empty or not finite is refused") {
    LightData light = even_light(2, 3, vec3<double>(0), 1);
    check_light("test", light);
    light.gloss = {1};
    CHECK_THROWS_AS(check_light("test", light), ShapeError);
    light.gloss = {};
    check_light("test", light);
    light.log_intensities.push_back(0);
    CHECK_THROWS_AS(check_light("test", light), ShapeError);
    light.log_intensities.pop_back();
    light.directions[0].x = std::numeric_limits<double>::infinity();
    CHECK_THROWS_AS(check_light("test", light), ValueError);
    CHECK_THROWS_AS(check_light("test", LightData()), ValueError);
}

} // namespace gsh
