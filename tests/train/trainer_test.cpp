// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/trainer.hpp>

#include "support/small_training.hpp"

#include <algorithm>
#include <cmath>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

TEST_CASE("training learns") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const auto before = mean_score({compare(training.trainer, scene.photos[0]).score, compare(training.trainer, scene.photos[3]).score});
    training.steps(120);
    const auto after = mean_score({compare(training.trainer, scene.photos[0]).score, compare(training.trainer, scene.photos[3]).score});
    CAPTURE(before.psnr);
    CAPTURE(after.psnr);
    CHECK(after.psnr > before.psnr + 6);
    CHECK(after.psnr_person > before.psnr_person + 4);
    CHECK(after.ssim > before.ssim + 0.1);
    CHECK(training.trainer.step_count() == 120);
    CHECK(std::isfinite(training.trainer.last_loss().loss));
    CHECK(training.trainer.last_psnr() > 15);
}

TEST_CASE("the same seed gives the same avatar bit for bit, whatever the thread count") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> serial(scene);
    serial.steps(15);
    const auto expected = serial.parameters();
    for (const std::size_t threads : {1, 2, 3, 7}) {
        CAPTURE(threads);
        SmallTraining<cpu::Threads> threaded(scene, cpu::Threads(threads));
        threaded.steps(15);
        CHECK(threaded.parameters() == expected);
    }
    SmallTraining<cpu::Serial> other(scene, cpu::Serial(), 4);
    other.steps(15);
    CHECK(other.parameters() != expected);
}

TEST_CASE("an epoch sees every photograph once, and each epoch in another order") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    std::vector<std::vector<std::size_t>> epochs;
    for (std::uint64_t epoch = 0; epoch < 8; ++epoch) {
        std::vector<std::size_t> seen;
        for (std::uint64_t step = 0; step < 4; ++step) seen.push_back(training.trainer.photo_of_step(4 * epoch + step));
        auto sorted = seen;
        std::sort(sorted.begin(), sorted.end());
        CHECK(sorted == std::vector<std::size_t>{0, 1, 2, 3});
        epochs.push_back(seen);
    }
    CHECK(std::any_of(epochs.begin(), epochs.end(), [&](const auto& order) { return order != epochs[0]; }));
}

TEST_CASE("groups with a rate of zero stay as they are") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const auto& quats = training.model.parameters()[ParameterGroup::quats];
    const std::vector<float> before(quats.begin(), quats.end());
    training.steps(3);
    CHECK(std::equal(before.begin(), before.end(), quats.begin()));
}

TEST_CASE("the trainer refuses photographs that do not fit") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    using TrainerType = SmallTraining<cpu::Serial>::TrainerType;
    CHECK_THROWS_AS(TrainerType(training.backend, training.model, {}, scene.motion, 1), ValueError);
    auto photo = scene.photos[0];
    photo.frame = 2;
    CHECK_THROWS_AS(TrainerType(training.backend, training.model, {photo}, scene.motion, 1), ValueError);
    photo = scene.photos[0];
    photo.rgba = photo.rgba.subspan(0, 8);
    CHECK_THROWS_AS(TrainerType(training.backend, training.model, {photo}, scene.motion, 1), ShapeError);
}
