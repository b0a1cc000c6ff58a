// SPDX-License-Identifier: Apache-2.0
/// @file  The output files of gsh-reconstruct: checkpoint, avatar, figures, pictures, a page.
#pragma once

#include "common/figures.hpp"
#include "common/output_folder.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/reconstruct/any_reconstruction.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/judge.hpp>
#include <gsh/reconstruct/resume.hpp>
#include <gsh/reconstruct/training_record.hpp>
#include <gsh/train/evaluation.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::programs {

class Machine;

std::filesystem::path checkpoint_path(const ReconstructOptions& o);

/// Errors  IoError if there is no checkpoint to resume.
void check_resumable(const ReconstructOptions& o);

/// The end of a message about a checkpoint of another run.
inline constexpr std::string_view resume_advice =
    "; leave out what --resume takes from the checkpoint: --config, --set, --gaussians, --refine, --no-registration, "
    "--fine-registration, --keypoints, --regions, --priors, --hold-out-motion and --poses";

/// A text that describes the measures.
std::string measures_of(const Judge<cpu::Threads>& judge);

/// A text that describes how the figures were obtained.
std::string protocol_of(const ReconstructOptions& o, const ReconstructionInput& input, const ReconstructionSetup& setup,
                        const Judge<cpu::Threads>& judge);

/// Means over the test views.
struct TestFigures {
    ImageScore mean;
    std::optional<SeenAndNew> motion;  ///< with --hold-out-motion
    std::vector<std::string> findings; ///< what training found out about the input, for the user
};

/// Evaluates the avatar on the test views and writes all files. metrics.json is the last one: if it exists, all files
/// are complete. After an interrupt it returns nothing and leaves no files.
std::optional<TestFigures> write_results(OutputFolder& out, const ReconstructOptions& o, Machine& machine,
                                         const ReconstructionInput& input, AnyReconstruction& reconstruction,
                                         const TrainingRecord& record);

} // namespace gsh::programs
