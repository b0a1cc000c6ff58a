// SPDX-License-Identifier: Apache-2.0
/// @file  A training on whichever backend, and how long it is: what train() needs.
#pragma once

#include <gsh/train/stage.hpp>
#include <gsh/train/step_history.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace gsh {

/// Something that trains step by step. Avatars (AnyReconstruction) and static scenes (AnyStaticReconstruction) are.
class AnyTraining {
public:
    AnyTraining() = default;
    AnyTraining(const AnyTraining&) = delete;
    AnyTraining& operator=(const AnyTraining&) = delete;
    virtual ~AnyTraining() = default;

    /// Trainer::step. On a device, steps are queued, and step_count may go back until they are settled.
    virtual void step(double progress) = 0;
    /// Trainer::settle: waits for the steps so far. It comes before all calls that read results.
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
};

/// How long a training is, over which its rates fall.
struct TrainingLength {
    std::uint64_t steps = 3000;
    double seconds = 0; ///< instead of steps; 0: use steps
};

} // namespace gsh
