// SPDX-License-Identifier: Apache-2.0
#include "support/fitting.hpp"

#include "support/figures.hpp"
#include "support/input_files.hpp"
#include "support/motion_output.hpp"
#include "support/progress.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/body_height.hpp>
#include <gsh/fit/fit_motion.hpp>
#include <gsh/fit/mended_masks.hpp>
#include <gsh/fit/outlines.hpp>
#include <gsh/fit/standing_world.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/math/spread.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::examples {

namespace {

namespace fs = std::filesystem;

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

/// Masks that the fitted body mended.
struct MendedMasks {
    std::size_t cut = 0, filled = 0; ///< photographs in which more than 1% of the body's area changed
};

/// Writes the mended masks to masks/; the detector's go to masks_detected/, from which the next fit reads them.
MendedMasks mend_masks(const fs::path& folder, const Detections& detections, LoadedMasks& masks, const BodyModel& model,
                       const MotionFit& fit, const std::vector<Camera<double>>& cameras) {
    MendedMasks result;
    const Motion& posed = fit.motion;
    const FittedBody body(model, static_cast<int>(fit.state.betas.size()));
    const OutlineSamples samples(model, body);
    MaskMender mender(model, body, samples);
    Progress shown("mending masks");
    const std::size_t C = cameras.size(), T = posed.frame_count();
    for (std::size_t c = 0; c < C; ++c)
        for (std::size_t t = 0; t < T; ++t)
            if (const MaskView mask = masks.at(c, t))
                mender.watch(fit.state.frames[t], fit.state.betas, cameras[c], mask);
    // The body is believed where it lies as near to the keypoints as it usually does.
    std::vector<double> fits;
    for (const double metres : fit.frame_fit)
        if (std::isfinite(metres)) fits.push_back(metres);
    const double usual = median(fits);
    const auto believed = [&](std::size_t c, std::size_t t) {
        return fit.frame_fit[t] < 1.5 * usual &&
               std::find(fit.left_out.begin(), fit.left_out.end(), std::pair(c, t)) == fit.left_out.end();
    };
    for (std::size_t c = 0; c < C; ++c) {
        if (masks.images[c].empty()) continue;
        const fs::path from = folder / "masks" / detections.cameras[c].name,
                       kept = folder / "masks_detected" / detections.cameras[c].name;
        std::error_code error;
        if (!fs::exists(kept, error)) {
            fs::create_directories(kept.parent_path());
            fs::rename(from, kept);
            fs::create_directories(from);
        }
        for (std::size_t t = 0; t < T; ++t) {
            PixelImage& mask = masks.images[c][t];
            const bool shows = std::any_of(mask.data.begin(), mask.data.end(), [](std::uint8_t v) { return v >= 128; });
            if (shows && believed(c, t)) { // an empty mask leaves the photograph out
                const PosedBody body_at = pose_body(model, posed.pose_at(t), posed.transl[t], posed.betas);
                const MaskChange change = mender.mend(fit.state.frames[t], fit.state.betas, cameras[c],
                                                      Span<const vec3<double>>(body_at.vertices), mask.data);
                result.cut += change.removed > 0.01, result.filled += change.filled > 0.01;
            }
            write_png(from / (detections.masks[c][t].stem().string() + ".png"), mask); // it may have been a JPEG
            shown.show(static_cast<double>(c * T + t + 1) / static_cast<double>(C * T), "");
        }
    }
    return result;
}

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
                                   const std::vector<std::size_t>& unseen, const FitOptions& options,
                                   const MendedMasks& mended) {
    std::vector<std::string> advice;
    for (std::size_t c = 0; c < detections.cameras.size(); ++c) {
        const std::string name = "camera '" + detections.cameras[c].name + "'";
        const KeypointFit& of = fit.camera_fit[c];
        constexpr double far = 0.04; // metres: twice what detectors miss by
        if (of.count == 0)
            advice.push_back(name + " shows no person");
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
    if (mended.cut > 0)
        advice.push_back("masks held things beside the person in " + std::to_string(mended.cut) +
                         " photographs, which are cut off");
    if (mended.filled > 0)
        advice.push_back("masks lacked parts of the body in " + std::to_string(mended.filled) +
                         " photographs, which are filled in");
    if (detections.cameras.size() == 1 && !fit.held)
        advice.push_back("one camera sees no depth: film one slow turn in one pose for arms and legs in their place");
    if (detections.cameras.size() == 1 && !options.height && !detections.calibrated)
        advice.push_back("the person's size is a guess: give --height");
    return advice;
}

} // namespace

std::vector<std::string> fit_capture(const FitOptions& options, const std::vector<std::filesystem::path>& to) {
    Detections detections = load_detections(options.detections);
    const BodyModel body = body_of_file(options.body);
    const std::size_t C = detections.cameras.size(), T = detections.times.size();
    check_value(!options.focal || (C == 1 && !detections.calibrated), "--focal",
                "is for a single camera without a calibration");
    if (options.focal)
        detections.cameras[0].camera.fx = detections.cameras[0].camera.fy = *options.focal,
        detections.known_focal[0] = true;
    LoadedMasks masks(detections);
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
    std::vector<Camera<double>> seen_by; // with what the fit found
    for (std::size_t c = 0; c < C; ++c) {
        Camera<double>& camera = list.cameras[c].camera;
        camera.fx *= fit.focal, camera.fy *= fit.focal;
        camera.cx += fit.shifts[c].x, camera.cy += fit.shifts[c].y;
        seen_by.push_back(camera);
    }
    const MendedMasks mended = mend_masks(options.detections, detections, masks, body, fit, seen_by);
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
    std::vector<std::string> advice = advice_of(detections, fit, unseen, options, mended);
    for (const auto& path : to) write_motion(path, fit.motion, body, advice);
    return advice;
}

} // namespace gsh::examples
