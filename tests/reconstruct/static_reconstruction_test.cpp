// SPDX-License-Identifier: Apache-2.0
#include <gsh/reconstruct/static_reconstruction.hpp>

#include "io/temporary.hpp"
#include "reconstruct/small_people.hpp"
#include "support/guarded.hpp"

#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/reconstruct/static_photos.hpp>
#include <gsh/reconstruct/train.hpp>
#include <gsh/reconstruct/training_record.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

using namespace gsh;

namespace {

StaticRecipe small_scene_recipe(std::int64_t steps = 12) {
    StaticRecipe recipe{.config = static_model_params(steps), .points = 300, .seed = 2};
    recipe.config.density.start = 2, recipe.config.density.interval = 3, recipe.config.density.stop = steps;
    recipe.config.density.gradient_threshold = 1e-6;
    return recipe;
}

} // namespace

TEST_CASE("a frame of a capture becomes a scene that shows its photographs") {
    cpu::Threads backend(2);
    const StaticPhotos input = static_photos_of(test::small_input().capture, 0);
    REQUIRE(!input.training.empty());
    REQUIRE(!input.test.empty());
    StaticRecipe recipe = small_scene_recipe(60);
    recipe.config.density.stop = 20; // what was split then learns
    StaticReconstruction<cpu::Threads> scene(backend, input, recipe);
    CHECK(scene.size() == 300);
    const double before = scene.compare(input.training[0]).score.psnr;
    TrainingRecord record;
    std::vector<double> shares;
    train(scene, recipe.length(), record, {.progress = [&](double share) { shares.push_back(share); }});
    CHECK(record.steps == 60);
    CHECK(scene.step_count() == 60);
    CHECK(record.loss.size() == 7); // of steps 1, 10, 20, …
    CHECK(record.timed_steps == 60);
    CHECK(shares.size() == 60);
    CHECK(shares.back() == 1);
    CHECK(scene.size() != 300);
    CHECK(scene.total_change().split > 0);
    CHECK(scene.cloud().size() == scene.size());
    CHECK(scene.compare(input.training[0]).score.psnr > before + 1);
    CHECK(std::isfinite(scene.compare(input.test[0]).score.psnr));
}

TEST_CASE("a scene's training stops and goes on with the same bits, on any backend") {
    cpu::Threads backend(2);
    test::Guarded guarded;
    const StaticPhotos input = static_photos_of(test::small_input().capture, 0);
    const StaticRecipe recipe = small_scene_recipe();
    StaticReconstruction<cpu::Threads> whole(backend, input, recipe), stopped(backend, input, recipe);
    StaticReconstruction<test::Guarded> other(guarded, input, recipe);
    TrainingRecord of_whole, of_stopped, of_other;
    train(whole, recipe.length(), of_whole);
    train(other, recipe.length(), of_other);
    train(stopped, recipe.length(), of_stopped, {}, 5);
    CHECK(of_stopped.steps == 5);
    train(stopped, recipe.length(), of_stopped);
    CHECK(of_stopped.steps == 12);
    CHECK(whole.cloud().means == stopped.cloud().means);
    CHECK(whole.cloud().means == other.cloud().means);
    CHECK(whole.cloud().opacity_logits == other.cloud().opacity_logits);
    CHECK(of_whole.loss == of_other.loss);
}

TEST_CASE("a folder gives the frame that was written, and a frame that it does not have is refused") {
    cpu::Threads backend(2);
    const Capture capture = test::small_input().capture;
    const StaticPhotos expected = static_photos_of(capture, 1);
    CHECK_THROWS_WITH_AS((void)static_photos_of(capture, 99), doctest::Contains("frames, expected frame 99 among them"),
                         ValueError);
    const test::Temporary folder;
    save_capture(folder / "capture", capture);
    const StaticPhotos found = load_static_photos(backend, folder / "capture", 1);
    REQUIRE(found.training.size() == expected.training.size());
    REQUIRE(found.test.size() == expected.test.size());
    for (std::size_t i = 0; i < found.training.size(); ++i) {
        CHECK(found.training[i].name == expected.training[i].name);
        CHECK(found.training[i].frame == 1);
        CHECK(found.training[i].rgba.size() == expected.training[i].rgba.size());
    }
    CHECK(found.name == "capture, frame 1");
    CHECK(!found.points);
    CHECK_THROWS_WITH_AS((void)load_static_photos(backend, folder / "capture", 99), doctest::Contains("expected frame 99"),
                         ValueError);
    CHECK_THROWS_AS((void)load_static_photos(backend, folder / "nothing"), Error);
}
