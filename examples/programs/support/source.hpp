// SPDX-License-Identifier: Apache-2.0
/// @file  The input of a reconstruction or a check: the capture, its people, their bodies, and its photographs.
#pragma once

#include "support/reconstruct_options.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/prior/estimated_view.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

/// How far register_source moved the people, and how well their bodies then explain the photographs.
struct RegistrationSummary {
    struct Moved {
        std::string name;
        double joints_mm = 0, root_aligned_mm = 0; ///< means over joints and frames
        double betas = 0;                          ///< root mean square over coefficients
    };
    double psnr = 0; ///< of the last level's photographs
    std::size_t keypoints = 0; ///< photographs with keypoints of these people
    std::optional<double> focal; ///< factor on the focal lengths, if that of a single camera has learned
    std::vector<Moved> people;
    std::vector<double> frame_fit;           ///< [T]; NaN for frames without a photograph
    std::vector<double> frame_weights;        ///< [T] with which the frames' photographs are trained
    std::vector<std::size_t> doubtful_frames; ///< that fit much worse than the others

    [[nodiscard]] std::string text() const;
};

/// The input of a reconstruction or a check: body models, the capture and its people, from files or generated.
struct Source {
    std::vector<BodyModel> bodies;
    std::vector<RegionLists> regions; ///< of each body; empty lists without --regions
    Capture capture;
    std::vector<CapturePerson> people;
    std::vector<EstimatedPriors> priors; ///< of each person
    std::string regions_checksum, priors_checksum; ///< empty without --regions, --priors
    std::vector<std::string> warnings;
    std::vector<PhotoKeypoints> keypoints; ///< of training photographs; empty without --keypoints
    std::string keypoints_checksum;        ///< likewise
    std::optional<RegistrationSummary> registration; ///< if the motions of people are registered ones

    [[nodiscard]] const BodyModel& body(std::size_t person = 0) const { return bodies[people[person].body]; }
    /// The mesh of a person at a frame, in the pose of the capture, or the registered one.
    [[nodiscard]] PosedBody posed(std::size_t person, std::size_t frame) const;
    [[nodiscard]] BodyRegions body_regions_of(std::size_t person) const;
};

/// Loads the files that the options name.
/// Errors  those of the files.
Source load_people(cpu::Threads& backend, const PeopleOptions& o, const CaptureOptions& how = {});

/// The same with regions and estimated priors; or films the built-in actor.
Source load_source(cpu::Threads& backend, const ReconstructOptions& o);

/// The configuration of a run on a source. Light falls on triangles: if a person's body has none, and neither --config
/// nor --set requests light, it is `paper` instead of the default, and the source has a warning that states this.
Configuration configuration_for(const ReconstructOptions& o, Source& source);

/// The test photographs. They are checked here, so that errors are reported before training.
/// Errors  ValueError for a photograph that is smaller than the SSIM window, or whose mask nowhere exceeds 1/2; for a
///         held-out span without a photograph.
std::vector<Photo> test_photos_of(const Capture& capture);

} // namespace gsh::examples
