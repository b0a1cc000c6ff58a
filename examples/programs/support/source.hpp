// SPDX-License-Identifier: Apache-2.0
/// @file  What is reconstructed, or checked: the capture, who is in it, their bodies, and its photographs.
#pragma once

#include "support/reconstruct_options.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/prior/estimated_view.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace gsh::examples {

/// What is reconstructed, or checked: body models, the capture and who is in it, wherever they come from.
struct Source {
    std::vector<BodyModel> bodies;
    std::vector<RegionLists> regions; ///< of each body, where they are asked for
    Capture capture;
    std::vector<CapturePerson> people;
    std::vector<EstimatedPriors> priors; ///< of each person
    std::string regions_checksum, priors_checksum; ///< empty where none are asked for
    std::vector<std::string> warnings;

    [[nodiscard]] const BodyModel& body(std::size_t person = 0) const { return bodies[people[person].body]; }
    /// A person's mesh at a frame, as the capture has it.
    [[nodiscard]] PosedBody posed(std::size_t person, std::size_t frame) const;
    [[nodiscard]] BodyRegions body_regions_of(std::size_t person) const;
};

/// Loads what the options name.
/// Errors  those of the files.
Source load_people(cpu::Threads& backend, const PeopleOptions& o, const CaptureOptions& how = {});

/// The same with regions and estimated priors, or the built-in actor, filmed.
Source load_source(cpu::Threads& backend, const ReconstructOptions& o);

/// Photographs to judge by. What cannot be judged had better be known before training than after it.
/// Errors  ValueError for a photograph that is smaller than the SSIM window, or whose mask nowhere exceeds 1/2.
std::vector<Photo> test_photos_of(const Capture& capture);

} // namespace gsh::examples
