// SPDX-License-Identifier: Apache-2.0
#include "video/fitting.hpp"

#include "common/figures.hpp"
#include "common/input_files.hpp"
#include "common/motion_output.hpp"
#include "common/progress.hpp"
#include "common/staged_file.hpp"
#include "common/staged_results.hpp"
#include "video/filmed_people.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/absent_people.hpp>
#include <gsh/fit/body_height.hpp>
#include <gsh/fit/fit_people.hpp>
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
#include <iterator>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::programs {

namespace {

namespace fs = std::filesystem;

/// The masks of a detector's folder, which the fit looks into.
struct LoadedMasks {
    std::vector<std::vector<PixelImage>> images; // [cameras] of [T] or none; without pixels where there is no mask

    explicit LoadedMasks(const Detections& detections) {
        Progress shown("reading masks");
        double done = 0, count = 0;
        for (const auto& files : detections.masks) count += static_cast<double>(files.size());
        for (std::size_t c = 0; c < detections.masks.size(); ++c) {
            auto& of_camera = images.emplace_back();
            for (std::size_t t = 0; t < detections.masks[c].size(); ++t) {
                of_camera.push_back(detections.has_mask(c, t) ? load_detected_mask(detections, c, t) : PixelImage());
                shown.show(++done / count, "");
            }
        }
    }
    [[nodiscard]] MaskView at(std::size_t camera, std::size_t frame) const {
        if (images[camera].empty() || images[camera][frame].data.empty()) return {};
        const PixelImage& mask = images[camera][frame];
        return {mask.height, mask.width, mask.data.data(), 1};
    }
};

/// Masks that the fitted body mended.
struct MendedMasks {
    std::size_t cut = 0, hidden = 0; ///< photographs in which it is more than 1% of the body's area
};

/// A person, and the motion that was found.
struct Fitted {
    const FilmedPerson* person = nullptr;
    const MotionFit* fit = nullptr;
    std::vector<bool> absent; // [T] out of view
};

/// The body of one person, as it mends masks.
class MendingBody {
public:
    MendingBody(const BodyModel& model, const Fitted& person)
        : model_(&model), person_(&person), body_(model, static_cast<int>(person.fit->state.betas.size())),
          samples_(model, body_), mender_(model, body_, samples_) {
        std::vector<double> fits;
        for (const double metres : person.fit->frame_fit)
            if (std::isfinite(metres)) fits.push_back(metres);
        usual_ = median(fits);
    }
    [[nodiscard]] bool seen(std::size_t frame) const { return person_->person->seen[frame]; }
    [[nodiscard]] bool absent(std::size_t frame) const { return person_->absent[frame]; }
    /// The body is believed where it lies as near to the keypoints as it usually does.
    [[nodiscard]] bool believed(std::size_t camera, std::size_t frame) const {
        const MotionFit& fit = *person_->fit;
        return fit.frame_fit[frame] < 1.5 * usual_ &&
               std::find(fit.left_out.begin(), fit.left_out.end(), std::pair(camera, frame)) == fit.left_out.end();
    }
    void watch(std::size_t frame, const Camera<double>& camera, const MaskView& mask) {
        mender_.watch(person_->fit->state.frames[frame], person_->fit->state.betas, camera, mask);
    }
    [[nodiscard]] MaskClaim claim(std::size_t frame, const Camera<double>& camera) {
        const MotionFit& fit = *person_->fit;
        const PosedBody posed =
            pose_body(*model_, fit.motion.pose_at(frame), fit.motion.transl[frame], fit.motion.betas);
        return mender_.claim(fit.state.frames[frame], fit.state.betas, camera,
                             Span<const vec3<double>>(posed.vertices));
    }

private:
    const BodyModel* model_;
    const Fitted* person_;
    FittedBody body_;
    OutlineSamples samples_;
    MaskMender mender_; // sees the body and the samples
    double usual_ = 0;  // metres
};

/// Pictures of a camera, which take the place of those of a fit before this one; where there are none, these go.
class CameraPictures {
public:
    CameraPictures(StagedResults& out, std::string folder) : out_(&out), name_(std::move(folder)) {}

    void add(const std::string& file, const PixelImage& picture) {
        if (folder_.empty()) folder_ = out_->whole_folder(name_);
        write_png(folder_ / file, picture);
    }
    void finish() {
        if (folder_.empty()) out_->remove(name_);
    }

private:
    StagedResults* out_;
    std::string name_;
    fs::path folder_; // once there is a picture
};

/// Writes the mended masks to masks/, what is hidden to hidden/, and where the bodies are to bodies/ (image_of_claims).
/// The detector's masks in `folder` go to masks_detected/, from which the next fit reads them.
MendedMasks mend_masks(const fs::path& folder, StagedResults& out, const Detections& detections, LoadedMasks& masks,
                       const BodyModel& model, const std::vector<Fitted>& people,
                       const std::vector<Camera<double>>& cameras) {
    MendedMasks result;
    const std::size_t C = cameras.size(), T = detections.times.size();
    std::vector<std::unique_ptr<MendingBody>> bodies;
    for (const Fitted& person : people) bodies.push_back(std::make_unique<MendingBody>(model, person));
    Progress shown("mending masks");
    for (const auto& body : bodies)
        for (std::size_t c = 0; c < C; ++c)
            for (std::size_t t = 0; t < T; ++t)
                if (const MaskView mask = masks.at(c, t); mask && body->seen(t)) body->watch(t, cameras[c], mask);
    for (std::size_t c = 0; c < C; ++c) {
        if (masks.images[c].empty()) continue;
        const std::string& camera = detections.cameras[c].name;
        std::error_code error;
        if (fs::exists(folder / "masks" / camera, error) && !fs::exists(folder / "masks_detected" / camera, error))
            out.rename("masks/" + camera, "masks_detected/" + camera);
        const fs::path mended = out.whole_folder("masks/" + camera);
        CameraPictures hiding(out, "hidden/" + camera), shown_bodies(out, "bodies/" + camera);
        for (std::size_t t = 0; t < T; ++t) {
            if (!detections.has_mask(c, t)) continue;
            const std::string name = detections.masks[c][t].stem().string() + ".png"; // it may have been a JPEG
            PixelImage& mask = masks.images[c][t];
            const bool shows = std::any_of(mask.data.begin(), mask.data.end(), [](std::uint8_t v) { return v >= 128; });
            const auto believed = [&](const auto& body) { return body->believed(c, t); };
            // An empty mask leaves the photograph out.
            if (shows && std::any_of(bodies.begin(), bodies.end(), believed)) {
                std::vector<MaskClaim> claims;
                bool cut = true; // a person who is seen, but whose body is not believed, may be anywhere
                for (const auto& body : bodies) {
                    if (body->absent(t)) continue;
                    claims.push_back(body->claim(t, cameras[c]));
                    claims.back().believed = believed(body);
                    cut = cut && (believed(body) || !body->seen(t));
                }
                if (std::all_of(claims.begin(), claims.end(), [](const MaskClaim& claim) { return claim.believed; })) {
                    PixelImage silhouettes(1, mask.height, mask.width);
                    silhouettes.data = image_of_claims(claims);
                    shown_bodies.add(name, silhouettes);
                }
                PixelImage hidden(1, mask.height, mask.width);
                const MaskChange change = mend_mask(claims, mask.data, hidden.data, cut);
                result.cut += change.removed > 0.01, result.hidden += change.hidden > 0.01;
                if (change.hidden > 0) hiding.add(name, hidden);
            }
            write_png(mended / name, mask);
            shown.show(static_cast<double>(c * T + t + 1) / static_cast<double>(C * T), "");
        }
        hiding.finish(), shown_bodies.finish();
    }
    return result;
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

/// The frames of a list of cameras and frames, each once.
std::vector<std::size_t> frames_of(const std::vector<std::pair<std::size_t, std::size_t>>& places) {
    std::vector<std::size_t> frames;
    for (const auto& place : places) frames.push_back(place.second);
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    return frames;
}

/// What the user should know of one person, worst first.
std::vector<std::string> advice_of_person(const Detections& detections, const MotionFit& fit,
                                          const std::vector<std::size_t>& unseen,
                                          const std::vector<std::size_t>& absent) {
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
    }
    std::vector<std::size_t> missed;
    std::set_difference(unseen.begin(), unseen.end(), absent.begin(), absent.end(), std::back_inserter(missed));
    if (!missed.empty())
        advice.push_back("nobody was found in frames " + frames_text(missed) +
                         "; their poses lie between those of the frames beside them");
    if (!absent.empty())
        advice.push_back("out of view in frames " + frames_text(absent) + ": the body stands 100 m away there");
    if (!fit.left_out.empty())
        advice.push_back("the detector was wrong about the whole person in frames " +
                         frames_text(frames_of(fit.left_out)) + ", and is not believed there");
    if (!fit.swapped.empty())
        advice.push_back("left and right were swapped in " + std::to_string(fit.swapped.size()) +
                         " photographs, and are swapped back");
    return advice;
}

/// What the user should know of the capture; cameras are those of any of the people.
std::vector<std::string> advice_of_capture(const Detections& detections, const CameraFindings& cameras, bool held,
                                           const FitOptions& options, const MendedMasks& mended) {
    std::vector<std::string> advice;
    for (std::size_t c = 0; c < detections.cameras.size(); ++c) {
        const std::string name = "camera '" + detections.cameras[c].name + "'";
        constexpr double worth = 2; // pixels: less is usual
        if (std::hypot(cameras.shifts[c].x, cameras.shifts[c].y) > worth)
            advice.push_back(name + " points beside its calibration: its principal point was moved by (" +
                             fixed(cameras.shifts[c].x, 1) + ", " + fixed(cameras.shifts[c].y, 1) + ") pixels");
        if (cameras.time_offsets[c] != 0)
            advice.push_back(name + " took its images " + fixed(1e3 * std::abs(cameras.time_offsets[c]), 0) + " ms " +
                             (cameras.time_offsets[c] > 0 ? "later" : "earlier") +
                             " than the others: detect again with --late " + detections.cameras[c].name + "=" +
                             fixed(cameras.time_offsets[c], 3));
    }
    if (mended.cut > 0)
        advice.push_back("masks held things beside the person in " + std::to_string(mended.cut) +
                         " photographs, which are cut off");
    if (mended.hidden > 0)
        advice.push_back("masks lack parts of the body in " + std::to_string(mended.hidden) +
                         " photographs; these pixels are left out (hidden/)");
    if (detections.cameras.size() == 1 && !held)
        advice.push_back("one camera sees no depth: film one slow turn in one pose for arms and legs in their place");
    if (detections.cameras.size() == 1 && options.heights.empty() && !detections.calibrated)
        advice.push_back("the person's size is a guess: give --height");
    return advice;
}

/// PATH, or PATH with a person's name before its ending.
fs::path path_of_person(fs::path path, const std::string& name) {
    if (!name.empty()) path.replace_filename(path.stem().string() + "_" + name + path.extension().string());
    return path;
}

} // namespace

std::vector<std::string> FittedCapture::poses_option() const {
    if (poses == std::vector<std::string>{"poses.npz"}) return {};
    std::string names;
    for (const std::string& name : poses) names += (names.empty() ? "" : ",") + name;
    return {"--poses", names};
}

FittedCapture fit_capture(const FitOptions& options, const std::vector<std::filesystem::path>& to) {
    const WantedPeople wanted(options.people);
    StagedResults out(options.detections);
    Detections detections = load_detections(options.detections);
    const BodyModel body = body_of_file(options.body);
    const std::size_t C = detections.cameras.size(), T = detections.times.size();
    check_value(!options.focal || (C == 1 && !detections.calibrated), "--focal",
                "is for a single camera without a calibration");
    if (options.focal)
        detections.cameras[0].camera.fx = detections.cameras[0].camera.fy = *options.focal,
        detections.known_focal[0] = true;
    FilmedPeople filmed = people_of(detections, wanted, options.detections.string());
    const std::size_t P = filmed.people.size();
    check_value(options.heights.empty() || options.heights.size() == P, "--height",
                "has " + std::to_string(options.heights.size()) + " heights for " + std::to_string(P) +
                    (P == 1 ? " person" : " people"));

    std::list<StagedFile> motions_to; // of each person; before the fit, which takes minutes
    for (const FilmedPerson& person : filmed.people)
        for (const auto& path : to) motions_to.emplace_back(path_of_person(path, P == 1 ? "" : person.name));

    LoadedMasks masks(detections);
    for (FilmedPerson& person : filmed.people)
        for (PersonPhoto& photo : person.photos) photo.mask = masks.at(photo.camera, photo.frame);

    std::vector<Camera<double>> cameras;
    for (const NamedCamera& camera : detections.cameras) cameras.push_back(camera.camera);
    std::vector<PersonToFit> to_fit;
    for (std::size_t p = 0; p < P; ++p)
        to_fit.push_back(
            {filmed.people[p].photos, options.heights.empty() ? std::nullopt : std::optional(options.heights[p])});
    std::vector<MotionFit> fits;
    {
        Progress shown(P == 1 ? "fitting the body" : "fitting the bodies");
        constexpr int most_betas = 30;
        fits = fit_people(body, cameras, to_fit, detections.times,
                          {.turn = options.turn == "auto" ? std::nullopt : std::optional(options.turn == "yes"),
                           .learn_focal = C == 1 && !detections.known_focal[0],
                           .betas = options.betas > 0 ? options.betas : std::min(most_betas, body.shape_count),
                           .progress = [&](double share) { shown.show(share, ""); }});
    }
    const CameraFindings& found = fits[0]; // the same for all
    std::vector<Fitted> people;
    std::vector<std::vector<std::size_t>> absent;
    for (std::size_t p = 0; p < P; ++p) {
        const std::vector<bool>& seen = filmed.people[p].seen;
        // A single person is in view all the time: photographs that do not show it have empty masks.
        absent.push_back(P > 1 ? absent_frames(seen, detections.times) : std::vector<std::size_t>());
        people.push_back({&filmed.people[p], &fits[p], std::vector<bool>(T, false)});
        for (const std::size_t t : absent[p]) people[p].absent[t] = true;
    }

    CameraList list;
    list.cameras = detections.cameras;
    std::vector<Camera<double>> seen_by; // with what the fit found
    for (std::size_t c = 0; c < C; ++c) {
        Camera<double>& camera = list.cameras[c].camera;
        camera.fx *= found.focal, camera.fy *= found.focal;
        camera.cx += found.shifts[c].x, camera.cy += found.shifts[c].y;
        seen_by.push_back(camera);
    }
    const MendedMasks mended = mend_masks(options.detections, out, detections, masks, body, people, seen_by);
    if (!detections.calibrated) { // the world is the camera's: make it one to stand in
        std::vector<Motion> motions;
        for (const MotionFit& fit : fits) motions.push_back(fit.motion);
        const Affine<double> standing = standing_world(body, motions);
        for (MotionFit& fit : fits)
            for (std::size_t t = 0; t < T; ++t) move_frame(body, fit.motion, t, standing);
        for (NamedCamera& camera : list.cameras) camera.camera = moved_camera(camera.camera, standing);
        list.floor_y = 0;
    }
    std::vector<Camera<double>> placed;
    for (const NamedCamera& camera : list.cameras) placed.push_back(camera.camera);
    const vec3<double> away = place_out_of_view(placed);
    for (std::size_t p = 0; p < P; ++p)
        for (const std::size_t t : absent[p]) fits[p].motion.transl[t] = away;
    if (T > 1) list.fps = static_cast<double>(T - 1) / (detections.times.back() - detections.times.front());
    for (std::size_t t = options.test_every / 2; options.test_every > 0 && t < T; t += options.test_every)
        list.test_frames.push_back(static_cast<int>(t));
    write_cameras(out.file("cameras.json"), list);

    FittedCapture result;
    result.masks_by_body = detections.masks_by_body;
    result.free_before_one_camera =
        C == 1 && std::any_of(fits.begin(), fits.end(), [](const MotionFit& fit) { return !fit.held; });
    Json reports = Json::array();
    const bool held = std::any_of(fits.begin(), fits.end(), [](const MotionFit& fit) { return fit.held; });
    if (!wanted.chosen() && filmed.in_view > 1)
        result.notes.push_back(std::to_string(filmed.in_view) +
                               " people are in view, and the one who is seen longest " +
                               "and largest was fitted: --people " + std::to_string(filmed.in_view) + " fits all");
    std::vector<std::string> of_formats;
    auto motion_to = motions_to.begin();
    for (std::size_t p = 0; p < P; ++p) {
        const FilmedPerson& person = filmed.people[p];
        const std::string prefix = P == 1 ? "" : person.name + ": ";
        std::vector<std::size_t> unseen;
        for (std::size_t t = 0; t < T; ++t)
            if (!person.seen[t]) unseen.push_back(t);
        for (const std::string& note : advice_of_person(detections, fits[p], unseen, absent[p]))
            result.notes.push_back(prefix + note);
        const double height = BodyHeight(body, body.shape_count).of(fits[p].motion.betas);
        save_motion(out.file(person.poses()), fits[p].motion);
        result.poses.push_back(person.poses());
        Json report = report_of(detections, fits[p], height, unseen);
        if (P > 1) {
            report["frames_out_of_view"] = absent[p];
            report = Json{{"name", person.name}, {"poses", person.poses()}, {"fit", report}};
        }
        reports.push_back(report);
        for (std::size_t i = 0; i < to.size(); ++i, ++motion_to) {
            std::vector<std::string> said;
            write_motion(motion_to->file(), fits[p].motion, body, said);
            for (const std::string& note : said) of_formats.push_back(motion_to->named(note));
        }
    }
    for (const std::string& note : advice_of_capture(detections, found, held, options, mended))
        result.notes.push_back(note);
    result.notes.insert(result.notes.end(), of_formats.begin(), of_formats.end());
    write_file(out.file("fit.json"), (P == 1 ? reports[0] : Json{{"people", reports}}).dump(1) + "\n");
    for (const StagedFile& file : motions_to)
        if (auto move = file.move()) out.move(std::move(*move));
    out.commit();
    return result;
}

} // namespace gsh::programs
