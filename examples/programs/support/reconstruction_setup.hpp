// SPDX-License-Identifier: Apache-2.0
/// @file  What a reconstruction starts from. It is made on the host and does not depend on the backend of the training.
#pragma once

#include "support/reconstruct_options.hpp"

#include <gsh/avatar/rig.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/light/light.hpp>
#include <gsh/pipeline/canonical_points.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/refinement_config.hpp>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

class Machine;
struct Source;

struct ReconstructionSetup {
    /// One of the people: a name, random numbers of its own, and what make_canonical_setup returns.
    struct Person {
        std::string name;
        std::uint64_t seed = 0;
        Motion motion; ///< in the rig's joints
        SurfaceSamples samples;
        RigData rig;
        CanonicalPriors priors; ///< until make_reconstruction

        [[nodiscard]] std::size_t gaussian_count() const { return samples.size(); }
    };

    Configuration configuration;
    std::uint64_t seed = 0;
    std::string run; ///< run_text
    std::vector<Person> people;
    std::vector<Photo> photos, test_photos;     ///< of training; for evaluation
    std::vector<std::vector<UnknownPixel>> unknown; ///< of each photograph of training
    std::vector<std::vector<std::uint8_t>> pixels;  ///< of the photographs, after take_photographs
    std::vector<std::size_t> held_out_frames;   ///< of the capture; empty if training leaves out no span of the motion
    std::optional<MotionSplit> motion_split;    ///< of test_photos, if a span is left out
    std::optional<LightData> light;             ///< with which the light starts, if there is one
    std::string light_text;                     ///< how well it explains the photographs
    bool registered = false;                    ///< whether motions were registered before (register_source)
    std::optional<RefinementConfig> refinement; ///< of the poses, with --refine; joint_rates are each person's own
    std::vector<Camera<double>> cameras;        ///< that are refined, too; or none

    /// The number of Gaussians of all people.
    [[nodiscard]] std::size_t gaussian_count() const;
};

/// The input and settings of a run, one per line: people if there are several, settings, refinement, regions, estimated
/// priors, frames that are held out. A checkpoint belongs to one such text.
std::string run_text(const Source& source, const Configuration& configuration, const ReconstructOptions& o);

/// Places the Gaussians of all people, and estimates the light. `source` must outlive the result, because photographs
/// are not copied.
/// Errors  ValueError if --max-memory is too small for training on the machine, or the light cannot be estimated; those
///         of make_canonical_setup.
ReconstructionSetup make_setup(Machine& machine, const Source& source, const Configuration& configuration,
                               const ReconstructOptions& o);

/// Crops the photographs (crop_photo), makes their pixels the setup's own, and drops the images of the capture.
void take_photographs(ReconstructionSetup& setup, Capture& capture);

} // namespace gsh::examples
