// SPDX-License-Identifier: Apache-2.0
/// Long and large work, with bounds on memory and waiting: gsh-load LOAD [--NAME NUMBER]. scripts/load runs all loads.
#define DOCTEST_CONFIG_IMPLEMENT // helpers of the tests use doctest's checks
#include "load/load.hpp"

#include <CLI/CLI.hpp>
#include <doctest/doctest.h>

#include <cstddef>
#include <exception>
#include <iostream>

int main(int argc, char** argv) {
    using namespace gsh::load;
    doctest::Context checks;
    checks.setAsDefaultForAssertsOutOfTestCases();

    std::size_t frames = 100'000, pages = 64, people = 64, steps = 40;
    double seconds = 600;
    Verdict verdict;
    CLI::App app("Long and large work, with bounds on memory and waiting");
    app.require_subcommand(1);
    auto* const poses = app.add_subcommand("poses", "poses and draws an avatar");
    auto* const motion = app.add_subcommand("motion", "a motion through files");
    for (auto* const load : {poses, motion})
        load->add_option("--frames", frames)->check(CLI::PositiveNumber)->capture_default_str();
    poses->callback([&] { pose_and_draw(frames, verdict); });
    motion->callback([&] { long_motion(frames, verdict); });
    auto* const served = app.add_subcommand("pages", "gsh-view's server under many pages");
    served->add_option("--pages", pages)->check(CLI::Range(2, 200))->capture_default_str();
    served->add_option("--seconds", seconds)->check(CLI::PositiveNumber)->capture_default_str();
    served->callback([&] { serve_pages(pages, seconds, verdict); });
    auto* const cast = app.add_subcommand("people", "many people in one training");
    cast->add_option("--people", people)->check(CLI::PositiveNumber)->capture_default_str();
    cast->add_option("--steps", steps)->check(CLI::PositiveNumber)->capture_default_str();
    cast->callback([&] { train_people(people, steps, verdict); });
    try {
        app.parse(argc, argv);
        return verdict.exit_code();
    } catch (const CLI::ParseError& error) {
        return app.exit(error) == 0 ? 0 : 2;
    } catch (const std::exception& error) {
        std::cerr << "gsh-load: " << error.what() << '\n';
        return 2;
    }
}
