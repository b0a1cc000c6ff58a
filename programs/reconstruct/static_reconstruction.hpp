// SPDX-License-Identifier: Apache-2.0
/// @file  The configuration `static`: one frame of a capture, or a reconstruction of COLMAP, as a 3DGS scene.
#pragma once

#include "common/output_folder.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/image/image.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/reconstruct/static_reconstruction.hpp>
#include <gsh/reconstruct/training_record.hpp>
#include <gsh/train/evaluation.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace gsh::programs {

class Machine;

/// The scene and its figures.
struct StaticResult {
    GaussianCloud<float> scene;
    std::vector<ImageScore> scores;     ///< of the test photographs
    ImageScore mean;                    ///< NaN without test photographs
    std::vector<Image<float>> pictures; ///< render, truth and error of each
    TrainingRecord record;              ///< of fewer steps than requested after an interrupt
    DensityChange change;
};

/// A scene on the machine's backend. Input and machine must outlive it.
/// Errors  those of static_setup.
std::unique_ptr<AnyStaticReconstruction> make_static_reconstruction(Machine& machine, const StaticPhotos& input,
                                                                    const StaticRecipe& recipe);

/// Trains (train()) until step `until` (0: no such limit), the last step or an interrupt, and shows the progress.
void train_shown(AnyStaticReconstruction& reconstruction, const StaticRecipe& recipe, TrainingRecord& record,
                 const std::string& title = "training", std::uint64_t until = 0);

/// Trains with a progress line, and evaluates on the test photographs.
StaticResult reconstruct_static(Machine& machine, const StaticPhotos& input, const StaticRecipe& recipe);

/// Writes scene.ply, test/NAME.png (render, truth, error) and, as the last file, metrics.json.
void write_static_result(OutputFolder& out, const Machine& machine, const StaticPhotos& input,
                         const StaticRecipe& recipe, const StaticResult& result);

} // namespace gsh::programs
