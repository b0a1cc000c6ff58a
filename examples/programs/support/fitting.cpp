// SPDX-License-Identifier: Apache-2.0
#include "support/fitting.hpp"

#include "support/figures.hpp"
#include "support/input_files.hpp"
#include "support/motion_output.hpp"
#include "support/progress.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/body_height.hpp>
#include <gsh/fit/fit_motion.hpp>
#include <gsh/fit/standing_world.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

namespace {

/// The masks of a detector's folder, which the fit looks into.
struct LoadedMasks {
    std::vector<std::vector<PixelImage>> images; // [cameras] of [T] or none

    explicit LoadedMasks(const Detections& detections) {
        Progress shown("reading masks");
        double done = 0, count = 0;
        for (const auto& files : detections.masks) count += static_cast<double>(files.size());
        for (std::size_t c = 0; c < detections.masks.size(); ++c) {
            auto& of_camera = images.emplace_back();
            for (std::size_t t = 0; t < detections.masks[c].size(); ++t) {
                of_camera.push_back(load_detected_mask(detections, c, t));
                shown.show(++done / count, "");
            }
        }
    }
    [[nodiscard]] MaskView at(std::size_t camera, std::size_t frame) const {
        if (images[camera].empty()) return {};
        const PixelImage& mask = images[camera][frame];
        return {mask.height, mask.width, mask.data.data(), 1};
    }
};

/// The largest person of each photograph.
std::vector<PersonPhoto> photos_of(const Detections& detections, const LoadedMasks& masks) {
    std::vector<PersonPhoto> photos;
    for (const PhotoKeypoints& photo : detections.keypoints) {
        const Detection* best = nullptr;
        double largest = -1;
        for (const Detection& person : photo.people) {
            vec2<double> low(1e300), high(-1e300);
            for (const Keypoint& point : person.points) {
                if (point.confidence < 0.3) continue;
                low = {std::min(low.x, point.pixel.x), std::min(low.y, point.pixel.y)};
                high = {std::max(high.x, point.pixel.x), std::max(high.y, point.pixel.y)};
            }
            if (high.y - low.y > largest) largest = high.y - low.y, best = &person;
        }
        if (best) photos.push_back({photo.camera, photo.frame, *best, masks.at(photo.camera, photo.frame)});
    }
    return photos;
}

/// With one digit after the point; null for NaN.
Json rounded(double value) {
    return number_or_null(std::round(10 * value) / 10);
}

Json report_of(const Detections& detections, const MotionFit& fit, double height,
               const std::vector<std::size_t>& unseen) {
    Json cameras = Json::array();
    for (std::size_t c = 0; c < detections.cameras.size(); ++c) {
        const auto frames_of = [&](const auto& places) {
            std::vector<std::size_t> frames;
            for (const auto& [camera, frame] : places)
                if (camera == c) frames.push_back(frame);
            return frames;
        };
        cameras.push_back({{"name", detections.cameras[c].name},
                           {"keypoints", fit.camera_fit[c].count},
                           {"median_px", rounded(fit.camera_fit[c].pixels)},
                           {"median_mm", rounded(1e3 * fit.camera_fit[c].metres)},
                           {"late_seconds", fit.time_offsets[c]},
                           {"shift_px", {rounded(fit.shifts[c].x), rounded(fit.shifts[c].y)}},
                           {"swapped_sides_in_frames", frames_of(fit.swapped)},
                           {"detections_left_out_in_frames", frames_of(fit.left_out)}});
    }
    Json frames = Json::array();
    for (const double metres : fit.frame_fit) frames.push_back(rounded(1e3 * metres));
    return {{"cameras", cameras},
            {"frames", fit.motion.frame_count()},
            {"frames_without_person", unseen},
            {"frame_median_mm", frames},
            {"turn_degrees", fit.turn.degrees},
            {"pose_held", fit.held},
            {"focal_factor", fit.focal},
            {"height_m", height},
            {"photographs_with_outline", fit.outlines}};
}

/// What the user should know, worst first.
std::vector<std::string> advice_of(const Detections& detections, const MotionFit& fit,
                                   const std::vector<std::size_t>& unseen, const FitOptions& options) {
    std::vector<std::string> advice;
    for (std::size_t c = 0; c < detections.cameras.size(); ++c) {
        const std::string name = "camera '" + detections.cameras[c].name + "'";
        const KeypointFit& of = fit.camera_fit[c];
        constexpr double far = 0.04; // metres: twice what detectors miss by
        if (of.count == 0)
            advice.push_back(name + " shows nobody");
        else if (of.metres > far)
            advice.push_back("in " + name + " the body lies " + fixed(1e3 * of.metres, 0) +
                             " mm beside the keypoints: calibration or keypoints are wrong");
        if (fit.shifts[c] != vec2<double>(0))
            advice.push_back(name + " points beside its calibration: its principal point was moved by (" +
                             fixed(fit.shifts[c].x, 1) + ", " + fixed(fit.shifts[c].y, 1) + ") pixels");
        if (fit.time_offsets[c] != 0)
            advice.push_back(name + " took its images " + fixed(1e3 * std::abs(fit.time_offsets[c]), 0) + " ms " +
                             (fit.time_offsets[c] > 0 ? "later" : "earlier") +
                             " than the others: detect again with --late " + detections.cameras[c].name + "=" +
                             fixed(fit.time_offsets[c], 3));
    }
    if (!unseen.empty())
        advice.push_back("nobody was found in frames " + frames_text(unseen) +
                         "; their poses lie between those of the frames beside them");
    if (!fit.left_out.empty()) {
        std::vector<std::size_t> frames;
        for (const auto& place : fit.left_out) frames.push_back(place.second);
        std::sort(frames.begin(), frames.end());
        frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
        advice.push_back("the detector was wrong about the whole person in frames " + frames_text(frames) +
                         ", and is not believed there");
    }
    if (!fit.swapped.empty())
        advice.push_back("left and right were swapped in " + std::to_string(fit.swapped.size()) +
                         " photographs, and are swapped back");
    if (detections.cameras.size() == 1 && !fit.held)
        advice.push_back("one camera sees no depth: film one slow turn in one pose for arms and legs in their place");
    if (detections.cameras.size() == 1 && !options.height && !detections.calibrated)
        advice.push_back("the person's size is a guess: give --height");
    return advice;
}

} // namespace

std::vector<std::string> fit_capture(const FitOptions& options, const std::vector<std::filesystem::path>& to) {
    for (const auto& path : to) check_motion_output(path);
    Detections detections = load_detections(options.detections);
    const BodyModel body = body_of_file(options.body);
    const std::size_t C = detections.cameras.size(), T = detections.times.size();
    check_value(!options.focal || (C == 1 && !detections.calibrated), "--focal",
                "is for a single camera without a calibration");
    if (options.focal)
        detections.cameras[0].camera.fx = detections.cameras[0].camera.fy = *options.focal,
        detections.known_focal[0] = true;
    const LoadedMasks masks(detections);
    const std::vector<PersonPhoto> photos = photos_of(detections, masks);
    check_value(!photos.empty(), options.detections.string(),
                "nobody was found in any photograph; look at the pictures, and at the detector's messages");

    std::vector<Camera<double>> cameras;
    for (const NamedCamera& camera : detections.cameras) cameras.push_back(camera.camera);
    MotionFit fit;
    {
        Progress shown("fitting the body");
        constexpr int most_betas = 30;
        fit = fit_motion(body, cameras, photos, detections.times,
                         {.height = options.height,
                          .turn = options.turn == "auto" ? std::nullopt : std::optional(options.turn == "yes"),
                          .learn_focal = C == 1 && !detections.known_focal[0],
                          .betas = options.betas > 0 ? options.betas : std::min(most_betas, body.shape_count),
                          .progress = [&](double share) { shown.show(share, ""); }});
    }
    std::vector<std::size_t> unseen;
    for (std::size_t t = 0; t < T; ++t)
        if (std::none_of(photos.begin(), photos.end(), [&](const PersonPhoto& photo) { return photo.frame == t; }))
            unseen.push_back(t);

    CameraList list;
    list.cameras = detections.cameras;
    for (std::size_t c = 0; c < C; ++c) {
        Camera<double>& camera = list.cameras[c].camera;
        camera.fx *= fit.focal, camera.fy *= fit.focal;
        camera.cx += fit.shifts[c].x, camera.cy += fit.shifts[c].y;
    }
    if (!detections.calibrated) { // the world is the camera's: make it one to stand in
        const Affine<double> standing = standing_world(body, {fit.motion});
        for (std::size_t t = 0; t < T; ++t) move_frame(body, fit.motion, t, standing);
        for (NamedCamera& camera : list.cameras) camera.camera = moved_camera(camera.camera, standing);
        list.floor_y = 0;
    }
    if (T > 1) list.fps = static_cast<double>(T - 1) / (detections.times.back() - detections.times.front());
    for (std::size_t t = options.test_every / 2; options.test_every > 0 && t < T; t += options.test_every)
        list.test_frames.push_back(static_cast<int>(t));

    const double height = BodyHeight(body, body.shape_count).of(fit.motion.betas);
    save_motion(options.detections / "poses.npz", fit.motion);
    write_cameras(options.detections / "cameras.json", list);
    write_file(options.detections / "fit.json", report_of(detections, fit, height, unseen).dump(1) + "\n");
    std::vector<std::string> advice = advice_of(detections, fit, unseen, options);
    for (const auto& path : to) write_motion(path, fit.motion, body, advice);
    return advice;
}

} // namespace gsh::examples
