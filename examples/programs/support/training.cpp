// SPDX-License-Identifier: Apache-2.0
#include "support/training.hpp"

#include "support/interrupts.hpp"
#include "support/progress.hpp"
#include "support/results.hpp"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>

namespace gsh::examples {

void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record,
           const std::string& title, std::uint64_t until) {
    using Clock = std::chrono::steady_clock;
    const double seconds_before = record.seconds;
    const std::uint64_t steps_before = reconstruction.step_count(),
                        timed_before = record.timed_steps - reconstruction.timed_steps();
    auto stages_before = record.stage_seconds;
    for (std::size_t s = 0; s < stages_before.size(); ++s) stages_before[s] -= reconstruction.stage_seconds()[s];
    record.saved = steps_before;
    const auto checkpoint = [&] {
        record.timed_steps = timed_before + reconstruction.timed_steps();
        for (std::size_t s = 0; s < stages_before.size(); ++s)
            record.stage_seconds[s] = stages_before[s] + reconstruction.stage_seconds()[s];
        save_checkpoint(options, reconstruction, record);
        record.saved = record.steps;
    };
    auto last_checkpoint = Clock::now();
    double paused = 0; // seconds of evaluation and checkpoints, which do not count as training
    const auto start = Clock::now();
    const auto since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };

    Progress progress(title);
    const auto fraction = [&] {
        return options.seconds > 0
                   ? record.seconds / options.seconds
                   : static_cast<double>(reconstruction.step_count()) / static_cast<double>(options.steps);
    };
    const auto status = [&] {
        char text[96];
        if (record.loss.empty()) // a GPU has not told them yet
            std::snprintf(text, sizeof text, "step %llu", static_cast<unsigned long long>(record.steps));
        else
            std::snprintf(text, sizeof text, "step %llu  PSNR %.2f dB  %.1f steps/s  loss %.4f",
                          static_cast<unsigned long long>(record.steps), record.psnr.back().second,
                          static_cast<double>(record.steps - steps_before) / (record.seconds - seconds_before),
                          record.loss.back().second);
        return std::string(text);
    };
    const auto note = [&] {
        record.steps = reconstruction.step_count();
        record.seconds = seconds_before + since(start) - paused;
    };
    const auto goes_on = [&] {
        return fraction() < 1 && (until == 0 || reconstruction.step_count() < until) && !interrupted;
    };
    const auto settle = [&] {
        for (const StepValues& values : reconstruction.history()) record.add(values);
        note();
    };
    const std::uint64_t most_queued =
        !reconstruction.queues_steps() ? 1 : options.seconds > 0 ? most_queued_by_time : most_queued_steps;
    std::uint64_t queued = 0; // steps since the last settle
    naming_checkpoint(record, [&] {
        while (goes_on()) {
            reconstruction.step(fraction());
            note();
            const bool checkpoint_is_due = since(last_checkpoint) > options.checkpoint_interval;
            if (++queued >= most_queued || checkpoint_is_due || !goes_on()) {
                const std::uint64_t last = record.steps;
                settle(); // waiting for steps is training, too
                queued = 0;
                if (record.steps < last) continue; // back at a step that failed
            }
            const auto pause = Clock::now();
            progress.show(fraction(), status());
            if (checkpoint_is_due) {
                checkpoint();
                last_checkpoint = Clock::now();
            }
            paused += since(pause);
        }
        settle(); // after an interrupt
        checkpoint();
    });
}

} // namespace gsh::examples
