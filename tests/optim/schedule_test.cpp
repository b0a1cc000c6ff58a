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

TEST_CASE("what is not said about a schedule: no learning, at a constant rate, from the first step on") {
    CHECK(Schedule{}.rate(0) == 0);
    CHECK(Schedule{}.update_number(0) == 1);
    const Schedule without_steps{.initial = 0.5, .final = 0.1};
    CHECK(without_steps.rate(0) == 0.5);
    CHECK(without_steps.rate(1) == 0.5);
    CHECK(Schedule::constant(0.5).rate(0) == 0.5);
    CHECK(Schedule::constant(0.5).decay_steps == 0);
    CHECK(Schedule::exponential(0.5, 0.1, 10).rate(0) == 0.5);
}

TEST_CASE("a schedule to or from a rate of zero stays where it begins") {
    CHECK(Schedule::exponential(0.5, 0, 10).rate(5) == 0.5);
    CHECK(Schedule::exponential(0, 0.5, 10).rate(5) == 0);
    CHECK(Schedule::exponential(0.5, 0, 10).rate(10) == 0.5);
    CHECK(Schedule::exponential(0, 0.5, 10).rate(10) == 0);
}
