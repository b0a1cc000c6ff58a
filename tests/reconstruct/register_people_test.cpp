// SPDX-License-Identifier: Apache-2.0
/// The registration of an input's people: what it replaces, what it tells, and what it leaves alone.
#include "reconstruct/small_people.hpp"
#include "support/contains.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/register_people.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

using namespace gsh;
using test::small_input;
using test::small_recipe;

namespace {

/// Ann's motion, 6 cm beside where she is.
ReconstructionInput moved_input() {
    ReconstructionInput input = small_input();
    for (auto& transl : input.people[0].motion.transl) transl.y += 0.06;
    return input;
}

} // namespace

TEST_CASE("registered people are nearer to the photographs, and the summary says how far they moved") {
    cpu::Threads backend(2);
    ReconstructionInput input = moved_input();
    Recipe recipe = small_recipe();
    recipe.refine = true;
    const Motion truth = test::small_actors().ann;
    const auto away = [&] {
        return joint_errors(input.body(), input.people[0].motion, truth, RootAlignment::none).mean_mm;
    };
    const double before = away();
    register_people(backend, input, recipe);
    CHECK(before > 55);
    CHECK(away() < 0.6 * before);
    REQUIRE(input.registration.has_value());
    const RegistrationSummary& summary = *input.registration;
    CHECK(summary.psnr > 15);
    CHECK(summary.frame_fit.size() == 2);
    CHECK(summary.frame_weights == std::vector<double>{1, 1}); // two frames do not show what is usual
    REQUIRE(summary.people.size() == 1);
    CHECK(summary.people[0].joints_mm > 20);
    CHECK(summary.text() == test::contains("joints moved by "));
    CHECK(summary.text() != test::contains("keypoints"));
    CHECK(!summary.focal.has_value());
}

TEST_CASE("a body without triangles is not registered, and the input says so") {
    cpu::Threads backend(2);
    ReconstructionInput input = moved_input();
    input.bodies[0].faces.clear();
    CHECK(!input.has_meshes());
    const Motion before = input.people[0].motion;
    register_people(backend, input, small_recipe());
    CHECK(!input.registration.has_value());
    CHECK(input.people[0].motion.transl == before.transl);
    REQUIRE(input.warnings.size() == 1);
    CHECK(input.warnings[0] == "the body of person has no triangles, so poses are not registered before training");
}

TEST_CASE("the text of a summary has each person and what was learned") {
    RegistrationSummary summary{.psnr = 31.46, .keypoints = 12, .focal = 1.021, .people = {}};
    summary.people = {{"ann", 12.4, 8.6, 0.25}, {"bob", 3.2, 2.4, 0}};
    CHECK(
        summary.text() ==
        "the registered bodies explain the photographs to 31.5 dB, ann: joints moved by 12 mm (9 mm relative to the "
        "root), the shape by 0.25 per coefficient, bob: joints moved by 3 mm (2 mm relative to the root), the shape by "
        "0.00 per coefficient, the focal length by 2.1%, with keypoints in 12 photographs");
}
