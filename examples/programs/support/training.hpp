// SPDX-License-Identifier: Apache-2.0
/// @file  The training loop of the programs: steps, a progress line, checkpoints, and an end after an interrupt.
#pragma once

#include "support/reconstruct_options.hpp"

#include <cstdint>
#include <string>

namespace gsh::examples {

struct Reconstruction;
struct TrainingRecord;

/// Trains until the steps or the seconds of the run are over, until step `until` (0: no such limit), or until an
/// interrupt, whichever comes first. At the end it writes a checkpoint.
void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record,
           const std::string& title = "training", std::uint64_t until = 0);

} // namespace gsh::examples
