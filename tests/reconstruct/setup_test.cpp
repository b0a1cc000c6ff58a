// SPDX-License-Identifier: Apache-2.0
/// What a training starts from: photographs, Gaussians within a limit of memory, the text of a run; input that is
/// refused.
#include "reconstruct/small_people.hpp"
#include "support/contains.hpp"

#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/reconstruct/setup.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;
using test::small_input;
using test::small_recipe;

TEST_CASE("a setup has the photographs of the capture, with hidden pixels and the weights of a registration") {
    cpu::Threads host(2);
    ReconstructionInput input = small_input();
    input.registration.emplace().frame_weights = {0.5, 1};
    const UnknownPixel hidden{.index = 65, .background = {}, .hidden = 1};
    input.capture.hidden.assign(input.capture.images.size(), {hidden});
    const ReconstructionSetup setup = make_setup(host, input, small_recipe());
    REQUIRE(setup.photos.size() == 4);
    CHECK(setup.test_photos.size() == 2);
    CHECK(setup.registered);
    for (const Photo& photo : setup.photos) {
        CHECK(photo.weight == (photo.frame == 0 ? 0.5 : 1));
        REQUIRE(photo.unknown.size() == 1); // none along the outline, since the studio removes the background
        CHECK((photo.unknown[0].index == 65 && photo.unknown[0].hidden == 1));
    }
    CHECK(setup.light.has_value());
    CHECK(!setup.light_text.empty());
    CHECK(setup.people[0].priors.region.size() == setup.people[0].gaussian_count());
}

TEST_CASE("frames without a photograph in training do not learn a pose") {
    cpu::Threads host(2);
    ReconstructionInput input = small_input();
    for (std::size_t camera = 0; camera < 2; ++camera) input.capture.image({camera, 1}) = {};
    Recipe recipe = small_recipe();
    recipe.refine = recipe.refine_cameras = true;
    const ReconstructionSetup setup = make_setup(host, input, recipe);
    REQUIRE(setup.refinement.has_value());
    CHECK(setup.refinement->left_out == std::vector<std::size_t>{1});
    CHECK(setup.cameras.size() == input.capture.cameras.size());
}

TEST_CASE("a limit of memory reduces the number of Gaussians, with a warning, or is refused") {
    cpu::Threads host(2);
    const ReconstructionInput input = small_input();
    Recipe recipe = small_recipe();
    recipe.gaussians = 3000;
    const auto with = [&](std::uint64_t bytes, bool on_device) {
        recipe.max_memory = bytes;
        return make_setup(host, input, recipe, {}, on_device);
    };
    const ReconstructionSetup plenty = with(std::uint64_t(1) << 34, false);
    CHECK(plenty.gaussian_count() == 3000);
    CHECK(plenty.warnings.empty());
    const ReconstructionSetup on_device = with(std::uint64_t(1) << 34, true);
    CHECK(on_device.configuration.train.photo_memory > 0);
    CHECK(plenty.configuration.train.photo_memory == 0);

    const MemoryModel memory = training_memory<cpu::Threads>(
        recipe.configuration.avatar, 64 * 64, 0, 1,
        {.joint_count = input.body().joint_count(), .vertex_count = input.body().vertex_count(), .frame_count = 2});
    const ReconstructionSetup fewer = with(memory.bytes(1000), false);
    CHECK(fewer.gaussian_count() < 1001);
    CHECK(fewer.gaussian_count() > 900); // the photographs take some of it
    REQUIRE(fewer.warnings.size() == 1);
    CHECK(fewer.warnings[0].starts_with(std::to_string(fewer.gaussian_count()) + " instead of 3000 Gaussians"));
    CHECK_THROWS_WITH_AS((void)with(memory.bytes(100), false), doctest::Contains("too little: training 3000 Gaussians"),
                         ValueError);
}

TEST_CASE("a recipe without a number of steps has those of its configuration") {
    Recipe recipe;
    CHECK(recipe.length().steps == 1500);
    recipe.configuration = named_configuration("paper");
    CHECK(recipe.length().steps == 3000);
    recipe.steps = 7, recipe.seconds = 2;
    CHECK(recipe.length().steps == 7);
    CHECK(recipe.length().seconds == 2);
}

TEST_CASE("the text of a run names what a checkpoint depends on, and nothing else") {
    ReconstructionInput input = small_input(2);
    Recipe recipe = small_recipe();
    const std::string plain = run_text(input, recipe);
    CHECK(plain.starts_with("person ann\nperson bob\njoints = all\n"));
    CHECK(plain.ends_with("refine.test_mask_weight = 0\n"));
    CHECK(run_text(small_input(), recipe) == plain.substr(std::string("person ann\nperson bob\n").size()));
    recipe.steps = 7, recipe.seed = 3; // a run may become longer; the seed is the trainer's own
    CHECK(run_text(input, recipe) == plain);
    recipe.refine = recipe.refine_cameras = true, recipe.registration = false, recipe.fine_registration = 2;
    input.keypoints_checksum = "k", input.regions_checksum = "r", input.priors_checksum = "p";
    input.capture.held_out_frames = {1, 2, 3, 7};
    CHECK(run_text(input, recipe) == plain + "refine, cameras too\nnot registered\nfine registration 2\nkeypoints k\n"
                                             "regions r\npriors p\nheld-out frames 1-3, 7\n");
    recipe.configuration.depth_prior = recipe.configuration.normal_prior = false; // then priors are not read
    CHECK(run_text(input, recipe) != test::contains("priors p"));
}

TEST_CASE("input whose parts do not belong together is refused") {
    const auto refused = [](const char* message, const auto& change) {
        ReconstructionInput input = small_input(2);
        change(input);
        CHECK_THROWS_WITH_AS(check_input(input), doctest::Contains(message), Error);
    };
    CHECK_NOTHROW(check_input(small_input(2)));
    refused("has no people", [](ReconstructionInput& input) { input.people.clear(); });
    refused("bob has body 1 of 1", [](ReconstructionInput& input) { input.people[1].body = 1; });
    refused("the motion of bob", [](ReconstructionInput& input) { input.people[1].motion.transl.pop_back(); });
    refused("regions", [](ReconstructionInput& input) { input.regions.resize(2); });
    refused("priors", [](ReconstructionInput& input) { input.priors.resize(1); });
}

TEST_CASE("test photographs without a person, or smaller than SSIM's window, are refused by name") {
    Capture capture = small_input().capture;
    CHECK(test_photos_of(capture).size() == 2);
    Capture empty = capture;
    PixelImage& image = empty.image({2, 0});
    for (std::size_t i = 3; i < image.data.size(); i += 4) image.data[i] = std::min<std::uint8_t>(image.data[i], 127);
    CHECK_THROWS_WITH_AS((void)test_photos_of(empty), doctest::Contains("nowhere exceeds 1/2"), ValueError);
    Capture small = capture;
    small.cameras[2].camera.width = small.cameras[2].camera.height = 8;
    CHECK_THROWS_WITH_AS((void)test_photos_of(small), doctest::Contains("is 8 x 8 pixels, expected at least 11 x 11"),
                         ValueError);
    Capture unseen = capture;
    unseen.held_out_frames = {1};
    unseen.image({2, 1}) = {};
    CHECK_THROWS_WITH_AS((void)test_photos_of(unseen),
                         doctest::Contains("is frames 1, of which there is no test image"), ValueError);
}

TEST_CASE("a capture without photographs for training is refused") {
    cpu::Threads host(2);
    ReconstructionInput input = small_input();
    for (std::size_t camera = 0; camera < 2; ++camera)
        for (std::size_t frame = 0; frame < 2; ++frame) input.capture.image({camera, frame}) = {};
    CHECK_THROWS_WITH_AS((void)make_setup(host, input, small_recipe()), doctest::Contains("no photographs to train on"),
                         ValueError);
}
