// SPDX-License-Identifier: Apache-2.0
/// @file  The configuration `static`: one moment of a capture, or a reconstruction of COLMAP, as a 3DGS scene.
#pragma once

#include "support/output_folder.hpp"
#include "support/reconstruct_options.hpp"

#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/pipeline/density_control.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/pipeline/static_model.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/static_start.hpp>
#include <gsh/train/trainer.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

/// Photographs of one moment, and what the scene may start from.
struct StaticSource {
    std::string name;
    std::vector<PixelImage> images;        ///< what the photographs point into
    std::vector<Photo> training, test;
    std::optional<ColoredPoints> points;   ///< of structure from motion; else the masks' visual hull is filled

    StaticSource() = default;
    StaticSource(StaticSource&&) = default; // pixels stay where they are; in a copy they would not
    StaticSource& operator=(StaticSource&&) = default;
};

struct StaticOptions {
    StaticConfig config;
    std::size_t points = 0; ///< to start from, where the source brings none
    std::uint64_t seed = 0;
};

/// What a reconstruction's options mean for a static scene.
StaticOptions static_options(const ReconstructOptions& o);

/// What was made, and how good it is.
struct StaticResult {
    GaussianCloud<float> scene;
    std::vector<ImageScore> scores;        ///< of the test photographs
    ImageScore mean;                       ///< NaN without test photographs
    std::vector<Image<float>> pictures;    ///< render, truth and error of each
    std::uint64_t steps = 0;               ///< fewer than asked for if somebody interrupted
    double seconds = 0;                    ///< of training alone
    std::size_t threads = 0;
    DensityChange change;
};

/// One frame of a capture in memory; cameras with the role test are left out of training.
StaticSource static_source(const Capture& capture, std::size_t frame);

/// A folder of either kind: with cameras.json it is a capture, of which one frame's cameras and images are read and
/// nothing else; without, a reconstruction of COLMAP.
StaticSource load_static_source(const std::filesystem::path& folder, std::size_t frame = 0);

/// A scene in training.
class StaticReconstruction {
public:
    StaticModel<cpu::Threads> scene;
    Trainer<cpu::Threads, StaticModel<cpu::Threads>> trainer; ///< what computes is below, so that it is compiled once
    double seconds = 0;                                       ///< of training alone

    /// Errors  ValueError for a source that cannot be trained on; source must outlive this.
    StaticReconstruction(cpu::Threads& backend, const StaticSource& source, const StaticOptions& options);
    ~StaticReconstruction();

    /// Trains until step `until`, at most all of them, or until somebody interrupts; shows how far it is.
    void train(std::uint64_t until, const std::string& title = "training");

    /// gsh::compare: a photograph beside its render.
    [[nodiscard]] Comparison<float> compare(const Photo& photo);

private:
    std::uint64_t steps_;
};

/// Trains, showing how far it is, and judges on the test photographs.
StaticResult reconstruct_static(cpu::Threads& backend, const StaticSource& source,
                                const StaticOptions& options);

/// scene.ply, test/NAME.png (render, truth, error) and, last, metrics.json.
void write_static_result(OutputFolder& out, const StaticSource& source, const StaticOptions& options,
                         const StaticResult& result);

} // namespace gsh::examples
