// SPDX-License-Identifier: Apache-2.0
/// @file  The output files of gsh-reconstruct: checkpoint, avatar, figures, pictures, a page.
#pragma once

#include "support/figures.hpp"
#include "support/output_folder.hpp"
#include "support/reconstruct_options.hpp"

#include <gsh/train/evaluation.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

class Judge;
class Machine;
class Reconstruction;
struct ReconstructionSetup;
struct Source;
struct TrainingRecord;

std::filesystem::path checkpoint_path(const ReconstructOptions& o);

void save_checkpoint(const ReconstructOptions& o, Reconstruction& reconstruction, const TrainingRecord& record);

/// ReconstructOptions::given of the run that wrote the checkpoint; empty if a version wrote it that did not store them.
/// Errors  IoError if there is no checkpoint to resume; those of the file.
std::string checkpoint_options(const ReconstructOptions& o);

/// Checks that the checkpoint belongs to a run (run_text), except for the number of Gaussians, which is not known before
/// they are placed.
/// Errors  as for load_checkpoint.
void check_checkpoint(const ReconstructOptions& o, const std::string& run);

/// A checkpoint of any backend fits.
/// Errors  ValueError for a checkpoint of another configuration or of other people; else those of the file.
void load_checkpoint(const ReconstructOptions& o, Reconstruction& reconstruction, TrainingRecord& record);

/// A text that describes the measures.
std::string measures_of(const Judge& judge);

/// A text that describes how the figures were obtained.
std::string protocol_of(const ReconstructOptions& o, const Source& source, const ReconstructionSetup& setup,
                        const Judge& judge);

/// Means over the test views.
struct TestFigures {
    ImageScore mean;
    std::optional<SeenAndNew> motion; ///< with --hold-out-motion
    std::vector<std::string> findings; ///< what training found out about the input, for the user
};

/// Evaluates the avatar on the test views and writes all files. metrics.json is the last one: if it exists, all files
/// are complete. After an interrupt it returns nothing and leaves no files.
std::optional<TestFigures> write_results(OutputFolder& out, const ReconstructOptions& o, Machine& machine,
                                         const Source& source, Reconstruction& reconstruction,
                                         const TrainingRecord& record);

} // namespace gsh::examples
