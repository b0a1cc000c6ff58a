// SPDX-License-Identifier: Apache-2.0
/// @file  Whether a capture's images, cameras, poses and body belong together, and which usual mistake was made if not.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/train/capture_hands.hpp>
#include <gsh/train/capture_reading.hpp>
#include <gsh/train/capture_search.hpp>
#include <gsh/train/capture_words.hpp>
#include <gsh/train/silhouette.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

struct CaptureCheckParams {
    std::size_t frames = 0; ///< how many to look at, evenly spaced; 0: all
    CaptureSearchParams search;
};

/// What one image shows.
struct ViewCheck {
    enum class Mask {
        usable,
        empty,  ///< no pixel is the person
        opaque, ///< all pixels are: there is no mask
    };
    CaptureView view;
    Mask mask = Mask::usable;
    double iou = 0;    ///< of mask and posed body, as given; 0 without a usable mask
    double inside = 0; ///< of the body's vertices, how many project into the image
};

/// Something that is probably wrong.
struct CaptureFinding {
    std::string fault = {};                ///< in a word: "mirrored-images"
    std::vector<std::size_t> cameras = {}; ///< it concerns; empty: the poses, and so all of them
    std::vector<CaptureView> views = {};   ///< single images that it concerns, if it does not concern all
    std::string measure = {};              ///< what `given` and `mended` are: "IoU", "IoU around the hands", …
    double given = 0;                      ///< as the files are, all other findings being mended
    double mended = 0;                     ///< under the hypothesis, or what would be usual
    std::string text = {};                 ///< one line: the fault, both numbers, the remedy
};

struct CaptureCheck {
    std::vector<ViewCheck> views;         ///< all that were looked at, camera by camera
    std::vector<CaptureFinding> findings; ///< none: nothing is suspicious
    CaptureReading reading;               ///< the capture with all findings mended that a reading mends

    /// Mean IoU of the images with a usable mask, as given; 0 if there is none.
    [[nodiscard]] double mean_iou() const {
        double sum = 0, count = 0;
        for (const ViewCheck& v : views)
            if (v.mask == ViewCheck::Mask::usable) sum += v.iou, count += 1;
        return count > 0 ? sum / count : 0;
    }
};

/// Compares masks with the silhouettes of the posed body, as given and as other conventions would have them. A
/// hypothesis is named where it makes the overlap clearly better: by an absolute amount and by a share of what is
/// missing, so that loose clothes and an estimator's errors are no faults.
///
/// Errors  ShapeError, ValueError for a capture or a body that is none. A motion for another number of joints is a
///         finding, and then the only one.
template <CpuBackend B>
[[nodiscard]] CaptureCheck check_capture(B& backend, const Capture& capture, const BodyModel& body,
                                         const CaptureCheckParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// `count` of `total` frames, first and last among them; all if count is 0.
inline std::vector<std::size_t> spread_frames(std::size_t total, std::size_t count) {
    if (count == 0 || count > total) count = total;
    std::vector<std::size_t> frames;
    for (std::size_t i = 0; i < count; ++i)
        frames.push_back(count == 1 ? total / 2 : (i * (total - 1) + (count - 1) / 2) / (count - 1));
    return frames;
}

template <CpuBackend B>
class CaptureChecker {
public:
    CaptureChecker(B& backend, const Capture& capture, const BodyModel& body, const CaptureCheckParams& params)
        : capture_(capture), body_(body), params_(params), search_(backend, capture, body, params.search) {}

    CaptureCheck check() {
        look();
        find_bad_masks();
        result_.reading = search_.as_given();
        const auto chosen = search_.choose_views(usable_);
        if (!chosen.empty()) {
            result_.reading = search_.run(chosen);
            name_faults(chosen);
        }
        find_lost_cameras();
        find_single_images();
        return std::move(result_);
    }

private:
    const Capture& capture_;
    const BodyModel& body_;
    CaptureCheckParams params_;
    CaptureSearch<B> search_;
    CaptureCheck result_;
    std::vector<CaptureView> usable_;

    /// Every image as it is given.
    void look() {
        std::vector<CaptureView> views;
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c)
            for (const std::size_t f : spread_frames(capture_.frame_count(), params_.frames))
                if (capture_.is_taken({c, f})) views.push_back({c, f});
        const auto looks = search_.look(views);
        for (std::size_t i = 0; i < views.size(); ++i) {
            ViewCheck view{views[i], ViewCheck::Mask::usable, looks[i].overlap.iou(), looks[i].inside};
            if (looks[i].mask_share == 0) view.mask = ViewCheck::Mask::empty;
            if (looks[i].mask_share == 1) view.mask = ViewCheck::Mask::opaque;
            if (view.mask == ViewCheck::Mask::usable)
                usable_.push_back(view.view);
            else
                view.iou = 0;
            result_.views.push_back(view);
        }
    }

    void add(CaptureFinding finding, const std::string& hypothesis, const std::string& remedy, int digits = 2) {
        finding.text = finding_text(capture_, finding, hypothesis, remedy, digits);
        result_.findings.push_back(std::move(finding));
    }

    void find_bad_masks() {
        CaptureFinding empty{.fault = "empty-masks", .measure = "share of images without a mask"};
        CaptureFinding opaque{.fault = "no-masks", .measure = "share of images that are opaque everywhere"};
        for (const ViewCheck& v : result_.views) {
            if (v.mask == ViewCheck::Mask::empty) empty.views.push_back(v.view);
            if (v.mask == ViewCheck::Mask::opaque && !capture_.background(v.view.camera))
                opaque.views.push_back(v.view);
        }
        for (CaptureFinding* finding : {&empty, &opaque}) {
            if (finding->views.empty()) continue;
            finding->given = static_cast<double>(finding->views.size()) / static_cast<double>(result_.views.size());
            add(*finding, "usual",
                finding == &empty
                    ? "segment these images anew or leave them out; training would learn that nobody is there"
                    : "store the person's mask as alpha, or in masks/");
        }
    }

    /// What the reading changes, if it proves to be worth it: without it, the rest being mended, the overlap is clearly
    /// worse. What does not is dropped, and the others are measured anew.
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
                if (!aspect.of_motion()) finding.cameras = aspect.cameras;
                finding.text = finding_text(capture_, finding, hypothesis_text(aspect, result_.reading),
                                            remedy_text(aspect, result_.reading, capture_), 2);
                named.push_back(std::move(finding));
            }
        }
        result_.findings.insert(result_.findings.end(), named.begin(), named.end());
        name_hands(chosen);
    }

    void name_hands(const std::vector<CaptureView>& chosen) {
        const auto [given, added, taken] =
            hand_overlaps(search_.looks(), chosen, result_.reading, params_.search.fine_size);
        const bool missing = added.iou() > taken.iou();
        const Overlap& better = missing ? added : taken;
        if (!search_.is_clear(given.iou(), better.iou())) return;
        result_.reading.motion.mean_hands = missing ? 1 : -1;
        CaptureFinding finding{.fault = missing ? "mean-hand-missing" : "mean-hand-twice",
                               .measure = "IoU around the hands",
                               .given = given.iou(),
                               .mended = better.iou()};
        add(finding, missing ? "with the body's mean hand added" : "without the body's mean hand",
            missing ? "the poses count from the mean hand: store flat_hand = 0"
                    : "the poses are whole hands already: store flat_hand = 1");
    }

    [[nodiscard]] bool inverted_border(const std::vector<std::size_t>& cameras) const {
        return std::all_of(cameras.begin(), cameras.end(),
                           [&](std::size_t c) { return search_.border_share(c) > params_.search.inverted_border; });
    }

    /// IoU of each view with all faults mended, -1 where it has no pose then.
    [[nodiscard]] std::vector<double> overlaps(const std::vector<CaptureView>& views) {
        if (!aspects_of(result_.reading).empty()) return search_.fine(views, result_.reading);
        std::vector<double> result;
        auto v = result_.views.begin(); // which are in the same order
        for (const CaptureView& wanted : views) {
            while (v->view.camera != wanted.camera || v->view.frame != wanted.frame) ++v;
            result.push_back(v->iou);
        }
        return result;
    }

    /// Cameras that no reading brings to the body.
    void find_lost_cameras() {
        CaptureFinding far{.fault = "camera-far-off", .measure = "share of the body in the image", .mended = 1};
        CaptureFinding apart{.fault = "no-overlap", .measure = "IoU", .mended = params_.search.convincing};
        double far_sum = 0, apart_sum = 0;
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c) {
            double inside = 0, seen = 0;
            std::vector<CaptureView> usable;
            for (const ViewCheck& v : result_.views) {
                if (v.view.camera != c) continue;
                inside += v.inside, seen += 1;
                if (v.mask == ViewCheck::Mask::usable) usable.push_back(v.view);
            }
            const bool mended =
                !(result_.reading.cameras[c] == CameraReading{}) || !(result_.reading.motion == MotionReading{});
            const std::vector<double> own = overlaps(usable);
            const double iou = search_.looks().means(usable, own, own, {c}).first;
            if (mended && iou >= params_.search.convincing) continue;
            if (seen > 0 && inside < 0.3 * seen)
                far.cameras.push_back(c), far_sum += inside / seen;
            else if (!usable.empty() && iou < params_.search.convincing)
                apart.cameras.push_back(c), apart_sum += iou;
        }
        if (!far.cameras.empty()) {
            far.given = far_sum / static_cast<double>(far.cameras.size());
            add(far, "usual",
                "no reading that we know brings it back; check R and t (world to camera, metres) and that the poses "
                "belong to these images");
        }
        if (!apart.cameras.empty()) {
            apart.given = apart_sum / static_cast<double>(apart.cameras.size());
            add(apart, "expected at least",
                "no reading that we know explains it; poses, cameras, masks and body probably do not belong together");
        }
    }

    /// Images far below the others of their camera: a pose or a mask that failed there.
    void find_single_images() {
        if (usable_.empty()) return;
        CaptureFinding single{.fault = "single-images", .measure = "IoU there"};
        const std::vector<double> iou = overlaps(usable_);
        const bool some_lost = std::any_of(result_.findings.begin(), result_.findings.end(), [](const auto& f) {
            return f.fault == "no-overlap" || f.fault == "camera-far-off";
        });
        double sum = 0, reference = 0;
        for (std::size_t c = 0; c < capture_.cameras.size(); ++c) {
            std::vector<double> own;
            for (std::size_t i = 0; i < usable_.size(); ++i)
                if (usable_[i].camera == c && iou[i] >= 0) own.push_back(iou[i]);
            if (own.empty()) continue;
            std::nth_element(own.begin(), own.begin() + static_cast<std::ptrdiff_t>(own.size() / 2), own.end());
            const double median = own[own.size() / 2];
            if (some_lost && median < params_.search.convincing) continue;
            for (std::size_t i = 0; i < usable_.size(); ++i)
                if (usable_[i].camera == c && iou[i] >= 0 && iou[i] < params_.search.convincing &&
                    iou[i] < 0.65 * median)
                    single.views.push_back(usable_[i]), sum += iou[i], reference += median;
        }
        if (single.views.empty()) return;
        single.given = sum / static_cast<double>(single.views.size());
        single.mended = reference / static_cast<double>(single.views.size());
        add(single, "in the same cameras' other images",
            "the pose or the mask failed there: look at the overlays, then mend these images or leave them out");
    }
};

} // namespace detail

template <CpuBackend B>
CaptureCheck check_capture(B& backend, const Capture& capture, const BodyModel& body,
                           const CaptureCheckParams& params) {
    constexpr auto where = "check_capture";
    validate(body, where);
    check_value(!capture.cameras.empty() && capture.frame_count() > 0, where,
                "the capture has no cameras or no frames");
    if (capture.motion.joint_count != body.joint_count()) {
        CaptureCheck result;
        result.reading.cameras.resize(capture.cameras.size());
        CaptureFinding finding{.fault = "another-body",
                               .measure = "joints of a pose",
                               .given = static_cast<double>(capture.motion.joint_count),
                               .mended = static_cast<double>(body.joint_count())};
        finding.text = detail::finding_text(capture, finding, "the body has",
                                            "give --body the model that the poses were fitted with", 0);
        result.findings.push_back(std::move(finding));
        return result;
    }
    validate(capture.motion, body, where);
    check_size(where, "images", capture.images.size(), capture.cameras.size() * capture.frame_count(),
               "store one per camera and frame");
    return detail::CaptureChecker<B>(backend, capture, body, params).check();
}

} // namespace gsh
