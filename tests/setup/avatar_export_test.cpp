// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/setup/avatar_export.hpp>

#include "support/small_training.hpp"

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

TEST_CASE("photographed frames come once each, in the photographs' order") {
    const SmallScene scene;
    const auto& p = scene.photos; // frames 0, 1, 0, 1
    CHECK(photographed_frames(p) == std::vector<std::size_t>{0, 1});
    CHECK(photographed_frames({p[1], p[3], p[0]}) == std::vector<std::size_t>{1, 0});
    CHECK(photographed_frames({}).empty());
}

TEST_CASE("mean ambient occlusion is the mean over the frames that were photographed, each counted once") {
    SmallScene scene;
    const auto train = [&] {
        auto training = std::make_unique<SmallTraining<cpu::Serial>>(
            scene, cpu::Serial(), 3,
            ConfiguredAvatarParams{.ao = AmbientOcclusion::time, .model = {.occlusion_start = 0}});
        training->steps(25);
        return training;
    };
    const auto all = train();
    std::vector<std::vector<float>> frames;
    for (const std::size_t frame : {0, 1}) {
        const auto ao = all->model.ao(all->people.pose(frame), frame);
        frames.emplace_back(ao.begin(), ao.end());
    }
    CHECK(frames[0] != frames[1]);
    const auto mean = all->mean_ao();
    REQUIRE(mean.size() == all->model.size());
    for (std::size_t i = 0; i < mean.size(); ++i) {
        CHECK(mean[i] == doctest::Approx((frames[0][i] + frames[1][i]) / 2));
        CHECK(mean[i] > 0);
    }
    const std::vector<Photo> photos = scene.photos;
    scene.photos = {photos[0], photos[1], photos[2]}; // frame 0 by both cameras, frame 1 by one
    CHECK(train()->mean_ao().size() == mean.size());
    scene.photos = {photos[1], photos[3]}; // frame 1 alone
    const auto second = train();
    const auto ao = second->model.ao(second->people.pose(1), 1);
    const std::vector<float> expected(ao.begin(), ao.end());
    CHECK(second->mean_ao() == expected);
}

TEST_CASE("an avatar that is exported before sh_start has constant colours") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3, {.model = {.sh_start = 0.5}});
    const auto harmonics = [&] {
        training.model.update_canonical();
        const auto cloud = canonical_gaussians(training.people.backend(), training.model);
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        std::size_t constant = 0, others = 0;
        for (std::size_t i = 0; i < cloud.sh.size(); ++i)
            (i % basis == 0 ? constant : others) += cloud.sh[i] != vec3<float>(0);
        CHECK(constant == cloud.size());
        return others;
    };
    CHECK(harmonics() == 0);
    training.trainer.resume(1, 0.5);
    CHECK(harmonics() > 0);
}

TEST_CASE("an avatar whose fields know the time is saved as the mean over the frames that were photographed") {
    SmallScene scene;
    const std::vector<Photo> photos = scene.photos;
    const auto check = [&](const ConfiguredAvatarParams& config, std::vector<std::size_t> frames) {
        SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3, config);
        training.steps(25);
        std::vector<GaussianCloud<float>> clouds;
        for (const std::size_t frame : frames) {
            training.model.update_canonical(frame);
            clouds.push_back(canonical_gaussians(training.backend, training.model));
        }
        const auto mean = [&](const auto& member, std::size_t i) {
            vec3<double> sum(0);
            for (const auto& cloud : clouds) sum += vec3<double>(member(cloud)[i]);
            return vec3<float>(sum / static_cast<double>(clouds.size()));
        };
        const auto means = [](const GaussianCloud<float>& cloud) -> const auto& {
            return cloud.means;
        };
        const auto sh = [](const GaussianCloud<float>& cloud) -> const auto& {
            return cloud.sh;
        };
        const GaussianCloud<float> saved = training.exported().gaussians;
        REQUIRE(saved.size() == training.model.size());
        for (std::size_t i = 0; i < saved.means.size(); ++i) CHECK(saved.means[i] == mean(means, i));
        for (std::size_t i = 0; i < saved.sh.size(); ++i) CHECK(saved.sh[i] == mean(sh, i));
        CHECK(saved.log_scales == clouds[0].log_scales);
        CHECK(saved.opacity_logits == clouds[0].opacity_logits);
        return std::pair(clouds.front().means != clouds.back().means, clouds.front().sh != clouds.back().sh);
    };
    CHECK(check({.head_time = true}, {0, 1}) == std::pair(true, true));
    CHECK(check({.heads = Heads::separate, .head_time = true}, {0, 1}) == std::pair(true, true));
    CHECK(check({.hash_displacement = false, .head_time = true}, {0, 1}) == std::pair(false, true));
    CHECK(check({.hash_sh = false, .head_time = true}, {0, 1}) == std::pair(true, false));
    CHECK(check({}, {0, 1}) == std::pair(false, false)); // fields that do not depend on the time
    scene.photos = {photos[0], photos[1], photos[2]};    // frame 0 by both cameras, frame 1 by one: each counts once
    check({.head_time = true}, {0, 1});
    scene.photos = {photos[1], photos[3]}; // frame 1 alone
    check({.head_time = true}, {1});
}

TEST_CASE("an exported avatar has the learned joints, the model's way of posing and the trainer's filter") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(
        scene, cpu::Serial(), 3,
        {.ao = AmbientOcclusion::pose,
         .model = {.clamping = ColorClamp::below, .deformation = Deformation::polar, .occlusion_start = 0.5}},
        {.filter = {.dilation = 0.2, .compensate_opacity = false}});
    training.steps(5);
    const AvatarData avatar = training.exported();
    const auto joints = training.parameters("joints");
    REQUIRE(avatar.rig.joints.size() == 4);
    for (std::size_t j = 0; j < 4; ++j) {
        for (int axis = 0; axis < 3; ++axis)
            CHECK(avatar.rig.joints[j][axis] == joints[3 * j + static_cast<std::size_t>(axis)]);
        CHECK(length(avatar.rig.joints[j] - training.rig.joints[j]) > 0);
    }
    CHECK(avatar.rig.betas == training.rig.betas);
    CHECK(avatar.deformation == Deformation::polar);
    CHECK(avatar.clamping == ColorClamp::below);
    CHECK(avatar.filter.dilation == 0.2);
    CHECK(!avatar.filter.compensate_opacity);
    CHECK(avatar.gaussians.sh_degree == 1);
    CHECK(avatar.gaussians.size() == training.model.size());
    CHECK(avatar.ao.empty()); // ambient occlusion has not joined
    CHECK(!avatar.occlusion_field);
    training.steps(3, 0.6);
    const AvatarData shaded = training.exported();
    CHECK(shaded.ao == training.mean_ao());
    REQUIRE(shaded.occlusion_field);
    CHECK(shaded.occlusion_field->largest == 2);
}

TEST_CASE("a lit avatar is exported with its light, and with the mean irradiance of the photographed frames") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> unlit(scene);
    CHECK(mean_irradiance(unlit.people, {0, 1}).empty());
    CHECK(!unlit.exported().light);
    CHECK_THROWS_WITH_AS((void)unlit.model.shading(), doctest::Contains("the avatar was made without a light"),
                         ValueError);
    const LightData start = even_light(2, 3, {0, 0.8, 0}, 3);
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3, test::quick_avatar(), test::small_training, start);
    training.steps(3);
    const auto of = [&](std::vector<std::size_t> frames) { return mean_irradiance(training.people, frames); };
    const auto first = of({0}), second = of({1}), mean = of({0, 1});
    CHECK(first != second);
    for (std::size_t i = 0; i < mean.size(); ++i) CHECK(mean[i] == doctest::Approx((first[i] + second[i]) / 2));
    CHECK(of(std::vector<std::size_t>(100, 1)).front() == doctest::Approx(second.front()));
    const AvatarData avatar = training.exported();
    CHECK(avatar.mean_irradiance == mean);
    REQUIRE(avatar.light);
    CHECK(avatar.light->points != start.points); // learned
    CHECK(avatar.light->log_intensities.size() == 5);
    CHECK(shaded_cloud(avatar).sh != avatar.gaussians.sh);
}
