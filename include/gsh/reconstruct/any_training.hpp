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
    /// After the last step of a run, when all are settled: a short run may end before the last stage of its schedule,
    /// and its result then enters it.
    virtual void finish() {}
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

/// The calls of a training that a Trainer and a StageTimer answer. Any is AnyTraining or derived from it, and Self,
/// which derives from this class, has the members trainer_ and timer_.
template <class Self, class Any>
class TrainerCalls : public Any {
public:
    using Any::Any;

    void step(double progress) override { self().trainer_.step(progress, self().timer_); }
    void settle() override {
        self().trainer_.settle();
        self().timer_.sample();
    }
    std::uint64_t step_count() const override { return self().trainer_.step_count(); }
    const std::array<double, stage_names.size()>& stage_seconds() const override { return self().timer_.seconds(); }
    std::uint64_t timed_steps() const override { return self().timer_.steps(); }
    std::vector<StepValues> history() override {
        settle();
        return self().trainer_.history();
    }

private:
    Self& self() { return static_cast<Self&>(*this); }
    const Self& self() const { return static_cast<const Self&>(*this); }
};

/// How long a training is, over which its rates fall.
struct TrainingLength {
    std::uint64_t steps = 3000;
    double seconds = 0; ///< instead of steps; 0: use steps
};

} // namespace gsh
