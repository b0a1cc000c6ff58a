// SPDX-License-Identifier: Apache-2.0
/// @file  The training loop of the programs: steps, a progress line, checkpoints, and an end after an interrupt.
#pragma once

#include "support/reconstruct_options.hpp"
#include "support/reconstruction.hpp"

#include <gsh/core/error.hpp>

#include <cstdint>
#include <string>

namespace gsh::examples {

/// A loop settles at least after this many steps: a device queues them, and an interrupt waits for the queue. A
/// refinement of poses can take back 256.
inline constexpr std::uint64_t most_queued_steps = 100;
/// With --seconds, so many queued steps run beyond the end.
inline constexpr std::uint64_t most_queued_by_time = 10;

/// Trains until the steps or the seconds of the run are over, until step `until` (0: no such limit), or until an
/// interrupt, whichever comes first. At the end all steps are settled and a checkpoint is written.
void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record,
           const std::string& title = "training", std::uint64_t until = 0);

/// call(); an error also tells from which checkpoint the run can be resumed, if there is one.
template <class Call>
auto naming_checkpoint(const TrainingRecord& record, const Call& call) {
    try {
        return call();
    } catch (const Error& error) {
        if (record.saved == 0) throw;
        throw Error(std::string(error.what()) + " (the checkpoint of step " + std::to_string(record.saved) +
                    " is complete; the run can be resumed from it)");
    }
}

} // namespace gsh::examples
