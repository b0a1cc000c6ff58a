// SPDX-License-Identifier: Apache-2.0
/// @file  The configuration `static`: one frame of a capture, or a reconstruction of COLMAP, as a 3DGS scene.
#pragma once

#include "common/output_folder.hpp"
#include "reconstruct/reconstruct_options.hpp"

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/setup/static_start.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/static_model.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

class Machine;

/// Photographs of one moment, and points to initialise the scene with.
struct StaticSource {
    std::string name;
    std::vector<PixelImage> images; ///< the pixels of the photographs
    std::vector<Photo> training, test;
    std::vector<std::string> warnings;   ///< of the reader
    std::optional<ColoredPoints> points; ///< of structure from motion; else the masks' visual hull is filled

    StaticSource() = default;
    StaticSource(StaticSource&&) = default; // a move keeps the addresses of the pixels, a copy would not
    StaticSource& operator=(StaticSource&&) = default;
};

struct StaticOptions {
    StaticConfig config;
    std::size_t points = 0; ///< number of initial points if the source has none
    std::uint64_t seed = 0;
};

/// The options of a static scene that follow from those of a reconstruction.
StaticOptions static_options(const ReconstructOptions& o);

/// The scene and its figures.
struct StaticResult {
    GaussianCloud<float> scene;
    std::vector<ImageScore> scores;     ///< of the test photographs
    ImageScore mean;                    ///< NaN without test photographs
    std::vector<Image<float>> pictures; ///< render, truth and error of each
    std::uint64_t steps = 0;            ///< less than requested after an interrupt
    double seconds = 0;                 ///< of training only
    DensityChange change;
};

/// One frame of a capture in memory. Cameras with the role test are not used for training.
StaticSource static_source(const Capture& capture, std::size_t frame);

/// Loads a folder. A folder with cameras.json is a capture, of which only the cameras and the images of one frame are
/// read. Any other folder is a reconstruction of COLMAP.
StaticSource load_static_source(const std::filesystem::path& folder, std::size_t frame = 0);

/// What the training of a scene starts from, on the host.
struct StaticSetup {
    GaussianCloud<float> start;
    double extent = 0; ///< metres
    std::vector<Photo> photos;
    std::uint64_t seed = 0;
    StaticConfig config;
};

/// A scene in training. StaticReconstructionOn<B> (static_reconstruction_on.hpp) is the one on the backend B.
class StaticReconstruction {
public:
    double seconds = 0; ///< of training only

    explicit StaticReconstruction(std::uint64_t steps) : steps_(steps) {}
    StaticReconstruction(const StaticReconstruction&) = delete;
    virtual ~StaticReconstruction() = default;

    /// Trains until step `until`, the last step or an interrupt. Shows the progress.
    void train(std::uint64_t until, const std::string& title = "training");

    [[nodiscard]] virtual std::uint64_t step_count() const = 0;
    /// The number of Gaussians.
    [[nodiscard]] virtual std::size_t size() const = 0;
    [[nodiscard]] virtual DensityChange total_change() const = 0;
    [[nodiscard]] virtual GaussianCloud<float> cloud() = 0;
    /// gsh::compare: a photograph and its render.
    [[nodiscard]] virtual Comparison<float> compare(const Photo& photo) = 0;

private:
    virtual void step() = 0;
    virtual void settle() = 0;

    std::uint64_t steps_;
};

/// Places the first Gaussians.
/// Errors  ValueError for a source that cannot be trained on.
StaticSetup static_setup(const StaticSource& source, const StaticOptions& options);

/// A scene on the machine's backend. Source and machine must outlive it.
/// Errors  those of static_setup.
std::unique_ptr<StaticReconstruction> make_static_reconstruction(Machine& machine, const StaticSource& source,
                                                                 const StaticOptions& options);

/// Trains with a progress line, and evaluates on the test photographs.
StaticResult reconstruct_static(Machine& machine, const StaticSource& source, const StaticOptions& options);

/// Writes scene.ply, test/NAME.png (render, truth, error) and, as the last file, metrics.json.
void write_static_result(OutputFolder& out, const Machine& machine, const StaticSource& source,
                         const StaticOptions& options, const StaticResult& result);

} // namespace gsh::programs
