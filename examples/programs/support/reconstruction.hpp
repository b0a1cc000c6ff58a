// SPDX-License-Identifier: Apache-2.0
/// @file  The models of people with their trainer, and the record that is kept of training.
#pragma once

#include "support/reconstruct_options.hpp"
#include "support/source.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/pipeline/configured_avatar.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/canonical_setup.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/trainer.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

/// The models and their trainer, ready for the first step.
struct Reconstruction {
    using Backend = cpu::Threads;
    using Model = ConfiguredAvatar<Backend>;
    using Refinement = MotionRefinement<Backend, float>;
    using Scene = AvatarScene<Backend, Model>;
    using TrainerType = Trainer<Backend, Scene>;

    /// One of the people.
    struct Person {
        std::string name;
        CanonicalSetup setup;
        Model model;
        std::optional<Refinement> refinement, test_refinement; ///< of training frames, and of those to judge by

        Person(Backend& backend, std::string called, CanonicalSetup made, std::uint64_t seed,
               const AvatarConfig& config);
    };

    Configuration configuration;
    std::string regions_checksum, priors_checksum; ///< of the source; empty where none are used
    std::deque<Person> people;                     ///< they stay where they are
    std::vector<Photo> test_photos;
    Scene scene;
    TrainerType trainer; ///< to read and to keep; what computes is below, so that it is compiled once
    StageClock clock;    ///< of this run's steps

    /// source must outlive this: photographs are not copied.
    Reconstruction(Backend& backend, const Source& source, const Configuration& chosen, const ReconstructOptions& o);
    Reconstruction(const Reconstruction&) = delete;
    ~Reconstruction();

    /// Everybody's Gaussians.
    [[nodiscard]] std::size_t gaussian_count() const { return scene.size(); }

    /// Trainer::step; then what it came to.
    void step(double progress);
    [[nodiscard]] double last_loss() const;
    [[nodiscard]] double last_psnr() const;

    /// gsh::compare: a photograph beside its render.
    [[nodiscard]] Comparison<float> compare(const Photo& photo);

    /// The avatars as they are now, for files. A body with fewer joints than the capture's is what moves them.
    [[nodiscard]] std::vector<AvatarData> avatars();

    /// Fits the poses of the frames to judge by to their own photographs, the avatars staying as they are; several
    /// people take turns. Figures after this are figures of test-time refinement. False if somebody interrupted.
    bool refine_test_poses(Backend& backend);
    /// Back to the poses of training.
    void end_test_refinement();

private:
    /// Makes the people; each draws from random numbers of their own.
    std::vector<CastMember<Model>> cast_of(Backend& backend, const Source& source, const ReconstructOptions& o);
};

/// What is kept about the course of training, for the report and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    double seconds = 0; ///< of training alone
    std::uint64_t interval = 10;
    std::vector<std::pair<double, double>> loss, psnr; ///< (step, value) of the training view at hand
    std::array<double, stage_names.size()> stage_seconds{}; ///< in the order of Stage
    std::uint64_t timed_steps = 0;                          ///< steps that stage_seconds covers

    [[nodiscard]] bool wants_sample() const { return steps == 1 || steps % interval == 0; }
    /// A long run keeps the first and every other sample, so that a curve has at most a few hundred points.
    void add_sample(double loss_value, double psnr_value);
};

} // namespace gsh::examples
