// SPDX-License-Identifier: Apache-2.0
/// A plan counts what a setup then has, and its memory is what a limit of memory is compared with.
#include "reconstruct/small_people.hpp"

#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/plan.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>

using namespace gsh;
using test::small_input;
using test::small_recipe;

TEST_CASE("a plan counts people, images and Gaussians as the setup has them") {
    cpu::Threads host(2);
    for (const std::size_t people : {std::size_t(1), std::size_t(2)}) {
        CAPTURE(people);
        const ReconstructionInput input = small_input(people);
        const Recipe recipe = small_recipe();
        const ReconstructionPlan plan = plan_reconstruction<cpu::Threads>(input, recipe);
        const ReconstructionSetup setup = make_setup(host, input, recipe);
        CHECK(plan.people == people);
        CHECK(plan.cameras == 3);
        CHECK(plan.frames == 2);
        CHECK(plan.training_images == setup.photos.size());
        CHECK(plan.test_images == setup.test_photos.size());
        CHECK(plan.gaussians * people == setup.gaussian_count());
        CHECK(plan.image_bytes == 3 * 2 * 64 * 64 * 4);
        CHECK(plan.pixels > 64); // the people fill a part of the images
        CHECK(plan.pixels < 64 * 64);
    }
}

TEST_CASE("a plan's memory is exactly enough for its Gaussians") {
    const ReconstructionInput input = small_input();
    Recipe recipe = small_recipe();
    recipe.gaussians = 3000;
    for (const bool on_device : {false, true}) {
        CAPTURE(on_device);
        recipe.max_memory = 0;
        const ReconstructionPlan whole = plan_reconstruction<cpu::Threads>(input, recipe, on_device);
        CHECK(whole.gaussians == 3000);
        recipe.max_memory = whole.memory;
        CHECK(plan_reconstruction<cpu::Threads>(input, recipe, on_device).gaussians == 3000);
        recipe.max_memory = whole.memory - 1;
        const ReconstructionPlan less = plan_reconstruction<cpu::Threads>(input, recipe, on_device);
        CHECK(less.gaussians == 2999);
        CHECK(less.memory <= recipe.max_memory);
        recipe.max_memory = 1000;
        CHECK_THROWS_AS((void)plan_reconstruction<cpu::Threads>(input, recipe, on_device), ValueError);
    }
}

TEST_CASE("stored images take the memory of a few and of those that are kept, which a limit of memory bounds") {
    cpu::Threads host(2);
    Recipe recipe = small_recipe();
    const auto stored = [](std::uint64_t memory) { return test::with_stored_images(small_input(), memory); };
    const auto plan = [&](const ReconstructionInput& input) {
        return plan_reconstruction<cpu::Threads>(input, recipe);
    };
    const ReconstructionPlan held = plan(small_input()), none = plan(stored(0)), all = plan(stored(1 << 20));
    CHECK(none.training_images == held.training_images);
    CHECK(none.test_images == held.test_images);
    CHECK(none.pixels == held.pixels);
    CHECK(none.image_bytes == 0);
    CHECK(none.memory < held.memory + 5 * 30 * 64 * 64 + 1); // of the threads that read
    CHECK(plan(stored(1000)).memory == none.memory + 1000);
    CHECK(all.memory - none.memory <= 4 * 64 * 64 * 4);
    CHECK(all.memory - none.memory > 4 * 4 * (none.pixels - 1));

    const auto kept = [&](std::uint64_t image_memory, std::uint64_t max_memory) {
        recipe.max_memory = max_memory;
        const ReconstructionInput input = stored(image_memory);
        const ReconstructionSetup setup = make_setup(host, input, recipe);
        CHECK(setup.gaussian_count() == recipe.gaussians);
        return setup.stored->memory();
    };
    CHECK(kept(5000, 0) == 5000);
    CHECK(kept(5000, none.memory) == 0);
    CHECK(kept(5000, none.memory + 700) == 700);
    CHECK(kept(5000, none.memory + 7000) == 5000);
    CHECK(!make_setup(host, small_input(), small_recipe()).stored);
}

TEST_CASE("a plan without photographs for training is refused") {
    ReconstructionInput input = small_input();
    for (PixelImage& image : input.capture.images) image = {};
    CHECK_THROWS_AS((void)plan_reconstruction<cpu::Threads>(input, small_recipe()), ValueError);
}
