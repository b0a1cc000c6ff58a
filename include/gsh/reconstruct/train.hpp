// SPDX-License-Identifier: Apache-2.0
/// @file  Trains avatars or a scene to the end of a run, with progress, checkpoints, and a way to stop.
#pragma once

#include <gsh/reconstruct/recipe.hpp>
#include <gsh/reconstruct/training_record.hpp>
#include <gsh/train/step_history.hpp>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace gsh {

/// Training settles at least after this many steps: a device queues them, and a stop waits for the queue. A refinement
/// of poses can take back 256.
inline constexpr std::uint64_t most_queued_steps = 100;
/// With TrainingLength::seconds, so many queued steps run beyond the end.
inline constexpr std::uint64_t most_queued_by_time = 10;

/// What train() calls, on the thread that called it. Any function may be empty. Their time does not count as training.
struct TrainingEvents {
    /// After every step; `share` of the run is over. On a device, steps may still be queued, and the record's curves
    /// end earlier; training.settle() waits for them, for example before a picture.
    std::function<void(double share)> progress = {};
    std::function<bool()> stop = {};       ///< true ends the training after this step
    std::function<void()> checkpoint = {}; ///< at the interval, and at the end; all steps are settled
    double checkpoint_interval = 0;        ///< seconds
};

/// Trains until the steps or the seconds of `length` are over, until step `until` (0: no such limit), or until
/// events.stop says so, whichever comes first. Goes on where the training is. At the end all steps are settled.
/// `record` is that of the training so far.
inline void train(AnyTraining& training, const TrainingLength& length, TrainingRecord& record,
                  const TrainingEvents& events = {}, std::uint64_t until = 0) {
    using Clock = std::chrono::steady_clock;
    const double seconds_before = record.seconds;
    const std::uint64_t steps_before = training.step_count(),
                        timed_before = record.timed_steps - training.timed_steps();
    auto stages_before = record.stage_seconds;
    for (std::size_t s = 0; s < stages_before.size(); ++s) stages_before[s] -= training.stage_seconds()[s];
    record.saved = steps_before;
    const auto note_stages = [&] {
        record.timed_steps = timed_before + training.timed_steps();
        for (std::size_t s = 0; s < stages_before.size(); ++s)
            record.stage_seconds[s] = stages_before[s] + training.stage_seconds()[s];
    };
    const auto checkpoint = [&] {
        note_stages();
        if (!events.checkpoint) return;
        events.checkpoint();
        record.saved = record.steps;
    };
    auto last_checkpoint = Clock::now();
    double paused = 0; // seconds of the events, which do not count as training
    const auto start = Clock::now();
    const auto since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };

    const auto share = [&] {
        return length.seconds > 0 ? record.seconds / length.seconds
                                  : static_cast<double>(training.step_count()) / static_cast<double>(length.steps);
    };
    const auto note = [&] {
        record.steps = training.step_count();
        record.seconds = seconds_before + since(start) - paused;
    };
    const auto goes_on = [&] {
        return share() < 1 && (until == 0 || training.step_count() < until) && !(events.stop && events.stop());
    };
    const auto settle = [&] {
        for (const StepValues& values : training.history()) record.add(values);
        note();
    };
    const std::uint64_t most_queued = !training.queues_steps() ? 1
                                      : length.seconds > 0     ? most_queued_by_time
                                                               : most_queued_steps;
    std::uint64_t queued = 0; // steps since the last settle
    while (goes_on()) {
        training.step(share());
        note();
        const bool checkpoint_is_due = events.checkpoint && since(last_checkpoint) > events.checkpoint_interval;
        if (++queued >= most_queued || checkpoint_is_due || !goes_on()) {
            const std::uint64_t last = record.steps;
            settle(); // waiting for steps is training, too
            queued = 0;
            if (record.steps < last) continue; // back at a step that failed
        }
        const auto pause = Clock::now();
        if (events.progress) events.progress(share());
        if (checkpoint_is_due) {
            checkpoint();
            last_checkpoint = Clock::now();
        }
        paused += since(pause);
    }
    settle(); // after a stop
    if (share() >= 1) training.finish();
    checkpoint();
}

} // namespace gsh
