// SPDX-License-Identifier: Apache-2.0
/// @file  The training loop of the programs: steps, a progress line, checkpoints, and an end when somebody interrupts.
#pragma once

#include "support/reconstruct_options.hpp"

#include <cstdint>
#include <string>

namespace gsh::examples {

struct Reconstruction;
struct TrainingRecord;

/// Trains until the steps or the seconds of the run are used up, until step `until` if that comes first (0: there is
/// none), or until somebody interrupts. A checkpoint is left behind.
void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record,
           const std::string& title = "training", std::uint64_t until = 0);

} // namespace gsh::examples
