// SPDX-License-Identifier: Apache-2.0
/// @file  Small runs of everything that trains and renders, on any backend: the tests compare backends by them.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/trainer.hpp>

#include "support/posed_scene.hpp"
#include "support/small_cast.hpp"
#include "support/small_training.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace gsh::test {

/// Pictures of some steps, and what was learned at the end.
struct Outcome {
    std::vector<Image<float>> pictures;
    std::vector<double> losses;
    std::vector<float> learned;
    int failures = 0; ///< how often steps failed and were taken again
};

/// Takes steps until `count` are done. progress rises from `from`. Returns how often steps failed and were taken again.
template <class TrainerType>
int take_steps(TrainerType& trainer, std::uint64_t count, double from) {
    int failures = 0;
    while (trainer.step_count() < count) {
        const std::uint64_t stop = std::min(count, trainer.step_count() + 10); // as a program that reports now and then
        while (trainer.step_count() < stop)
            trainer.step(from + (1 - from) * static_cast<double>(trainer.step_count()) / static_cast<double>(count));
        trainer.settle(); // may go back to a step that failed
        failures += trainer.step_count() < stop;
    }
    return failures;
}

/// Buffers of a rasterizer grow in the first step, and later where a step would need larger ones.
enum class FirstView {
    usual,
    far,             ///< the camera of the first step is moved away: the splats cover few tiles, and a later step fails
    far_then_nearest ///< likewise, but before the first step, a picture with another camera enlarges the buffers
};

/// The photographs of a run whose first step shows photos[first].
inline std::vector<Photo> photos_from(FirstView view, std::vector<Photo> photos, std::size_t first) {
    const std::size_t camera = photos[first].camera_index;
    for (Photo& photo : photos)
        if (view != FirstView::usual && photo.camera_index == camera) photo.camera.t.z += 12;
    return photos;
}
/// The photograph of the first step of a trainer with this seed.
inline std::size_t first_index(std::size_t photos, std::uint64_t seed) {
    return shuffled_indices(static_cast<std::uint32_t>(photos), random_bits(seed, 0))[0];
}
/// What comes before the first step.
template <class TrainerType>
void enlarge_buffers(FirstView view, TrainerType& trainer, const std::vector<Photo>& photos) {
    Image<float> picture;
    for (const Photo& photo : photos)
        if (view == FirstView::far_then_nearest) trainer.render(photo, picture);
}

template <class TrainerType>
void observe(TrainerType& trainer, const Photo& photo, Outcome& outcome) {
    for (const StepValues& values : trainer.history()) {
        outcome.losses.push_back(values.loss);
        outcome.losses.push_back(values.psnr);
    }
    trainer.render(photo, outcome.pictures.emplace_back());
}

inline void append(std::vector<float>& to, const GaussianCloud<float>& cloud) {
    for (const auto& v : cloud.means) to.insert(to.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.log_scales) to.insert(to.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.quats) to.insert(to.end(), {v.w, v.x, v.y, v.z});
    for (const auto& v : cloud.sh) to.insert(to.end(), {v.x, v.y, v.z});
    to.insert(to.end(), cloud.opacity_logits.begin(), cloud.opacity_logits.end());
}

template <class B>
Outcome train_avatar(const SmallScene& scene, const ConfiguredAvatarParams& config, int steps = 5,
                     const TrainParams& train_config = small_training) {
    SmallTraining<B> training(scene, [] { return B(); }, 3, config, train_config);
    Outcome outcome;
    take_steps(training.trainer, steps, 0.1); // ambient occlusion joins at 0.1
    observe(training.trainer, scene.photos[1], outcome);
    outcome.learned = training.parameters();
    const AvatarData avatar = training.exported();
    append(outcome.learned, avatar.gaussians);
    outcome.learned.insert(outcome.learned.end(), avatar.ao.begin(), avatar.ao.end());
    return outcome;
}

/// The paper's network in mixed precision, or in float.
template <class B>
Outcome train_paper_network(const SmallScene& scene, Precision precision, int steps) {
    SmallTraining<B> training(scene, [] { return B(); }, 3, {.ao = AmbientOcclusion::time}, {}, paper_network);
    training.backend.set_precision(precision);
    Outcome outcome;
    take_steps(training.trainer, steps, 0.1);
    observe(training.trainer, scene.photos[1], outcome);
    outcome.learned = training.parameters();
    return outcome;
}

template <class B>
Outcome train_lit(const SmallScene& scene, int steps = 5) {
    SmallTraining<B> training(
        scene, [] { return B(); }, 3, {.ao = AmbientOcclusion::pose}, small_training, {},
        even_light(2, 3, {0, 0.8, 0}, 3));
    MotionRefinement<B> refinement(training.backend, training.rig, scene.motion, {}, test_time_params());
    training.people.refine(refinement);
    Outcome outcome;
    take_steps(training.trainer, steps, 0.1);
    observe(training.trainer, scene.photos[1], outcome);
    outcome.learned = training.parameters();
    const AvatarData avatar = training.exported();
    outcome.learned.insert(outcome.learned.end(), avatar.mean_irradiance.begin(), avatar.mean_irradiance.end());
    outcome.losses.insert(outcome.losses.end(), avatar.light->log_intensities.begin(),
                          avatar.light->log_intensities.end());
    return outcome;
}

/// Two people, the second in front of the first.
template <class B>
Outcome train_people(const SmallScene& scene, int steps, FirstView view = FirstView::usual) {
    const std::vector<Photo> photos = photos_from(view, scene.photos, first_index(scene.photos.size(), Cast<B>::seed));
    Cast<B> cast(scene, {moved(scene.motion, {-0.1, 0, -0.2}), moved(scene.motion, {0.12, 0.02, 0.5})}, photos,
                 [] { return B(); }, {.ao = AmbientOcclusion::time});
    Outcome outcome;
    enlarge_buffers(view, cast.trainer, photos);
    outcome.failures = take_steps(cast.trainer, steps, 0.1);
    observe(cast.trainer, photos[1], outcome);
    for (std::size_t person = 0; person < 2; ++person) {
        const std::vector<float> learned = cast.parameters(person);
        outcome.learned.insert(outcome.learned.end(), learned.begin(), learned.end());
    }
    return outcome;
}

inline GaussianCloud<float> start_cloud() {
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
Outcome train_static(const SmallScene& scene, int steps, FirstView view = FirstView::usual) {
    StaticModelParams config = static_model_params(steps);
    config.density.start = 4, config.density.stop = 30, config.density.interval = 5;
    config.density.reset_interval = 12, config.density.gradient_threshold = 1e-6;
    config.sh_degree = 1, config.sh_interval = 8, config.extent = 2;
    B backend;
    std::vector<Photo> photos;
    for (const Photo& photo : scene.photos)
        if (photo.frame == 0) photos.push_back(photo);
    photos = photos_from(view, photos, first_index(photos.size(), static_order_seed(5)));
    StaticModel<B> scene_model(backend, start_cloud(), config.extent, 5, config);
    Trainer<B, StaticModel<B>> trainer(backend, scene_model, photos, static_order_seed(5), train_params_of(config));
    Outcome outcome;
    enlarge_buffers(view, trainer, photos);
    outcome.failures = take_steps(trainer, steps, 0);
    observe(trainer, photos[0], outcome);
    append(outcome.learned, scene_model.cloud());
    CHECK(scene_model.size() > 4 * start_cloud().size()); // a change at most doubles it, so there were several
    CHECK(scene_model.total_change().split > 0);
    CHECK(scene_model.total_change().cloned > 0);
    CHECK(scene_model.total_change().pruned > 0);
    CHECK(scene_model.cloud().sh_degree == 1);
    return outcome;
}

inline RefinementParams everything() {
    RefinementParams config;
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

/// Steps of a trainer that refines everything, then what was learned.
template <class B, class Model, class SceneType, class TrainerType>
Outcome refine(const SmallScene& scene, B& backend, const RigData& rig, Model& model, SceneType& people,
               TrainerType& trainer, int steps) {
    MotionRefinement<B> refinement(backend, rig, scene.motion, scene.cameras, everything());
    people.refine(refinement);
    Outcome outcome;
    take_steps(trainer, steps, 0.2);
    observe(trainer, scene.photos[3], outcome);
    outcome.learned = learned_values(backend, model);
    outcome.losses.push_back(refinement.terms());
    const Motion motion = refinement.motion();
    for (const auto& angle : motion.pose) outcome.losses.insert(outcome.losses.end(), {angle.x, angle.y, angle.z});
    outcome.losses.insert(outcome.losses.end(), motion.expression.begin(), motion.expression.end());
    const Camera<double> camera = refinement.template camera<double>(1);
    outcome.losses.insert(outcome.losses.end(), {camera.fx, camera.cx, camera.t.x, camera.R[0][1]});
    return outcome;
}

template <class B>
Outcome train_refined(const SmallScene& scene, int steps = 8) {
    SmallTraining<B> training(scene, [] { return B(); }, 3, {.ao = AmbientOcclusion::pose});
    return refine(scene, training.backend, training.rig, training.model, training.people, training.trainer, steps);
}

/// The paper's avatar with everything refined: its levels, networks, SH, prior features, regions with fine levels, and
/// ambient occlusion over time. Only the tables are smaller, since there are few Gaussians.
///
/// One seed is not like another here. Of the many thousands of ReLUs in a step, now and then one has an input so near
/// zero that two runs which differ by rounding have it on different sides. Adam, whose steps do not depend on the size
/// of a gradient, then drives these runs apart. With 672 Gaussians, two runs of cpu::Serial, one with splats that are
/// moved by up to 8 roundings in each step, have pictures of about 61 dB from each other after 50 steps (medians of
/// seeds 3 to 10: 57 to 73 dB). With 168 Gaussians there are fewer ReLUs, and some seeds meet no such case. This is one
/// of them: 16 such pairs of runs have 101 dB and more, the emulated device and cpu::Serial 131 dB.
template <class B>
Outcome train_paper(const SmallScene& scene, int steps) {
    constexpr std::uint64_t seed = 43;
    B backend;
    const SurfaceSamples samples =
        sample_surface(scene.body, shaped_vertices(scene.body, scene.betas),
                       std::vector<double>(scene.body.vertex_count(), 3.0), seed);
    const RigData rig = make_rig(scene.body, scene.betas, samples);
    Rng rng(9);
    CanonicalPriors priors; // four depths and two normals
    for (std::size_t i = 0; i < samples.size(); ++i) priors.region.push_back(i % 2 ? 0 : rng.uniform(0, 1));
    priors.features = rng.numbers(10 * samples.size());
    using Model = ConfiguredAvatar<B>;
    const ConfiguredAvatarParams config{.appearance = {.field = {.grid = {.table_size = 2048}}},
                                        .ao = AmbientOcclusion::time,
                                        .occlusion = {.grid = {.table_size = 2048}}};
    Model model = make_avatar<B>(backend, rig, samples, scene.motion.frame_count(), seed, config, priors);
    AvatarScene<B, Model> people(backend, model, scene.motion);
    Trainer<B, AvatarScene<B, Model>> trainer(backend, people, scene.photos, seed, small_training);
    return refine(scene, backend, rig, model, people, trainer, steps);
}

template <class B>
Outcome fit_pose(const PosedScene& scene) {
    B backend;
    Avatar<B> avatar(backend, scene.avatar);
    PoseFit<B> fit(backend, scene.avatar.filter, {.steps = 4, .mask_weight = 0.3});
    MotionRefinement<B> motion(backend, scene.avatar.rig, scene.estimate(), {}, test_time_params());
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
    std::vector<vec3<float>> host = downloaded(backend, Span<const vec3<float>>(dL_dpose));
    for (std::size_t j = 0; j < host.size(); ++j)
        for (int k = 0; k < 3; ++k) outcome.learned[color.size() + 3 * j + static_cast<std::size_t>(k)] = host[j][k];
    return outcome;
}

} // namespace gsh::test
