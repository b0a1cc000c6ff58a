// SPDX-License-Identifier: Apache-2.0
/// @file  Registers the people of a reconstruction's input to its photographs.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/body/pose_jumps.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/fit/view_corrections.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/observer.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/registration/frame_doubt.hpp>
#include <gsh/registration/keypoint_scale.hpp>
#include <gsh/registration/registration.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Replaces the motions of the input's people by registered ones (register_motions), on the photographs for training,
/// and sets input.registration. Poses that jump from those before and after them start half-way between these.
/// Detections are given to the people whom they show, with left and right as the body has them. Skipped, with a
/// warning, if a body has no triangles. With recipe.refine_cameras, the focal length of a single training camera
/// learns, too, and replaces that of the capture. The work is done on `backend`; `host` prepares it.
///
/// Errors  those of register_motions; ValueError for keypoints that were found in images of another size.
template <Backend B, CpuBackend H>
void register_people(B& backend, H& host, ReconstructionInput& input, const Recipe& recipe,
                     const Observer& observer = {});
/// The same where the backend is the host.
template <CpuBackend B>
void register_people(B& backend, ReconstructionInput& input, const Recipe& recipe, const Observer& observer = {}) {
    register_people(backend, backend, input, recipe, observer);
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Gives each person the detections nearest to its estimated poses, corrected, and returns the number of photographs
/// with some.
inline std::size_t give_keypoints(ReconstructionInput& input, std::vector<RegisteredPerson>& people) {
    std::vector<Camera<double>> cameras;
    for (const NamedCamera& camera : input.capture.cameras) cameras.push_back(camera.camera);
    std::vector<MotionLandmarks> posed;
    for (const RegisteredPerson& person : people)
        posed.emplace_back(*person.body, *person.motion, landmarks_of(*person.body));
    const auto scales = keypoint_scales(input.keypoints, cameras, posed);
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (scales[c])
            throw ValueError("keypoints: those of camera '" + input.capture.cameras[c].name + "' are " +
                             fixed(*scales[c], 2) +
                             " times as far from the image's corner as the points of the body that they " +
                             "show, so they were found in images of another size; detect on images of " +
                             std::to_string(cameras[c].width) + " x " + std::to_string(cameras[c].height) +
                             ", the size in which gsh reads them");
    auto found = keypoints_of_people(input.keypoints, cameras, posed, input.capture.frame_count());
    std::size_t count = 0;
    std::size_t swapped = 0;
    for (std::size_t p = 0; p < people.size(); ++p) {
        ViewCorrections corrections = correct_views(found[p], cameras.size());
        const auto places = [&](std::size_t frame) {
            return [&, frame](int landmark) -> std::optional<vec3<double>> {
                if (!posed[p].has(landmark)) return std::nullopt;
                return posed[p].at(frame, landmark);
            };
        };
        swap_sides_against_motion(found[p], places, corrections.swapped);
        swapped += corrections.swapped.size();
        for (const auto& frame : found[p])
            count += static_cast<std::size_t>(std::count_if(
                frame.begin(), frame.end(), [](const ViewKeypoints& view) { return !view.points.empty(); }));
        people[p].keypoints = std::move(found[p]);
    }
    if (swapped > 0)
        input.warnings.push_back("left and right of keypoints were swapped in " + std::to_string(swapped) +
                                 " photographs, and are swapped back");
    return count;
}

/// Registration keeps the motion smooth, so one wrong pose would draw its neighbours along. Returns a person's motion
/// without such poses; without frames if there are none.
inline Motion smooth_start(ReconstructionInput& input, std::size_t person) {
    const Motion& motion = input.people[person].motion;
    const std::vector<PoseJump> jumps = pose_jumps(input.body(person), motion);
    if (jumps.empty()) return {};
    std::vector<std::size_t> frames;
    double farthest = 0;
    for (const auto& [frame, distance] : jumps) frames.push_back(frame), farthest = std::max(farthest, distance);
    input.warnings.push_back((input.people.size() > 1 ? input.people[person].name + ": " : std::string()) +
                             "the poses of frames " + frames_text(frames) + " jump from those beside them by up to " +
                             fixed(1e3 * farthest, 0) + " mm, so registration starts them half-way between these");
    return without_jumps(motion, jumps);
}

/// How far a registration moved a person.
inline RegistrationSummary::Moved moved_person(const CapturePerson& person, const BodyModel& body,
                                               const Motion& after) {
    const Motion& before = person.motion;
    double squares = 0;
    for (std::size_t k = 0; k < after.betas.size(); ++k)
        squares += std::pow(after.betas[k] - (k < before.betas.size() ? before.betas[k] : 0), 2);
    const auto moved = [&](RootAlignment aligned) { return joint_errors(body, after, before, aligned).mean_mm; };
    return {.name = person.name,
            .joints_mm = moved(RootAlignment::none),
            .root_aligned_mm = moved(RootAlignment::position),
            .betas = std::sqrt(squares / std::max(1.0, static_cast<double>(after.betas.size())))};
}

} // namespace detail

template <Backend B, CpuBackend H>
void register_people(B& backend, H& host, ReconstructionInput& input, const Recipe& recipe, const Observer& observer) {
    for (std::size_t p = 0; p < input.people.size(); ++p) {
        if (!input.body(p).faces.empty()) continue;
        input.warnings.push_back("the body of " + input.people[p].name +
                                 " has no triangles, so poses are not registered before training");
        return;
    }
    std::vector<Motion> smooth; // before their addresses are taken
    for (std::size_t p = 0; p < input.people.size(); ++p) smooth.push_back(detail::smooth_start(input, p));
    std::vector<RegisteredPerson> people;
    for (std::size_t p = 0; p < input.people.size(); ++p)
        people.push_back(
            {.body = &input.body(p), .motion = smooth[p].frame_count() > 0 ? &smooth[p] : &input.people[p].motion});
    RegistrationSummary summary;
    if (!input.keypoints.empty()) summary.keypoints = detail::give_keypoints(input, people);
    const std::vector<Photo> photos = photos_of(input.capture, false);
    const ObservedStage stage(observer, "registering poses");
    RegistrationParams params =
        recipe.fine_registration > 0 ? fine_registration(recipe.fine_registration) : RegistrationParams();
    params.focal = recipe.refine_cameras;
    params.progress = [&](double share) { stage.tell(share, ""); };
    Registration found = register_motions(backend, host, Span<const RegisteredPerson>(people),
                                          Span<const Photo>(photos), recipe.seed, params);
    stage.tell(1, "done");

    summary.psnr = found.fits.back().psnr;
    if (found.focal) {
        Camera<double>& camera = input.capture.cameras[photos[0].camera_index].camera;
        camera.fx *= *found.focal, camera.fy *= *found.focal;
        summary.focal = found.focal;
    }
    summary.frame_weights = frame_weights(found.frame_fit);
    for (std::size_t t = 0; t < summary.frame_weights.size(); ++t)
        if (summary.frame_weights[t] < 0.25) summary.doubtful_frames.push_back(t);
    summary.frame_fit = std::move(found.frame_fit);
    for (std::size_t p = 0; p < people.size(); ++p) {
        summary.people.push_back(detail::moved_person(input.people[p], input.body(p), found.motions[p]));
        input.people[p].motion = std::move(found.motions[p]);
    }
    if (!summary.doubtful_frames.empty())
        input.warnings.push_back("frames " + detail::frames_text(summary.doubtful_frames) +
                                 " fit clearly worse than the others after registration, so they weigh less in "
                                 "training; look at their poses and masks");
    input.registration = std::move(summary);
}

} // namespace gsh
