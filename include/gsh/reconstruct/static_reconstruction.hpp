// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene in training on a backend. A file that includes it also includes the backend's overloads.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/reconstruct/any_training.hpp>
#include <gsh/reconstruct/static_photos.hpp>
#include <gsh/setup/static_start.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/step_history.hpp>
#include <gsh/train/trainer.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// Everything about a static scene except its input.
struct StaticRecipe {
    StaticModelParams config;
    std::size_t points = 20'000; ///< of the start, if the input has none
    std::uint64_t seed = 0;

    [[nodiscard]] TrainingLength length() const { return {.steps = static_cast<std::uint64_t>(config.steps)}; }
};

/// What the training of a scene starts from, on the host.
struct StaticSetup {
    GaussianCloud<float> start;
    double extent = 0; ///< metres
    std::vector<Photo> photos;
    std::uint64_t seed = 0;
    StaticModelParams config;
};

/// Places the first Gaussians.
/// Errors  ValueError for an input that cannot be trained on.
[[nodiscard]] inline StaticSetup static_setup(const StaticPhotos& input, const StaticRecipe& recipe) {
    const StaticModelParams& config = recipe.config;
    return {.start = initial_gaussians<float>(
                input.points ? *input.points
                             : visual_hull_points(input.training, hull_box(input.training), recipe.points,
                                                  mix_bits(recipe.seed))),
            .extent = config.extent != 0 ? config.extent : scene_extent(input.training),
            .photos = input.training,
            .seed = recipe.seed,
            .config = config};
}

/// A scene in training on a backend that is chosen at run time: StaticReconstruction<B> is the one on B. Call settle()
/// before the calls below.
class AnyStaticReconstruction : public AnyTraining {
public:
    /// The number of Gaussians.
    [[nodiscard]] virtual std::size_t size() const = 0;
    [[nodiscard]] virtual DensityChange total_change() const = 0;
    [[nodiscard]] virtual GaussianCloud<float> cloud() = 0;
    /// gsh::compare: a photograph and its render.
    [[nodiscard]] virtual Comparison<float> compare(const Photo& photo) = 0;
};

/// A static scene on a backend: model and trainer. train() (reconstruct/train.hpp) trains it, or step() in a loop of
/// your own.
template <Backend B>
class StaticReconstruction final : public TrainerCalls<StaticReconstruction<B>, AnyStaticReconstruction> {
    using Calls = TrainerCalls<StaticReconstruction<B>, AnyStaticReconstruction>;
    friend Calls;

public:
    /// The backend must outlive this object, and so must the pixels of the input.
    StaticReconstruction(B& backend, StaticSetup setup)
        : scene_(backend, setup.start, setup.extent, setup.seed, setup.config),
          trainer_(backend, scene_, std::move(setup.photos), static_order_seed(setup.seed),
                   train_params_of(setup.config)),
          timer_(backend) {}
    StaticReconstruction(B& backend, const StaticPhotos& input, const StaticRecipe& recipe)
        : StaticReconstruction(backend, static_setup(input, recipe)) {}

    bool queues_steps() const override { return !B::host_memory; }

    std::size_t size() const override { return scene_.size(); }
    DensityChange total_change() const override { return scene_.total_change(); }
    GaussianCloud<float> cloud() override { return scene_.cloud(); }
    Comparison<float> compare(const Photo& photo) override { return gsh::compare(trainer_, photo); }

private:
    StaticModel<B> scene_;
    Trainer<B, StaticModel<B>> trainer_;
    StageTimer<B> timer_;
};

} // namespace gsh
