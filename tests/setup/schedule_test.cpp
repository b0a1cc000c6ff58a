// SPDX-License-Identifier: Apache-2.0
#include <gsh/core/error.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/setup/schedule.hpp>

#include <doctest/doctest.h>

#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t many = 1'000'000; // Gaussians

} // namespace

TEST_CASE("without a schedule, there is one stage with everything") {
    for (const double progress : {0.0, 0.5, 1.0}) CHECK(ScheduleParams().at(progress, many) == TrainingStage{});
}

TEST_CASE("the number of Gaussians doubles in equal intervals, until all take part") {
    const ScheduleParams schedule{.stride = 8, .all_points = 0.6};
    const std::vector<std::pair<double, std::size_t>> expected{{0, 8},   {0.19, 8}, {0.2, 4}, {0.39, 4},
                                                               {0.4, 2}, {0.59, 2}, {0.6, 1}, {1, 1}};
    for (const auto& [progress, stride] : expected) {
        CAPTURE(progress);
        CHECK(schedule.at(progress, many) == TrainingStage{.stride = stride, .stored = false});
    }
    const ScheduleParams at_once{.stride = 8, .all_points = 0};
    CHECK(at_once.at(0, many) == TrainingStage{});
}

TEST_CASE("colours are stored from their share on, but not before all Gaussians take part") {
    ScheduleParams schedule{.stored = 0.3};
    CHECK(!schedule.at(0.29, many).stored);
    CHECK(schedule.at(0.3, many).stored);
    CHECK(schedule.at(1, many).stored);
    schedule = {.stride = 2, .all_points = 0.5, .stored = 0.3};
    CHECK(schedule.at(0.4, many) == TrainingStage{.stride = 2, .stored = false});
    CHECK(schedule.at(0.5, many) == TrainingStage{.stride = 1, .stored = true});
    schedule.stored = 1; // never, not even at the end
    CHECK(!schedule.at(1, many).stored);
}

TEST_CASE("a stage does not begin with fewer Gaussians than are worth it") {
    const ScheduleParams schedule{.stride = 4, .least_points = 10000, .all_points = 0.4};
    CHECK(schedule.at(0, 40000).stride == 4);
    CHECK(schedule.at(0, 39999).stride == 2);
    CHECK(schedule.at(0.39, 39999).stride == 2); // the stages that are left share the time
    CHECK(schedule.at(0.4, 39999).stride == 1);
    CHECK(schedule.at(0, 19999).stride == 1);
    CHECK(schedule.at(0, 0).stride == 1);
}

TEST_CASE("stages come in an order") {
    const std::vector<TrainingStage> stages{{4, false}, {2, false}, {1, false}, {1, true}};
    for (std::size_t a = 0; a < stages.size(); ++a)
        for (std::size_t b = 0; b < stages.size(); ++b) CHECK(stages[a].comes_after(stages[b]) == (a > b));
}

TEST_CASE("colours that change with the time, and named appearances, are not stored") {
    Configuration c;
    c.schedule.stored = 0.3;
    CHECK(c.stage_at(0.5, many).stored);
    CHECK(c.usual_steps() == 1500);
    c.avatar.head_time = true;
    CHECK(!c.stage_at(0.5, many).stored);
    CHECK(c.usual_steps() == 3000);
    c.avatar.head_time = false, c.avatar.appearance_type = "shared_field";
    CHECK(!c.stage_at(0.5, many).stored);
}

namespace {

/// Appearances without StoredAttributes.
struct FewerParts : AvatarParts {
    template <Backend B, std::floating_point T, int Degree, int Levels, int Features>
    using Appearances = NamedTypes<Named<"shared_field", SharedField<B, T, Degree, Levels, Features>>>;
};

} // namespace

TEST_CASE("settings of a schedule are checked before training") {
    Configuration c;
    CHECK_THROWS_WITH_AS(set_setting(c, "schedule.stride", "3", "test"),
                         doctest::Contains("schedule.stride is '3', expected a power of two"), ValueError);
    CHECK_THROWS_WITH_AS(set_setting(c, "schedule.stored", "1.5", "test"), doctest::Contains("at most 1"), ValueError);
    c.schedule.stored = 0.3;
    check_settings(c, "test");
    CHECK_THROWS_WITH_AS(check_settings<FewerParts>(c, "test"),
                         doctest::Contains("schedule.stored: appearance is 'stored', expected one of shared_field"),
                         ValueError);
}
