// SPDX-License-Identifier: Apache-2.0
/// @file  Training as the programs show it: a line of progress, checkpoints, and an end after an interrupt.
#pragma once

#include "reconstruct/reconstruct_options.hpp"

#include <gsh/core/error.hpp>
#include <gsh/reconstruct/any_reconstruction.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/reconstruct/training_record.hpp>

#include <cstdint>
#include <string>

namespace gsh::programs {

/// Trains (train()) until the recipe or step `until` (0: no such limit) is over, or until an interrupt, and shows it. A
/// checkpoint is written at the options' interval and at the end.
void train_shown(AnyReconstruction& reconstruction, const Recipe& recipe, const ReconstructOptions& options,
                 TrainingRecord& record, const std::string& title = "training", std::uint64_t until = 0);

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

} // namespace gsh::programs
