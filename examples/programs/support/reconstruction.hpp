// SPDX-License-Identifier: Apache-2.0
/// @file  The models of people with their trainer, and the record of the training.
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
#include <gsh/train/light_estimate.hpp>
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

/// The models and their trainer, initialised for the first step.
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
        std::optional<Refinement> refinement, test_refinement; ///< of training frames; of test frames

        Person(Backend& backend, std::string called, CanonicalSetup made, std::uint64_t seed,
               const AvatarConfig& config);
    };

    Configuration configuration;
    std::string regions_checksum, priors_checksum; ///< of the source; empty if none are used
    std::deque<Person> people;                     ///< a deque: their addresses do not change
    std::vector<Photo> test_photos;
    std::vector<std::size_t> held_out_frames; ///< of the capture; empty if training leaves out no span of the motion
    Scene scene;
    TrainerType trainer; ///< to be read and stored; the calls that compute are members below, compiled once
    std::optional<MotionSplit> motion_split; ///< of test_photos, if a span is left out
    StageClock clock;    ///< times the steps of this run
    std::optional<LightEstimate> light_estimate; ///< with which the light starts, if there is one

    /// `source` must outlive this object, because photographs are not copied.
    Reconstruction(Backend& backend, const Source& source, const Configuration& chosen, const ReconstructOptions& o);
    Reconstruction(const Reconstruction&) = delete;
    ~Reconstruction();

    /// The number of Gaussians of all people.
    [[nodiscard]] std::size_t gaussian_count() const { return scene.size(); }

    /// Trainer::step, and the figures of the last step.
    void step(double progress);
    [[nodiscard]] double last_loss() const;
    [[nodiscard]] double last_psnr() const;

    /// gsh::compare: a photograph and its render.
    [[nodiscard]] Comparison<float> compare(const Photo& photo);

    /// The avatars in their present state, for files. An avatar's body may have fewer joints than that of the capture.
    [[nodiscard]] std::vector<AvatarData> avatars();

    /// Fits the poses of the test frames to the test photographs. The avatars do not change. Several people are fitted
    /// in turns. Later figures are figures of test-time refinement. Returns false after an interrupt.
    bool refine_test_poses(Backend& backend);
    /// Restores the poses of training.
    void end_test_refinement();

private:
    /// Estimates the light and shares it among the people.
    void light_people(Backend& backend);
    /// Creates the people, each with random numbers of its own.
    std::vector<CastMember<Model>> cast_of(Backend& backend, const Source& source, const ReconstructOptions& o);
};

/// The course of the training, for the report and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    double seconds = 0; ///< of training only
    std::uint64_t interval = 10;
    std::vector<std::pair<double, double>> loss, psnr; ///< (step, value) of the step's training view
    std::array<double, stage_names.size()> stage_seconds{}; ///< in the order of Stage
    std::uint64_t timed_steps = 0;                          ///< number of steps in stage_seconds

    [[nodiscard]] bool wants_sample() const { return steps == 1 || steps % interval == 0; }
    /// Adds a sample. When a curve becomes long, every second sample but the first is removed, so that it has at most a
    /// few hundred points.
    void add_sample(double loss_value, double psnr_value);
};

} // namespace gsh::examples
