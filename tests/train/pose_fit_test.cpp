// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>

#include "support/posed_scene.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;
using test::PosedScene;

namespace {

RefinementParams quick() {
    RefinementParams config = test_time_params();
    config.pose.rate = 1e-2, config.transl.rate = 3e-3, config.expression.rate = 0;
    return config;
}

template <class B>
Motion fitted(B&& backend, const PosedScene& scene, std::size_t frame, PoseFitParams params,
              PoseFitReport* report = nullptr) {
    using Where = std::remove_cvref_t<B>;
    Avatar<Where> avatar(backend, scene.avatar);
    PoseFit<Where> fit(backend, scene.avatar.filter, params);
    MotionRefinement<Where> motion(backend, scene.avatar.rig, scene.estimate(), {}, quick());
    FrozenAvatar<Where> frozen(avatar, motion);
    const auto found = fit.fit(frozen, frame, scene.observe(frame));
    if (report) *report = found;
    return motion.motion();
}

} // namespace

TEST_CASE("a frame's pose is found from its photographs, and no other frame moves") {
    const PosedScene scene;
    const Motion estimate = scene.estimate();
    for (const double mask_weight : {0.0, 0.3}) {
        CAPTURE(mask_weight);
        PoseFitReport report;
        const Motion motion = fitted(cpu::Serial(), scene, 2, {.steps = 60, .mask_weight = mask_weight}, &report);
        const std::vector<std::size_t> frame{2}, others{0, 1, 3, 4};
        const auto error = [&](const Motion& m, const std::vector<std::size_t>& frames) {
            return joint_errors(scene.body, m, scene.truth, RootAlignment::none, frames).mean_mm;
        };
        MESSAGE("joints " << error(estimate, frame) << " mm before, " << error(motion, frame) << " mm after; loss "
                          << report.loss_before << " and " << report.loss_after);
        CHECK(error(motion, frame) < 0.25 * error(estimate, frame));
        CHECK(error(motion, others) == error(estimate, others));
        CHECK(report.kept);
        CHECK(report.loss_after < 0.5 * report.loss_before);
    }
}

TEST_CASE("a frame's pose is found in front of a room whose plate is known") {
    const PosedScene scene;
    const std::size_t bytes = scene.images[0].size();
    std::vector<std::uint8_t> plate(bytes, 255);
    Rng rng(4);
    for (std::size_t i = 0; i < bytes; ++i)
        if (i % 4 < 3) plate[i] = static_cast<std::uint8_t>(rng.uniform(0.0, 255.0));
    std::vector<std::vector<std::uint8_t>> images;
    std::vector<Photo> photos;
    for (std::size_t c = 0; c < PosedScene::camera_count; ++c) { // opaque photographs that show person and room
        std::vector<std::uint8_t>& image = images.emplace_back(plate);
        const Span<const std::uint8_t> person = scene.observe(2, c).rgba;
        for (std::size_t i = 0; i < bytes; ++i) {
            const double a = person[i / 4 * 4 + 3] / 255.0;
            if (i % 4 < 3) image[i] = static_cast<std::uint8_t>(std::lround(a * person[i] + (1 - a) * plate[i]));
        }
    }
    for (std::size_t c = 0; c < PosedScene::camera_count; ++c)
        photos.push_back({"photo", scene.cameras[c], 2, images[c], c, plate});
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, scene.avatar);
    PoseFit<cpu::Serial> fit(backend, scene.avatar.filter, {.steps = 60});
    const Motion estimate = scene.estimate();
    MotionRefinement<cpu::Serial> motion(backend, scene.avatar.rig, estimate, {}, quick());
    FrozenAvatar<cpu::Serial> frozen(avatar, motion);
    const auto report = fit.fit(frozen, 2, photos);
    const std::vector<std::size_t> frame{2};
    const auto error = [&](const Motion& m) {
        return joint_errors(scene.body, m, scene.truth, RootAlignment::none, frame).mean_mm;
    };
    CAPTURE(report.loss_after);
    CHECK(error(motion.motion()) < 0.25 * error(estimate));
    photos[0].plate = photos[0].plate.subspan(0, 12);
    CHECK_THROWS_AS(fit.fit(frozen, 2, photos), ShapeError);
}

TEST_CASE("a fit is the same at any thread count") {
    const PosedScene scene;
    const Motion expected = fitted(cpu::Serial(), scene, 1, {.steps = 6});
    for (const std::size_t threads : {1, 2, 5}) {
        const Motion found = fitted(cpu::Threads(threads), scene, 1, {.steps = 6});
        CHECK(found.pose == expected.pose);
        CHECK(found.transl == expected.transl);
    }
}

TEST_CASE("a fit that makes it worse leaves the estimate alone") {
    const PosedScene scene;
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, scene.avatar);
    PoseFit<cpu::Serial> fit(backend, scene.avatar.filter, {.steps = 2});
    RefinementParams config = quick();
    config.pose.rate = 1;
    MotionRefinement<cpu::Serial> motion(backend, scene.avatar.rig, scene.truth, {}, config);
    FrozenAvatar<cpu::Serial> frozen(avatar, motion);
    const auto report = fit.fit(frozen, 0, {scene.observe(0, 1)});
    CHECK(!report.kept);
    CHECK(report.loss_after == report.loss_before);
    CHECK(motion.motion().pose == scene.truth.pose);
}

TEST_CASE("a fit that is stopped keeps what it has if that is better, and nothing else") {
    const PosedScene scene;
    std::size_t asked = 0;
    PoseFitReport report;
    const Motion found = fitted(cpu::Serial(), scene, 2, {.steps = 60, .stop = [&] { return ++asked > 7; }}, &report);
    CHECK(asked == 8);
    CHECK(report.steps == 7);
    CHECK(report.kept);
    CHECK(report.loss_after < report.loss_before);
    CHECK(found.pose != scene.estimate().pose);
    const Motion at_once = fitted(cpu::Serial(), scene, 2, {.steps = 60, .stop = [] { return true; }}, &report);
    CHECK(report.steps == 0);
    CHECK(!report.kept);
    CHECK(at_once.pose == scene.estimate().pose);
    fitted(cpu::Serial(), scene, 2, {.steps = 3, .stop = [] { return false; }}, &report);
    CHECK(report.steps == 3);
}

TEST_CASE("no steps, no change; bad photographs are refused") {
    const PosedScene scene;
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, scene.avatar);
    PoseFit<cpu::Serial> fit(backend, scene.avatar.filter, {.steps = 0});
    RefinementParams config = quick();
    config.left_out = {3};
    MotionRefinement<cpu::Serial> motion(backend, scene.avatar.rig, scene.truth, {}, config);
    FrozenAvatar<cpu::Serial> frozen(avatar, motion);
    CHECK(!fit.fit(frozen, 0, {scene.observe(0, 1)}).kept);
    CHECK_THROWS_AS(fit.fit(frozen, 0, {}), ValueError);
    CHECK_THROWS_AS(fit.fit(frozen, 3, {scene.observe(3, 1)}), ValueError);
    Photo photo = scene.observe(0, 0);
    photo.rgba = photo.rgba.subspan(0, 12);
    CHECK_THROWS_AS(fit.fit(frozen, 0, {photo}), ShapeError);
    CHECK_THROWS_AS(PoseFit<cpu::Serial>(backend, {}, {.mask_weight = -1}), ValueError);
    MotionRefinement<cpu::Serial> late(backend, scene.avatar.rig, scene.truth, {},
                                       {}); // groups that start after a tenth of the run
    FrozenAvatar<cpu::Serial> waiting(avatar, late);
    CHECK_THROWS_AS(fit.fit(waiting, 0, {scene.observe(0, 1)}), ValueError);
}
