// SPDX-License-Identifier: Apache-2.0
/// @file  Training, refinement, pose fitting and rendering on a backend whose buffers the host cannot access. A host
///        read would crash, and every number equals that of the reference backend.
#include <gsh/avatar/avatar.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/pipeline/static_model.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/static_configuration.hpp>
#include <gsh/train/trainer.hpp>

#include "support/guarded.hpp"
#include "support/posed_scene.hpp"
#include "support/small_training.hpp"

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace guarded_training { // joined builds: other tests have helpers of the same names

using namespace gsh;
using test::Guarded;
using test::PosedScene;
using test::SmallScene;
using test::SmallTraining;

namespace {

/// Pictures of some steps, and what was learned at the end.
struct Outcome {
    std::vector<Image<float>> pictures;
    std::vector<double> losses;
    std::vector<float> learned;
};

void check_equal(const Outcome& found, const Outcome& expected) {
    REQUIRE(found.pictures.size() == expected.pictures.size());
    for (std::size_t i = 0; i < found.pictures.size(); ++i) {
        CAPTURE(i);
        CHECK(found.pictures[i].data == expected.pictures[i].data);
    }
    CHECK(found.losses == expected.losses);
    CHECK(found.learned == expected.learned);
}

template <class TrainerType>
void observe(TrainerType& trainer, const Photo& photo, Outcome& outcome) {
    outcome.losses.push_back(trainer.last_loss().loss);
    outcome.losses.push_back(trainer.last_psnr());
    trainer.render(photo, outcome.pictures.emplace_back());
}

void append(std::vector<float>& to, const GaussianCloud<float>& cloud) {
    for (const auto& v : cloud.means) to.insert(to.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.log_scales) to.insert(to.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.quats) to.insert(to.end(), {v.w, v.x, v.y, v.z});
    for (const auto& v : cloud.sh) to.insert(to.end(), {v.x, v.y, v.z});
    to.insert(to.end(), cloud.opacity_logits.begin(), cloud.opacity_logits.end());
}

template <class B>
Outcome train_avatar(const SmallScene& scene, const AvatarConfig& config) {
    SmallTraining<B> training(scene, B(), 3, config);
    Outcome outcome;
    for (int step = 0; step < 5; ++step) training.trainer.step(0.1 + 0.2 * step); // the shadow joins at 0.1
    observe(training.trainer, scene.photos[1], outcome);
    outcome.learned = training.parameters();
    const AvatarData avatar = training.exported();
    append(outcome.learned, avatar.gaussians);
    outcome.learned.insert(outcome.learned.end(), avatar.ao.begin(), avatar.ao.end());
    return outcome;
}

template <class B>
Outcome train_lit(const SmallScene& scene) {
    SmallTraining<B> training(scene, B(), 3, {.ao = AmbientOcclusion::pose});
    const LightData start = even_light(2, 3, {0, 0.8, 0}, 3);
    training.model.set_light(training.rig, std::make_shared<LearnedLight<B>>(training.backend, start));
    MotionRefinement<B> refinement(training.backend, training.rig, scene.motion, {}, test_time_config());
    training.people.refine(refinement);
    Outcome outcome;
    for (int step = 0; step < 5; ++step) training.trainer.step(0.1 + 0.2 * step);
    observe(training.trainer, scene.photos[1], outcome);
    outcome.learned = training.parameters();
    const AvatarData avatar = training.exported();
    outcome.learned.insert(outcome.learned.end(), avatar.mean_irradiance.begin(), avatar.mean_irradiance.end());
    outcome.losses.insert(outcome.losses.end(), avatar.light->log_intensities.begin(),
                          avatar.light->log_intensities.end());
    return outcome;
}

GaussianCloud<float> start_cloud() {
    test::Rng rng(8);
    GaussianCloud<float> cloud(40, 0);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        cloud.means[i] = vec3<float>(rng.vec(-0.4, 0.4)) + vec3<float>(0, 0.8f, 0);
        cloud.log_scales[i] = vec3<float>(i % 2 ? -2.0f : -4.5f); // some to split, some to clone
        cloud.opacity_logits[i] = i % 7 ? 1.0f : -6.0f;           // some to prune
    }
    return cloud;
}

template <class B>
Outcome train_static(const SmallScene& scene) {
    StaticConfig config = static_config(30);
    config.density.start = 4, config.density.stop = 30, config.density.interval = 5;
    config.density.reset_interval = 12, config.density.gradient_threshold = 1e-6;
    config.sh_degree = 1, config.sh_interval = 8, config.extent = 2;
    B backend;
    std::vector<Photo> photos;
    for (const Photo& photo : scene.photos)
        if (photo.frame == 0) photos.push_back(photo);
    StaticModel<B> scene_model(backend, start_cloud(), config.extent, 5, config);
    Trainer<B, StaticModel<B>> trainer(backend, scene_model, photos, static_order_seed(5), train_config_of(config));
    Outcome outcome;
    for (int step = 0; step < 20; ++step) trainer.step();
    observe(trainer, photos[0], outcome);
    append(outcome.learned, scene_model.cloud());
    CHECK(scene_model.total_change().split > 0);
    CHECK(scene_model.total_change().cloned > 0);
    CHECK(scene_model.total_change().pruned > 0);
    CHECK(scene_model.cloud().sh_degree == 1);
    return outcome;
}

RefinementConfig everything() {
    RefinementConfig config;
    config.pose = {.rate = 4e-3, .terms = {.pull = 0.01, .drift = 0.02, .acceleration = 0.03}};
    config.transl = {.rate = 1e-3, .terms = {.pull = 0.01}};
    config.expression = {.rate = 1e-2, .terms = {.pull = 0.01, .drift = 0.02}};
    config.betas = {.rate = 1e-2, .terms = {.pull = 0.04}};
    config.camera_rotation = {.rate = 1e-3, .terms = {.pull = 0.05}};
    config.camera_translation = {.rate = 1e-3, .terms = {.pull = 0.06}};
    config.camera_focal = {.rate = 1e-3, .terms = {.pull = 0.07}};
    config.camera_principal_point = {.rate = 1e-2, .terms = {.pull = 0.08}};
    return config;
}

template <class B>
Outcome train_refined(const SmallScene& scene) {
    SmallTraining<B> training(scene, B(), 3, {.ao = AmbientOcclusion::pose});
    MotionRefinement<B> refinement(training.backend, training.rig, scene.motion, scene.cameras, everything());
    training.people.refine(refinement);
    Outcome outcome;
    for (int step = 0; step < 8; ++step) training.trainer.step(0.2 + 0.1 * step);
    observe(training.trainer, scene.photos[3], outcome);
    outcome.learned = training.parameters();
    outcome.losses.push_back(refinement.terms());
    const Motion motion = refinement.motion();
    for (const auto& angle : motion.pose) outcome.losses.insert(outcome.losses.end(), {angle.x, angle.y, angle.z});
    outcome.losses.insert(outcome.losses.end(), motion.expression.begin(), motion.expression.end());
    const Camera<double> camera = refinement.template camera<double>(1);
    outcome.losses.insert(outcome.losses.end(), {camera.fx, camera.cx, camera.t.x, camera.R[0][1]});
    return outcome;
}

template <class B>
Outcome fit_pose(const PosedScene& scene) {
    B backend;
    Avatar<B> avatar(backend, scene.avatar);
    PoseFit<B> fit(backend, scene.avatar.filter, {.steps = 4, .mask_weight = 0.3});
    MotionRefinement<B> motion(backend, scene.avatar.rig, scene.estimate(), {}, test_time_config());
    FrozenAvatar<B> frozen(avatar, motion);
    const PoseFitReport report = fit.fit(frozen, 2, scene.observe(2));
    Outcome outcome{.pictures = {}, .losses = {report.loss_before, report.loss_after}, .learned = {}};
    for (const auto& angle : motion.motion().pose)
        outcome.losses.insert(outcome.losses.end(), {angle.x, angle.y, angle.z});
    return outcome;
}

/// An avatar in a pose, in front of a camera, and the gradient of its pose.
template <class B>
Outcome show(const PosedScene& scene, const AvatarData& data) {
    B backend;
    Avatar<B> avatar(backend, data);
    const Rasterizer<B> rasterizer(backend, raster_params<float>(data.filter));
    RigPose<B> pose;
    typename Avatar<B>::Cache cache;
    typename Rasterizer<B>::Cache raster;
    Splats<B> splats, dL_dsplats;
    splats.resize(avatar.size()), dL_dsplats.resize(avatar.size());
    const Camera<float> camera = scene.cameras[1].template cast<float>();
    typename B::template Buffer<float> color(3 * PosedScene::size * PosedScene::size), dL_dcolor(color.size());
    typename B::template Buffer<vec3<float>> dL_dpose(data.rig.joint_count());
    backend.fill(Span<float>(dL_dcolor), 0.01f);
    backend.fill(Span<vec3<float>>(dL_dpose), vec3<float>(0));
    fill_zero(backend, dL_dsplats.view());

    avatar.rig().upload_pose(scene.truth, 3, pose);
    avatar.pose(pose, camera.center(), splats.view(), cache);
    const auto image = [](auto& buffer) { return ImageView<float>{buffer, 3, PosedScene::size, PosedScene::size}; };
    rasterizer.forward(camera, std::as_const(splats).view(), {}, {.color = image(color)}, raster);
    rasterizer.backward(camera, std::as_const(splats).view(), {}, {.color = image(dL_dcolor)}, raster,
                        dL_dsplats.view());
    avatar.backward_to_pose(pose, camera.center(), std::as_const(dL_dsplats).view(), cache,
                            {.pose = dL_dpose, .coefficients = {}, .transl = {}});

    Outcome outcome;
    outcome.learned.resize(color.size() + 3 * dL_dpose.size());
    backend.download(Span<const float>(color), Span<float>(outcome.learned).subspan(0, color.size()));
    std::vector<vec3<float>> host(dL_dpose.size());
    backend.download(Span<const vec3<float>>(dL_dpose), Span<vec3<float>>(host));
    for (std::size_t j = 0; j < host.size(); ++j)
        for (int k = 0; k < 3; ++k) outcome.learned[color.size() + 3 * j + static_cast<std::size_t>(k)] = host[j][k];
    return outcome;
}

} // namespace

TEST_CASE("an avatar trains without the host touching the backend's memory") {
    const SmallScene scene;
    for (const AmbientOcclusion ao : {AmbientOcclusion::time, AmbientOcclusion::pose}) {
        CAPTURE(static_cast<int>(ao));
        check_equal(train_avatar<Guarded>(scene, {.ao = ao}), train_avatar<cpu::Serial>(scene, {.ao = ao}));
    }
}

TEST_CASE("so do stored attributes, separate heads and dual quaternions") {
    const SmallScene scene;
    const AvatarConfig stored{.hash_displacement = false, .hash_sh = false, .deformation = Deformation::polar};
    check_equal(train_avatar<Guarded>(scene, stored), train_avatar<cpu::Serial>(scene, stored));
    const AvatarConfig separate{
        .heads = Heads::separate, .head_time = true, .deformation = Deformation::dual_quaternion};
    check_equal(train_avatar<Guarded>(scene, separate), train_avatar<cpu::Serial>(scene, separate));
}

TEST_CASE("so does an avatar in a light, with its poses, and so is it shown") {
    const SmallScene small;
    check_equal(train_lit<Guarded>(small), train_lit<cpu::Serial>(small));
    const PosedScene scene;
    AvatarData avatar = scene.avatar;
    avatar.light = even_light(2, 3, {0, 0.8, 0}, 3);
    check_equal(show<Guarded>(scene, avatar), show<cpu::Serial>(scene, avatar));
}

TEST_CASE("so do a static scene and its density control") {
    const SmallScene scene;
    check_equal(train_static<Guarded>(scene), train_static<cpu::Serial>(scene));
}

TEST_CASE("so do poses, shape and cameras") {
    const SmallScene scene;
    check_equal(train_refined<Guarded>(scene), train_refined<cpu::Serial>(scene));
}

TEST_CASE("so is a pose fitted") {
    const PosedScene scene;
    check_equal(fit_pose<Guarded>(scene), fit_pose<cpu::Serial>(scene));
}

TEST_CASE("so is an avatar posed and rendered, with shadows that follow the pose") {
    const PosedScene scene;
    check_equal(show<Guarded>(scene, scene.avatar), show<cpu::Serial>(scene, scene.avatar));

    const SmallScene small;
    SmallTraining<cpu::Serial> training(small, cpu::Serial(), 3, {.ao = AmbientOcclusion::pose});
    for (int step = 0; step < 3; ++step) training.trainer.step(0.5);
    const AvatarData avatar = training.exported();
    REQUIRE(avatar.occlusion_field.has_value());
    check_equal(show<Guarded>(scene, avatar), show<cpu::Serial>(scene, avatar));
}

} // namespace guarded_training
