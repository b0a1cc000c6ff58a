// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/training.hpp"

#include "common/interrupts.hpp"
#include "common/progress.hpp"
#include "reconstruct/results.hpp"

#include <gsh/reconstruct/train.hpp>

#include <cstdint>
#include <cstdio>
#include <string>

namespace gsh::programs {

void train_shown(AnyReconstruction& reconstruction, const Recipe& recipe, const ReconstructOptions& options,
                 TrainingRecord& record, const std::string& title, std::uint64_t until) {
    const double seconds_before = record.seconds;
    const std::uint64_t steps_before = reconstruction.step_count();
    Progress progress(title);
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
    TrainingEvents events;
    events.progress = [&](double share) { progress.show(share, status()); };
    events.stop = [] { return interrupted.load(); };
    events.checkpoint = [&] { save_checkpoint(checkpoint_path(options), reconstruction, record, options.given); };
    events.checkpoint_interval = options.checkpoint_interval;
    naming_checkpoint(record, [&] { train(reconstruction, recipe.length(), record, events, until); });
}

} // namespace gsh::programs
