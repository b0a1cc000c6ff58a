// SPDX-License-Identifier: Apache-2.0
/// @file  Checks whether a capture's images, cameras, poses and body agree, and names the usual mistake if they do not.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/check/capture_aspects.hpp>
#include <gsh/check/capture_findings.hpp>
#include <gsh/check/capture_hands.hpp>
#include <gsh/check/capture_looks.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/check/capture_search.hpp>
#include <gsh/check/capture_views.hpp>
#include <gsh/check/capture_words.hpp>
#include <gsh/check/exposure.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/math/spread.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

struct CaptureCheckParams {
    std::size_t frames = 0; ///< number of frames to check, evenly spaced; 0: all
    /// About so many images have an exposure, at least 3 of each camera. Their equations grow with the square of the
    /// number, the time to solve them with its cube.
    std::size_t exposures = 1500;
    CaptureSearchParams search = {};
};

/// Compares masks with the silhouettes of all posed bodies, with the files as given and under other conventions. A
/// hypothesis is reported if it improves the overlap clearly: by an absolute amount and by a share of the missing
/// overlap. Loose clothes and an estimator's errors are therefore not reported. With several people, hypotheses about
/// poses are also tried person by person. The capture's own motion supplies only the number of frames.
///
/// Errors  ShapeError, ValueError for an invalid capture or body. Motions for another number of joints are reported as
///         findings, and no others then.
template <HostExecutor E>
[[nodiscard]] CaptureCheck check_capture(E& executor, const Capture& capture, const std::vector<CheckedPerson>& people,
                                         const CaptureCheckParams& params = {});
/// The same for one person, whose motion is the capture's.
template <HostExecutor E>
[[nodiscard]] CaptureCheck check_capture(E& executor, const Capture& capture, const BodyModel& body,
                                         const CaptureCheckParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

template <HostExecutor E>
class CaptureChecker {
public:
    CaptureChecker(E& executor, const Capture& capture, const std::vector<CheckedPerson>& people,
                   const CaptureCheckParams& params)
        : capture_(capture), people_(people), params_(params), search_(executor, capture, people, params.search) {}

    CaptureCheck check() {
        look();
        find_bad_masks();
        result_.reading = search_.as_given();
        const auto chosen = search_.choose_views(usable_);
        if (!chosen.empty()) {
            result_.reading = search_.run(chosen);
            name_faults(chosen);
        }
        if (!aspects_of(result_.reading).empty())
            looks_ = search_.looks().look(usable_, result_.reading, params_.search.fine_size);
        find_lost_cameras();
        find_lost_people();
        find_single_images();
        if (aspects_of(result_.reading).empty() && lost_.empty()) measure_photographs();
        return std::move(result_);
    }

private:
    const Capture& capture_;
    const std::vector<CheckedPerson>& people_;
    CaptureCheckParams params_;
    CaptureSearch<E> search_;
    CaptureCheck result_;
    std::vector<CaptureView> usable_;
    std::vector<ViewLook> looks_;   ///< of the usable views: with the files as given, finally with all faults corrected
    std::vector<std::size_t> lost_; ///< cameras for which no reading gives an overlap with the bodies

    /// Evaluates every image with the files as given.
    void look() {
        std::vector<CaptureView> views;
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c)
            for (const std::size_t f : spread_frames(capture_.frame_count(), params_.frames))
                if (capture_.is_taken({c, f})) views.push_back({c, f});
        const auto looks = search_.look(views);
        for (std::size_t i = 0; i < views.size(); ++i) {
            ViewCheck view;
            view.view = views[i];
            if (looks[i].mask_share == 0) view.mask = ViewCheck::Mask::empty;
            if (looks[i].mask_share == 1) view.mask = ViewCheck::Mask::opaque;
            const bool usable = view.mask == ViewCheck::Mask::usable;
            for (const PersonLook& person : looks[i].people) {
                view.inside += person.inside / static_cast<double>(people_.size());
                view.people.push_back({person.inside});
                if (usable && person.area > 0)
                    view.people.back().covered = static_cast<double>(person.covered) / static_cast<double>(person.area);
            }
            view.background_removed = capture_.background_is_removed(views[i]);
            if (usable) {
                view.iou = looks[i].overlap.iou();
                usable_.push_back(view.view);
                looks_.push_back(looks[i]);
            }
            result_.views.push_back(std::move(view));
        }
    }

    /// Names of some people; an empty list if they are all people.
    [[nodiscard]] std::vector<std::string> names(const std::vector<std::size_t>& people) const {
        std::vector<std::string> result;
        if (people.size() < people_.size())
            for (const std::size_t p : people) result.push_back(people_[p].name);
        return result;
    }

    void add(CaptureFinding finding, const std::string& hypothesis, const std::string& remedy, int digits = 2) {
        finding.text = finding_text(capture_, finding, hypothesis, remedy, digits);
        result_.findings.push_back(std::move(finding));
    }

    void find_bad_masks() {
        CaptureFinding empty{.fault = "empty-masks", .measure = "share of images without a mask"};
        CaptureFinding opaque{.fault = "no-masks", .measure = "share of images that are opaque everywhere"};
        for (const ViewCheck& v : result_.views) {
            // Where no body is in view, an empty mask is right.
            const bool in_view = std::any_of(v.people.begin(), v.people.end(),
                                             [](const ViewCheck::Person& person) { return person.inside > 0.1; });
            if (v.mask == ViewCheck::Mask::empty && in_view) empty.views.push_back(v.view);
            if (v.mask == ViewCheck::Mask::opaque && !capture_.background(v.view.camera))
                opaque.views.push_back(v.view);
        }
        for (CaptureFinding* finding : {&empty, &opaque}) {
            if (finding->views.empty()) continue;
            finding->given = static_cast<double>(finding->views.size()) / static_cast<double>(result_.views.size());
            add(*finding, "usual",
                finding == &empty
                    ? "training leaves these images out; segment them again if the person is in them"
                    : "store the person's mask as alpha, 255 on the person and 0 elsewhere, or in masks/");
        }
    }

    /// Reports each aspect of the reading without which the overlap is clearly worse, the others being corrected. An
    /// aspect without such an effect is dropped, and the others are measured again.
    void name_faults(const std::vector<CaptureView>& chosen) {
        std::vector<CaptureFinding> named;
        for (bool dropped = true; dropped;) {
            dropped = false;
            named.clear();
            const std::vector<Aspect> aspects = aspects_of(result_.reading);
            if (aspects.empty()) break;
            const std::vector<double> mended = search_.fine(chosen, result_.reading);
            for (const Aspect& aspect : aspects) {
                CaptureReading without = result_.reading;
                reset(without, aspect);
                const auto [given, now] =
                    search_.looks().means(chosen, search_.fine(chosen, without), mended, aspect.cameras);
                const bool plain = aspect.kind == Aspect::Kind::inverted_mask && inverted_border(aspect.cameras);
                if (!plain && !(now >= params_.search.convincing && search_.is_clear(given, now))) {
                    result_.reading = without;
                    dropped = true;
                    break;
                }
                CaptureFinding finding{
                    .fault = fault_name(aspect, result_.reading), .measure = "IoU", .given = given, .mended = now};
                if (aspect.of_motion())
                    finding.people = names(aspect.people);
                else
                    finding.cameras = aspect.cameras;
                finding.text = finding_text(capture_, finding, hypothesis_text(aspect, result_.reading),
                                            remedy_text(aspect, result_.reading, capture_, people_), 2);
                named.push_back(std::move(finding));
            }
        }
        result_.findings.insert(result_.findings.end(), named.begin(), named.end());
        name_hands(chosen);
    }

    void name_hands(const std::vector<CaptureView>& chosen) {
        const auto overlaps = hand_overlaps(search_.looks(), chosen, result_.reading, params_.search.fine_size);
        for (const bool missing : {true, false}) {
            std::vector<std::size_t> people;
            Overlap before, after;
            for (std::size_t p = 0; p < people_.size(); ++p) {
                const auto& [given, added, taken] = overlaps[p];
                const Overlap& better = missing ? added : taken;
                if (missing != (added.iou() > taken.iou()) || !search_.is_clear(given.iou(), better.iou())) continue;
                people.push_back(p), before += given, after += better;
                result_.reading.motions[p].mean_hands = missing ? 1 : -1;
            }
            if (people.empty()) continue;
            CaptureFinding finding{.fault = missing ? "mean-hand-missing" : "mean-hand-twice",
                                   .people = names(people),
                                   .measure = "IoU around the hands",
                                   .given = before.iou(),
                                   .mended = after.iou()};
            add(finding, missing ? "with the body's mean hand added" : "without the body's mean hand",
                missing ? "the poses count from the mean hand: store flat_hand = 0"
                        : "the poses are whole hands already: store flat_hand = 1");
        }
    }

    [[nodiscard]] bool inverted_border(const std::vector<std::size_t>& cameras) const {
        return std::all_of(cameras.begin(), cameras.end(),
                           [&](std::size_t c) { return search_.border_share(c) > params_.search.inverted_border; });
    }

    /// Finds cameras for which no reading gives an overlap with the bodies.
    void find_lost_cameras() {
        CaptureFinding far{.fault = "camera-far-off", .measure = "share of the body in the image", .mended = 1};
        CaptureFinding apart{.fault = "no-overlap", .measure = "IoU", .mended = params_.search.convincing};
        double far_sum = 0, apart_sum = 0;
        const std::vector<double> overlaps = search_.looks().overlaps(looks_);
        const bool posed_otherwise =
            std::any_of(result_.reading.motions.begin(), result_.reading.motions.end(),
                        [](const MotionReading& motion) { return !(motion == MotionReading{}); });
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c) {
            std::vector<double> inside(people_.size(), 0);
            double seen = 0;
            for (const ViewCheck& v : result_.views) {
                if (v.view.camera != c) continue;
                for (std::size_t p = 0; p < people_.size(); ++p) inside[p] += v.people[p].inside;
                seen += 1;
            }
            const double most = *std::max_element(inside.begin(), inside.end()); // other people may be out of view
            const bool usable =
                std::any_of(usable_.begin(), usable_.end(), [&](const auto& v) { return v.camera == c; });
            const double iou = search_.looks().means(usable_, overlaps, overlaps, {c}).first;
            const bool mended = !(result_.reading.cameras[c] == CameraReading{}) || posed_otherwise;
            if (mended && iou >= params_.search.convincing) continue;
            if (seen > 0 && most < 0.3 * seen)
                far.cameras.push_back(c), far_sum += most / seen;
            else if (usable && iou < params_.search.convincing)
                apart.cameras.push_back(c), apart_sum += iou;
        }
        lost_ = far.cameras;
        lost_.insert(lost_.end(), apart.cameras.begin(), apart.cameras.end());
        if (!far.cameras.empty()) {
            far.given = far_sum / static_cast<double>(far.cameras.size());
            add(far, "usual",
                "no known convention explains it; check R and t (world to camera, metres) and that the poses "
                "belong to these images");
        }
        if (!apart.cameras.empty()) {
            apart.given = apart_sum / static_cast<double>(apart.cameras.size());
            add(apart, "expected at least",
                "no known convention explains it; poses are wrong by 6 cm or more, which gsh-reconstruct --refine may "
                "correct, or poses, cameras, masks and body do not belong together");
        }
    }

    /// Finds people whose bodies the masks omit, in views where bodies and masks otherwise agree.
    void find_lost_people() {
        if (people_.size() == 1) return;
        for (std::size_t p = 0; p < people_.size(); ++p) {
            double area = 0, covered = 0, views = 0;
            for (std::size_t i = 0; i < usable_.size(); ++i) {
                if (!looks_[i].valid || std::count(lost_.begin(), lost_.end(), usable_[i].camera)) continue;
                area += static_cast<double>(looks_[i].people[p].area), views += 1;
                covered += static_cast<double>(looks_[i].people[p].covered);
            }
            const double share = covered / std::max(1.0, area);
            if (views == 0 || result_.reading.motions[p].absent || share >= 0.5) continue;
            CaptureFinding finding{.fault = "absent-person",
                                   .people = names({p}),
                                   .measure = "share of the body in the masks",
                                   .given = share,
                                   .mended = 1};
            add(finding, "usual", absence_remedy);
        }
    }

    /// Finds images far below the others of their camera, where a pose or a mask is wrong.
    void find_single_images() {
        if (usable_.empty()) return;
        CaptureFinding single{.fault = "single-images", .measure = "IoU there"};
        const std::vector<double> iou = search_.looks().overlaps(looks_);
        double sum = 0, reference = 0;
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c) {
            std::vector<double> own;
            for (std::size_t i = 0; i < usable_.size(); ++i)
                if (usable_[i].camera == c && iou[i] >= 0) own.push_back(iou[i]);
            if (own.empty()) continue;
            const double usual = median(std::move(own));
            if (!lost_.empty() && usual < params_.search.convincing) continue;
            for (std::size_t i = 0; i < usable_.size(); ++i)
                if (usable_[i].camera == c && iou[i] >= 0 && iou[i] < params_.search.convincing &&
                    iou[i] < 0.65 * usual)
                    single.views.push_back(usable_[i]), sum += iou[i], reference += usual;
        }
        if (single.views.empty()) return;
        single.given = sum / static_cast<double>(single.views.size());
        single.mended = reference / static_cast<double>(single.views.size());
        add(single, "in the same cameras' other images",
            std::string("the pose or the mask failed there: look at the overlays, then mend these images or ") +
                leave_out_remedy);
    }

    /// Measures holes of masks and exposures, where bodies and masks agree.
    void measure_photographs() {
        CaptureLooks<E>& looks = search_.looks();
        const CaptureReading as_given = search_.as_given();
        std::vector<double> missing(usable_.size(), 0);
        looks.start_from(as_given.motions);
        looks.for_views(usable_, as_given, [&](std::size_t i, const auto& everybody) {
            const int size = params_.search.fine_size;
            const Camera<double> camera = looks.camera(usable_[i].camera, as_given, size);
            const Silhouette body = united(looks.silhouettes(everybody, camera));
            const Silhouette mask = looks.mask(usable_[i], as_given, size);
            Silhouette lacking = body;
            for (std::size_t k = 0; k < body.inside.size(); ++k) lacking.inside[k] = body.inside[k] && !mask.inside[k];
            // Erosion removes the bands that wandering outlines and small errors of poses leave.
            const int band = std::max(1, std::max(camera.height, camera.width) * 3 / 400);
            missing[i] = static_cast<double>(eroded(lacking, band).area()) /
                         static_cast<double>(std::max<std::size_t>(1, body.area()));
        });
        const std::vector<CaptureView> compared = few_views(usable_, capture_.cameras.size(), params_.exposures);
        std::vector<std::size_t> camera_of;
        for (const CaptureView& view : compared) camera_of.push_back(view.camera);
        const auto stops = exposures(seen_colors(looks, compared), camera_of);
        std::size_t next = 0, next_compared = 0;
        for (ViewCheck& v : result_.views) {
            if (v.mask != ViewCheck::Mask::usable) continue;
            v.missing = missing[next++];
            if (next_compared < compared.size() && capture_.index(compared[next_compared]) == capture_.index(v.view))
                v.stops = stops[next_compared++];
        }
    }
};

} // namespace detail

template <HostExecutor E>
CaptureCheck check_capture(E& executor, const Capture& capture, const std::vector<CheckedPerson>& people,
                           const CaptureCheckParams& params) {
    constexpr auto where = "check_capture";
    check_value(!people.empty(), where, "there is no person to check; give at least one");
    for (const CheckedPerson& person : people) validate(*person.body, where);
    check_value(!capture.cameras.empty() && capture.frame_count() > 0, where,
                "the capture has no cameras or no frames");
    CaptureCheck result;
    for (const CheckedPerson& person : people) {
        if (person.motion->joint_count == person.body->joint_count()) continue;
        CaptureFinding finding{.fault = "another-body",
                               .measure = "joints of a pose",
                               .given = static_cast<double>(person.motion->joint_count),
                               .mended = static_cast<double>(person.body->joint_count())};
        if (people.size() > 1) finding.people = {person.name};
        finding.text = detail::finding_text(capture, finding, "the body has",
                                            "give --body the model that the poses were fitted with", 0);
        result.findings.push_back(std::move(finding));
    }
    if (!result.findings.empty()) {
        result.reading = {std::vector<MotionReading>(people.size()),
                          std::vector<CameraReading>(capture.cameras.size())};
        return result;
    }
    for (const CheckedPerson& person : people) {
        validate(*person.motion, *person.body, where);
        check_size(where, "frames of a motion", person.motion->frame_count(), capture.frame_count(),
                   "store a pose of everybody for each of the capture's");
    }
    check_size(where, "images", capture.stored ? capture.stored->facts.size() : capture.images.size(),
               capture.cameras.size() * capture.frame_count(), "store one per camera and frame");
    return detail::CaptureChecker<E>(executor, capture, people, params).check();
}

template <HostExecutor E>
CaptureCheck check_capture(E& executor, const Capture& capture, const BodyModel& body,
                           const CaptureCheckParams& params) {
    return check_capture(executor, capture, {CheckedPerson{"", &body, &capture.motion}}, params);
}

} // namespace gsh
