// SPDX-License-Identifier: Apache-2.0
/// @file  The result of a capture's check: figures of its images, and probable mistakes as text.
#pragma once

#include <gsh/check/capture_reading.hpp>
#include <gsh/check/capture_words.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The result for one image.
struct ViewCheck {
    enum class Mask {
        usable,
        empty,  ///< no pixel shows the person
        opaque, ///< all pixels do: there is no mask
    };
    struct Person {
        double inside = 0;                  ///< fraction of the body's vertices that project into the image
        std::optional<double> covered = {}; ///< fraction of the body's pixels that the mask covers; if there are both
    };
    CaptureView view;
    Mask mask = Mask::usable;
    double iou = 0;             ///< of mask and posed bodies, with the files as given; 0 without a usable mask
    double inside = 0;          ///< mean over people
    /// Area of the bodies that the mask lacks, without narrow bands, as a fraction of the bodies' area. No value if the
    /// mask is not usable, or if mistakes were found in how the files are read; likewise for the exposure.
    std::optional<double> missing = {};
    /// Exposure of red, green and blue in stops, 0 in the mean of a camera. No value if no colour could be compared,
    /// and for the rest of more images than CaptureCheckParams::exposures.
    std::optional<vec3<double>> stops = {};
    bool background_removed = false; ///< whether the image is black, or white, wherever alpha is 0
    std::vector<Person> people = {}; ///< in the order in which they were given
};

/// A probable mistake in the capture.
struct CaptureFinding {
    std::string fault = {};                ///< its name: "mirrored-images"
    std::vector<std::size_t> cameras = {}; ///< the cameras concerned; empty: the poses are wrong, so all cameras
    std::vector<std::string> people = {};  ///< the people whose poses are concerned; empty: everybody's, or no poses
    std::vector<CaptureView> views = {};   ///< the images concerned, if the finding is about single images
    std::string measure = {};              ///< the quantity in `given` and `mended`: "IoU", "IoU around the hands", …
    double given = 0;                      ///< with the files as given, all other findings being corrected
    double mended = 0;                     ///< under the hypothesis, or the usual value
    std::string text = {};                 ///< one line: the fault, both numbers, the remedy
};

/// What follows for filming and training from a figure that no mistake explains.
struct CaptureAdvice {
    std::string doubt = {}; ///< its name: "rough-poses"
    std::string text = {};  ///< one line
};

struct CaptureCheck {
    std::vector<ViewCheck> views;         ///< all images that were checked, camera by camera
    std::vector<CaptureFinding> findings; ///< empty if nothing is suspicious
    CaptureReading reading;               ///< the capture with all findings corrected that a reading can correct

    /// Mean IoU of the images with a usable mask, with the files as given; no value if there is none.
    [[nodiscard]] std::optional<double> mean_iou() const {
        double sum = 0, count = 0;
        for (const ViewCheck& v : views)
            if (v.mask == ViewCheck::Mask::usable) sum += v.iou, count += 1;
        return count > 0 ? std::optional(sum / count) : std::nullopt;
    }
};

namespace detail {

/// The images, cameras or poses that a finding concerns.
inline std::string place_text(const Capture& capture, const CaptureFinding& finding) {
    const auto camera = [&](std::size_t c) { return capture.cameras[c].name; };
    if (!finding.views.empty())
        return listing(finding.views.size(), 6, [&](std::size_t i) {
            return camera(finding.views[i].camera) + "/" + std::to_string(finding.views[i].frame);
        });
    if (finding.cameras.size() > 1 && finding.cameras.size() == capture.cameras.size()) return "all cameras";
    if (!finding.cameras.empty())
        return listing(finding.cameras.size(), 4, [&](std::size_t i) { return camera(finding.cameras[i]); });
    const auto& people = finding.people;
    return people.empty() ? "poses" : "poses of " + listing(people.size(), 4, [&](std::size_t i) { return people[i]; });
}

/// "fault (where): measure 0.12 as given, 0.99 hypothesis; remedy".
inline std::string finding_text(const Capture& capture, const CaptureFinding& finding, const std::string& hypothesis,
                                const std::string& remedy, int decimals) {
    return finding.fault + " (" + place_text(capture, finding) + "): " + finding.measure + " " +
           digits(finding.given, decimals) + " as given, " + digits(finding.mended, decimals) + " " + hypothesis +
           "; " + remedy;
}

} // namespace detail

/// Mean overlap of each frame that was checked and has a usable mask, over all cameras.
[[nodiscard]] inline std::map<std::size_t, double> frame_overlaps(const CaptureCheck& check) {
    std::map<std::size_t, std::pair<double, double>> sums;
    for (const ViewCheck& v : check.views)
        if (v.mask == ViewCheck::Mask::usable) sums[v.view.frame].first += v.iou, sums[v.view.frame].second += 1;
    std::map<std::size_t, double> means;
    for (const auto& [frame, sum] : sums) means[frame] = sum.first / sum.second;
    return means;
}

/// Range over images: of the exposure, in stops, and of the white balance, as factors.
struct ExposureDrift {
    double darkest = 0, brightest = 0, white = 0;
};
[[nodiscard]] inline ExposureDrift exposure_drift(const CaptureCheck& check) {
    ExposureDrift drift;
    for (const ViewCheck& v : check.views) {
        if (!v.stops) continue;
        drift.darkest = std::min(drift.darkest, v.stops->y), drift.brightest = std::max(drift.brightest, v.stops->y);
        for (const double channel : {v.stops->x, v.stops->z})
            drift.white = std::max(drift.white, std::abs(std::exp2(channel - v.stops->y) - 1));
    }
    return drift;
}

/// What follows for filming and training from figures that no mistake explains.
///
/// Poses   Exact poses of a person in loose clothes overlap by 0.86, with errors of a centimetre by 0.82, of 4 cm by
///         0.7. A frame stands out if it lies far below the median of the frames.
/// Light   Under lamps that do not change, photographs seem to differ by up to 0.36 stops in range, and by 4% in white
///         balance: a person who turns or bends shows other sides to lamps and shadows.
/// Masks   A blob of a tenth of the person's height takes 1% to 5% of the body.
[[nodiscard]] inline std::vector<CaptureAdvice> advice(const Capture& capture, const CaptureCheck& check) {
    std::vector<CaptureAdvice> all;
    const auto add = [&](const char* doubt, const std::string& text) { all.push_back({doubt, text}); };
    const std::optional<double> iou = check.mean_iou();
    if (!iou) return all;
    const bool plain = check.findings.empty();
    if (plain && *iou < 0.79)
        add("rough-poses", "poses look rough: mask and posed body overlap by " + detail::digits(*iou, 2) +
                               ", 0.86 is usual in loose clothes; gsh-reconstruct --refine fits poses and shape "
                               "before training");
    const std::map<std::size_t, double> frames = frame_overlaps(check);
    std::vector<double> overlaps;
    for (const auto& [frame, mean] : frames) overlaps.push_back(mean);
    const Spread usual = robust_spread(overlaps);
    std::vector<std::pair<std::size_t, double>> low;
    for (const auto& [frame, mean] : frames)
        if (mean < usual.median - std::max(0.05, 4 * usual.deviation)) low.emplace_back(frame, mean);
    if (plain && frames.size() >= 5 && !low.empty())
        add("odd-frames", "frames " + detail::listing(low.size(), 6, [&](std::size_t i) {
                              return std::to_string(low[i].first) + " (" + detail::digits(low[i].second, 2) + ")";
                          }) + ": mask and posed body overlap less than in the others (" +
                              detail::digits(usual.median, 2) + "), so a pose or a mask is wrong there; "
                              "gsh-reconstruct --refine corrects poses, and gives frames that stay wrong less weight");
    if (const ExposureDrift drift = exposure_drift(check); drift.brightest - drift.darkest > 0.4 || drift.white > 0.045)
        add("exposure-drift", "exposure drifts from " + detail::digits(drift.darkest, 2) + " to " +
                                  detail::digits(drift.brightest, 2) + " stops, white balance by up to " +
                                  detail::digits(100 * drift.white, 0) +
                                  "%: gsh-reconstruct learns both for each photograph by default (gain.rate); lock "
                                  "them when you film again");
    std::vector<ViewCheck> torn;
    bool removed = false;
    for (const ViewCheck& v : check.views)
        if (v.missing && *v.missing > 0.003) torn.push_back(v), removed = removed || v.background_removed;
    if (plain && *iou >= 0.79 && !torn.empty())
        add("torn-masks", "masks lack a part of the person in " +
                              detail::listing(torn.size(), 6, [&](std::size_t i) {
                                  const auto& [view, missing] = std::pair(torn[i].view, *torn[i].missing);
                                  return capture.cameras[view.camera].name + "/" + std::to_string(view.frame) + " (" +
                                         detail::digits(100 * missing, 1) + "% of the body)";
                              }) +
                              (removed ? ": mend them, and keep the photograph's own colours where alpha is 0, so "
                                         "that training need not believe the masks' outlines"
                                       : std::string(": mend these masks, or ") + detail::leave_out_remedy));
    return all;
}

} // namespace gsh
