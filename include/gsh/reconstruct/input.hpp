// SPDX-License-Identifier: Apache-2.0
/// @file  The input of a reconstruction: a capture, its people, their bodies, and what is known about them.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/capture/capture_person.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/reconstruct/registration_summary.hpp>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A capture, its people and their body models, from files or generated.
///
/// Shapes  bodies: one for all people, or several; CapturePerson::body is an index into them. regions: one of each
///         body, or none, so that face and hands are found on the body itself. priors: one of each person, or none.
///         keypoints: of photographs for training, in any order; or none.
struct ReconstructionInput {
    std::vector<BodyModel> bodies;
    std::vector<RegionLists> regions;
    Capture capture;
    std::vector<CapturePerson> people;
    std::vector<EstimatedPriors> priors;
    std::vector<PhotoKeypoints> keypoints;
    /// Texts that identify regions, priors and keypoints, so that a checkpoint is not continued with others.
    std::string regions_checksum, priors_checksum, keypoints_checksum;
    std::optional<RegistrationSummary> registration; ///< if the motions of people are registered ones
    std::vector<std::string> warnings;               ///< about the input, for its author

    [[nodiscard]] const BodyModel& body(std::size_t person = 0) const { return bodies[people[person].body]; }
    [[nodiscard]] const RegionLists& regions_of(std::size_t person) const {
        static const RegionLists none;
        return regions.empty() ? none : regions[people[person].body];
    }
    [[nodiscard]] const EstimatedPriors& priors_of(std::size_t person) const {
        static const EstimatedPriors none;
        return priors.empty() ? none : priors[person];
    }
    [[nodiscard]] BodyRegions body_regions_of(std::size_t person) const {
        return body_regions(body(person), regions_of(person));
    }
    /// The mesh of a person at a frame, in the pose of the capture, or the registered one.
    [[nodiscard]] PosedBody posed(std::size_t person, std::size_t frame) const {
        const Motion& motion = people[person].motion;
        return pose_body(body(person), motion.pose_at(frame), motion.transl[frame], motion.betas,
                         motion.expression_at(frame));
    }
    /// Whether every person's body has triangles, on which light falls.
    [[nodiscard]] bool has_meshes() const {
        return std::none_of(people.begin(), people.end(),
                            [&](const CapturePerson& person) { return bodies[person.body].faces.empty(); });
    }
};

/// The input with the one person of a capture, whose poses are the capture's motion.
[[nodiscard]] inline ReconstructionInput reconstruction_input(Capture capture, BodyModel body) {
    ReconstructionInput input;
    input.people.push_back({"person", 0, capture.motion});
    input.bodies.push_back(std::move(body));
    input.capture = std::move(capture);
    return input;
}

/// Checks that the parts of an input are of each other.
/// Errors  ValueError without people; ShapeError for lists that are not one of each body, or one of each person, and
///         for motions that are shorter or longer than the capture's.
inline void check_input(const ReconstructionInput& input) {
    constexpr std::string_view where = "ReconstructionInput";
    check_value(!input.people.empty(), where, "has no people");
    for (const CapturePerson& person : input.people) {
        check_value(person.body < input.bodies.size(), where,
                    person.name + " has body " + std::to_string(person.body) + " of " +
                        std::to_string(input.bodies.size()));
        check_size(where, "the motion of " + person.name, person.motion.frame_count(), input.capture.frame_count(),
                   "there must be a pose for each of the capture's frames");
    }
    if (!input.regions.empty())
        check_size(where, "regions", input.regions.size(), input.bodies.size(), "there must be one list per body");
    if (!input.priors.empty())
        check_size(where, "priors", input.priors.size(), input.people.size(), "there must be those of each person");
}

/// The test photographs. They are checked here, so that errors are reported before training.
/// Errors  ValueError for a photograph that is smaller than the SSIM window, or whose mask nowhere exceeds 1/2; for a
///         held-out span without a photograph.
[[nodiscard]] inline std::vector<Photo> test_photos_of(const Capture& capture) {
    std::vector<Photo> photos = photos_of(capture, true);
    const auto is_new = [&](const Photo& photo) { return capture.is_held_out(photo.frame); };
    check_value(capture.held_out_frames.empty() || std::any_of(photos.begin(), photos.end(), is_new),
                "the span of motion that is held out",
                "is frames " + detail::frames_text(capture.held_out_frames) +
                    ", of which there is no test image; expected a span that test cameras filmed");
    for (const Photo& photo : photos) {
        constexpr int least = SsimWindow<double>::size;
        check_value(photo.camera.width >= least && photo.camera.height >= least, "test image " + photo.name,
                    "is " + std::to_string(photo.camera.width) + " x " + std::to_string(photo.camera.height) +
                        " pixels, expected at least " + std::to_string(least) + " x " + std::to_string(least) +
                        " for SSIM");
        check_value(capture.shows_person({photo.camera_index, photo.frame}), "test image " + photo.name,
                    "has a mask (alpha) that nowhere exceeds 1/2, expected a mask that shows a person");
    }
    return photos;
}

} // namespace gsh
