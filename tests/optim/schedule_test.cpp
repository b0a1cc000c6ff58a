// SPDX-License-Identifier: Apache-2.0
#include <gsh/optim/schedule.hpp>

#include <doctest/doctest.h>

using namespace gsh;

TEST_CASE("a constant schedule starts where it is told") {
    const Schedule schedule = Schedule::constant(0.01, 5);
    CHECK(schedule.rate(4) == 0);
    CHECK_FALSE(schedule.active(4));
    CHECK(schedule.update_number(4) == 0);
    CHECK(schedule.rate(5) == 0.01);
    CHECK(schedule.update_number(5) == 1);
    CHECK(schedule.rate(100000) == 0.01);
}

TEST_CASE("an exponential schedule falls by equal factors and then stays") {
    const Schedule schedule = Schedule::exponential(1e-2, 1e-4, 10, 3);
    CHECK(schedule.rate(2) == 0);
    CHECK(schedule.rate(3) == 1e-2);
    CHECK(schedule.rate(8) == doctest::Approx(1e-3));
    CHECK(schedule.rate(9) / schedule.rate(8) == doctest::Approx(schedule.rate(6) / schedule.rate(5)));
    CHECK(schedule.rate(13) == 1e-4);
    CHECK(schedule.rate(1000) == 1e-4);
}
