// SPDX-License-Identifier: Apache-2.0
#include <gsh/train/stage.hpp>

#include <doctest/doctest.h>

#include <chrono>
#include <cstddef>
#include <numeric>
#include <thread>

using namespace gsh;

TEST_CASE("a clock adds up the time of each stage over the steps") {
    StageClock clock;
    const auto wait = [] { std::this_thread::sleep_for(std::chrono::milliseconds(3)); };
    const auto start = std::chrono::steady_clock::now();
    for (int step = 0; step < 2; ++step) {
        clock.enter(Stage::photo);
        clock.enter(Stage::render), wait();
        clock.enter(Stage::update), wait();
        clock.leave();
        wait(); // between steps no stage runs
    }
    const double all = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const auto& seconds = clock.seconds();
    const auto of = [&](Stage stage) { return seconds[static_cast<std::size_t>(stage)]; };
    CHECK(clock.steps() == 2);
    CHECK(of(Stage::render) >= 0.006);
    CHECK(of(Stage::update) >= 0.006);
    CHECK(of(Stage::pose) == 0);
    CHECK(of(Stage::loss) == 0);
    CHECK(std::accumulate(seconds.begin(), seconds.end(), 0.0) <= all - 0.006);
}

TEST_CASE("every stage has a name, in order") {
    CHECK(stage_names.size() == static_cast<std::size_t>(Stage::update) + 1);
    CHECK(stage_names[static_cast<std::size_t>(Stage::photo)] == "photo");
    CHECK(stage_names[static_cast<std::size_t>(Stage::render_backward)] == "render backward");
    CHECK(stage_names[static_cast<std::size_t>(Stage::update)] == "update");
    CHECK(StageClock().steps() == 0);
}
