// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/learn/learned_light.hpp>
#include <gsh/optim/adam.hpp>

#include "support/guarded.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace gsh {
namespace {

LightData uneven_light() {
    LightData light = even_light(2, 3, {0.1, 0.8, -0.2}, 3);
    for (std::size_t k = 0; k < light.size(); ++k) light.log_intensities[k] += 0.1 * static_cast<double>(k) - 0.3;
    return light;
}

void check_equal(const LightData& found, const LightData& expected) {
    CHECK(found.points == expected.points);
    CHECK(found.directions == expected.directions);
    CHECK(found.log_intensities == expected.log_intensities);
    CHECK(found.gloss == expected.gloss);
    CHECK(found.shadows == expected.shadows);
}

} // namespace

TEST_CASE("a light comes back from a backend's memory as it was, and can be replaced") {
    test::Guarded backend;
    LightData light = uneven_light();
    light.shadows = false;
    LearnedLight<test::Guarded, double> learned(backend, light);
    check_equal(learned.data(), light);
    CHECK_FALSE(learned.shadows());
    const LightData other = even_light(1, 6, {0, 1, 0}, 2);
    learned.set(other);
    check_equal(learned.data(), other);
    CHECK(learned.shadows());
    CHECK(learned.view().size() == 7);
    CHECK(learned.gradient().log_intensities.size() == 7);
}

TEST_CASE("the first intensity is the unit and stays; all else of a light learns, but not its directions") {
    for (const LightData& start : {uneven_light(), even_light(1, 0, {0, 1, 0}, 2), even_light(0, 2, {0, 1, 0}, 2)}) {
        cpu::Serial backend;
        LearnedLight<cpu::Serial, double> light(backend, start,
                                                {.points = 0.01, .log_intensities = 0.02, .gloss = 0.03});
        for (int step = 1; step <= 3; ++step)
            for (const LearnedArray<double>& array : light.learned()) {
                for (double& number : array.gradient) number = 1;
                take_step(backend, Adam(), array, 1.0, step);
                for (const double number : array.gradient) CHECK(number == 0);
            }
        const LightData after = light.data();
        CHECK(after.log_intensities[0] == start.log_intensities[0]);
        for (std::size_t k = 1; k < start.size(); ++k)
            CHECK(after.log_intensities[k] == doctest::Approx(start.log_intensities[k] - 0.06));
        for (std::size_t k = 0; k < start.points.size(); ++k)
            for (int axis = 0; axis < 3; ++axis)
                CHECK(after.points[k][axis] == doctest::Approx(start.points[k][axis] - 0.03));
        for (const int k : {0, 1})
            CHECK(after.gloss[static_cast<std::size_t>(k)] ==
                  doctest::Approx(start.gloss[static_cast<std::size_t>(k)] - 0.09));
        CHECK(after.directions == start.directions);
    }
}

TEST_CASE("a light that cannot be used is refused") {
    cpu::Serial backend;
    const auto made = [&](const LightData& light) { return LearnedLight<cpu::Serial>(backend, light).view().size(); };
    CHECK(made(uneven_light()) == 5);
    LightData light = uneven_light();
    light.log_intensities.pop_back();
    CHECK_THROWS_AS(made(light), ShapeError);
    light = uneven_light();
    light.gloss.clear();
    CHECK_THROWS_AS(made(light), ShapeError);
    light = uneven_light();
    light.points[1].y = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS(made(light), ValueError);
    light.points.clear(), light.directions.clear(), light.log_intensities.clear();
    CHECK_THROWS_AS(made(light), ValueError);
}

} // namespace gsh
