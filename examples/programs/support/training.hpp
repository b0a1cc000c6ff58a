// SPDX-License-Identifier: Apache-2.0
/// @file  The training loop of the programs: steps, a progress line, checkpoints, and an end after an interrupt.
#pragma once

#include "support/reconstruct_options.hpp"

#include <cstdint>
#include <string>

namespace gsh::examples {

class Reconstruction;
struct TrainingRecord;

/// A loop settles at least after this many steps: a device queues them, and an interrupt waits for the queue. A
/// refinement of poses can take back 256.
inline constexpr std::uint64_t most_queued_steps = 100;

/// Trains until the steps or the seconds of the run are over, until step `until` (0: no such limit), or until an
/// interrupt, whichever comes first. At the end all steps are settled and a checkpoint is written.
void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record,
           const std::string& title = "training", std::uint64_t until = 0);

} // namespace gsh::examples
