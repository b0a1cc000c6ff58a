// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-reconstruct leaves in its output folder: checkpoint, avatar, figures, pictures, a page.
#pragma once

#include "support/output_folder.hpp"
#include "support/reconstruct_options.hpp"

#include <gsh/train/evaluation.hpp>
#include <gsh/train/trainer.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace gsh::examples {

class Judge;
struct Reconstruction;
struct Source;
struct TrainingRecord;

std::filesystem::path checkpoint_path(const ReconstructOptions& o);

void save_checkpoint(const ReconstructOptions& o, Reconstruction& reconstruction, const TrainingRecord& record);

/// Errors  ValueError for a checkpoint of another configuration or other people; else those of the file.
void load_checkpoint(const ReconstructOptions& o, Reconstruction& reconstruction, TrainingRecord& record);

/// What the figures measure, in words.
std::string measures_of(const Judge& judge);

/// How the figures came about, in words.
std::string protocol_of(const ReconstructOptions& o, const Source& source, const Configuration& configuration,
                        const Judge& judge, std::size_t images);

/// Judges the avatar on the test views and writes everything; metrics.json comes last, so whoever finds it finds all.
/// Returns nothing, and leaves nothing, if somebody interrupts.
std::optional<ImageScore> write_results(OutputFolder& out, const ReconstructOptions& o, const Source& source,
                                        Reconstruction& reconstruction, const TrainingRecord& record);

} // namespace gsh::examples
