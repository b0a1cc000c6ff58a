// SPDX-License-Identifier: Apache-2.0
#include "support/registered_source.hpp"

#include "support/figures.hpp"
#include "support/progress.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/body/pose_jumps.hpp>
#include <gsh/core/error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/fit/view_corrections.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/train/keypoint_scale.hpp>
#include <gsh/train/registration.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

namespace {

/// Frames that weigh less than a quarter.
std::vector<std::size_t> doubtful_frames(const std::vector<double>& weights) {
    std::vector<std::size_t> frames;
    for (std::size_t t = 0; t < weights.size(); ++t)
        if (weights[t] < 0.25) frames.push_back(t);
    return frames;
}

/// Gives each person the detections nearest to its estimated poses, corrected, and returns the number of photographs
/// with some.
std::size_t give_keypoints(Source& source, std::vector<RegisteredPerson>& people) {
    std::vector<Camera<double>> cameras;
    for (const NamedCamera& camera : source.capture.cameras) cameras.push_back(camera.camera);
    std::vector<MotionLandmarks> posed;
    for (const RegisteredPerson& person : people)
        posed.emplace_back(*person.body, *person.motion, landmarks_of(*person.body));
    const auto scales = keypoint_scales(source.keypoints, cameras, posed);
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (scales[c])
            throw ValueError("--keypoints: those of camera '" + source.capture.cameras[c].name + "' are " +
                             fixed(*scales[c], 2) +
                             " times as far from the image's corner as the points of the body that they " +
                             "show, so they were found in images of another size; detect on images of " +
                             std::to_string(cameras[c].width) + " x " + std::to_string(cameras[c].height) +
                             ", the size in which gsh reads them");
    auto found = keypoints_of_people(source.keypoints, cameras, posed, source.capture.frame_count());
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
        source.warnings.push_back("left and right of keypoints were swapped in " + std::to_string(swapped) +
                                  " photographs, and are swapped back");
    return count;
}

} // namespace

std::string RegistrationSummary::text() const {
    std::string result = "the registered bodies explain the photographs to " + fixed(psnr, 1) + " dB";
    for (const Moved& person : people)
        result += ", " + (people.size() > 1 ? person.name + ": " : std::string()) + "joints moved by " +
                  fixed(person.joints_mm, 0) + " mm (" + fixed(person.root_aligned_mm, 0) +
                  " mm relative to the root), the shape by " + fixed(person.betas, 2) + " per coefficient";
    if (focal) result += ", the focal length by " + fixed(100 * (*focal - 1), 1) + "%";
    if (keypoints > 0) result += ", with keypoints in " + std::to_string(keypoints) + " photographs";
    return result;
}

void register_source(cpu::Threads& backend, Source& source, const ReconstructOptions& options) {
    std::vector<RegisteredPerson> people;
    for (std::size_t p = 0; p < source.people.size(); ++p) {
        people.push_back({.body = &source.body(p), .motion = &source.people[p].motion});
        if (!source.body(p).faces.empty()) continue;
        source.warnings.push_back("the body of " + source.people[p].name +
                                  " has no triangles, so poses are not registered before training");
        return;
    }
    // Registration keeps the motion smooth, so one wrong pose would draw those beside it along.
    std::vector<Motion> smooth(people.size());
    for (std::size_t p = 0; p < people.size(); ++p) {
        const std::vector<PoseJump> jumps = pose_jumps(*people[p].body, *people[p].motion);
        if (jumps.empty()) continue;
        std::vector<std::size_t> frames;
        double farthest = 0;
        for (const auto& [frame, distance] : jumps) frames.push_back(frame), farthest = std::max(farthest, distance);
        source.warnings.push_back((people.size() > 1 ? source.people[p].name + ": " : std::string()) +
                                  "the poses of frames " + frames_text(frames) +
                                  " jump from those beside them by up to " + fixed(1e3 * farthest, 0) +
                                  " mm, so registration starts them half-way between these");
        smooth[p] = without_jumps(*people[p].motion, jumps);
        people[p].motion = &smooth[p];
    }
    RegistrationSummary summary;
    if (!source.keypoints.empty()) summary.keypoints = give_keypoints(source, people);
    const std::vector<Photo> photos = photos_of(source.capture, false);
    Progress shown("registering poses");
    RegistrationParams params =
        options.fine_registration > 0 ? fine_registration(options.fine_registration) : RegistrationParams();
    params.focal = options.refine_cameras;
    params.progress = [&](double share) { shown.show(share, ""); };
    Registration found = register_motions(backend, Span<const RegisteredPerson>(people), Span<const Photo>(photos),
                                          options.seed, params);
    shown.show(1, "done");

    summary.psnr = found.fits.back().psnr;
    if (found.focal) {
        Camera<double>& camera = source.capture.cameras[photos[0].camera_index].camera;
        camera.fx *= *found.focal, camera.fy *= *found.focal;
        summary.focal = found.focal;
    }
    summary.frame_weights = frame_weights(found.frame_fit);
    summary.doubtful_frames = doubtful_frames(summary.frame_weights);
    summary.frame_fit = std::move(found.frame_fit);
    for (std::size_t p = 0; p < people.size(); ++p) {
        const BodyModel& body = *people[p].body;
        Motion& before = source.people[p].motion;
        Motion& after = found.motions[p];
        double squares = 0;
        for (std::size_t k = 0; k < after.betas.size(); ++k)
            squares += std::pow(after.betas[k] - (k < before.betas.size() ? before.betas[k] : 0), 2);
        const auto moved = [&](RootAlignment aligned) { return joint_errors(body, after, before, aligned).mean_mm; };
        summary.people.push_back(
            {.name = source.people[p].name,
             .joints_mm = moved(RootAlignment::none),
             .root_aligned_mm = moved(RootAlignment::position),
             .betas = std::sqrt(squares / std::max(1.0, static_cast<double>(after.betas.size())))});
        before = std::move(after);
    }
    if (!summary.doubtful_frames.empty())
        source.warnings.push_back("frames " + frames_text(summary.doubtful_frames) +
                                  " fit clearly worse than the others after registration, so they weigh less in "
                                  "training; look at their poses and masks");
    source.registration = std::move(summary);
}

} // namespace gsh::examples
