// SPDX-License-Identifier: Apache-2.0
/// @file  The models of people with their trainer, on whichever backend, and the record of the training.
#pragma once

#include "support/reconstruction_setup.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/stage.hpp>
#include <gsh/train/step_history.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace gsh {
class ArchiveReader;
class ArchiveWriter;
} // namespace gsh

namespace gsh::examples {

/// Table rows of all people's fields.
struct TableCounts {
    std::size_t lookups = 0;              ///< that the fields of colour and displacement read in one pass
    std::size_t entries = 0, touched = 0; ///< of these fields' tables; touched: read by at least one Gaussian
    std::size_t ao_entries = 0, ao_touched = 0;
};

/// The models and their trainer. ReconstructionOn<B> (reconstruction_on.hpp) is the one on the backend B.
class Reconstruction {
public:
    const ReconstructionSetup setup;

    explicit Reconstruction(ReconstructionSetup made) : setup(std::move(made)) {}
    Reconstruction(const Reconstruction&) = delete;
    virtual ~Reconstruction() = default;

    /// Trainer::step. On a device, steps are queued, and step_count may go back until they are settled.
    virtual void step(double progress) = 0;
    /// Trainer::settle: waits for the steps so far. It comes before the other calls below.
    virtual void settle() = 0;
    [[nodiscard]] virtual std::uint64_t step_count() const = 0;

    /// Seconds in each stage of this run's steps, in the order of Stage, and the number of steps that were timed. A GPU
    /// is asked when steps are settled, so there only the last step before is timed.
    [[nodiscard]] virtual const std::array<double, stage_names.size()>& stage_seconds() const = 0;
    [[nodiscard]] virtual std::uint64_t timed_steps() const = 0;

    /// Trainer::history: settles, and returns the figures of the steps since the last call.
    [[nodiscard]] virtual std::vector<StepValues> history() = 0;
    /// False if a step is over when step() returns.
    [[nodiscard]] virtual bool queues_steps() const = 0;

    /// Trainer::release_memory, at the end of the training.
    virtual void release_memory() = 0;

    /// gsh::compare: a photograph and its render.
    [[nodiscard]] virtual Comparison<float> compare(const Photo& photo) = 0;

    /// The avatars in their present state, for files. An avatar's body may have fewer joints than that of the capture.
    [[nodiscard]] virtual std::vector<AvatarData> avatars() = 0;
    /// The present gain of each training photograph on red, green and blue, in linear light; 1 where none is learned.
    [[nodiscard]] virtual std::vector<std::array<double, 3>> photo_gains() const = 0;
    /// A person's present motion, with --refine.
    [[nodiscard]] virtual Motion refined_motion(std::size_t person) const = 0;

    /// Fills the Gaussians that no photograph saw, if the configuration says so, and returns their number for each
    /// person. Training cannot continue before end_fill.
    virtual std::vector<std::size_t> fill_unseen() = 0;
    virtual void end_fill() = 0;

    /// Fits the poses of the test frames to the test photographs. The avatars do not change. Several people are fitted
    /// in turns. Later figures are figures of test-time refinement. Returns false after an interrupt.
    virtual bool refine_test_poses() = 0;
    /// Restores the poses of training.
    virtual void end_test_refinement() = 0;

    /// The state of the training, for checkpoints. It does not depend on the backend.
    virtual void save(ArchiveWriter& file) = 0;
    /// Errors  those of load_trainer and load_refinement.
    virtual void load(const ArchiveReader& file) = 0;

    [[nodiscard]] virtual TableCounts table_counts() = 0;
};

/// A reconstruction on the machine's backend, initialised for the first step. The machine must outlive it.
std::unique_ptr<Reconstruction> make_reconstruction(Machine& machine, ReconstructionSetup setup);

/// The course of the training, for the report and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    std::uint64_t saved = 0;                                ///< step of the last checkpoint; 0: there is none
    double seconds = 0;                                     ///< of training only
    std::uint64_t interval = 10;                            ///< steps between samples
    std::vector<std::pair<double, double>> loss, psnr;      ///< (step, value) of the step's training view
    std::array<double, stage_names.size()> stage_seconds{}; ///< in the order of Stage
    std::uint64_t timed_steps = 0;                          ///< number of steps in stage_seconds

    /// Adds the figures of a step if a sample is due: at the first step and at multiples of the interval. When a curve
    /// becomes long, every second sample but the first is removed, so that it has at most a few hundred points.
    void add(const StepValues& values);
};

} // namespace gsh::examples
