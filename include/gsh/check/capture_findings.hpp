// SPDX-License-Identifier: Apache-2.0
/// @file  The result of a capture's check: figures of its images, and probable mistakes as text.
#pragma once

#include <gsh/check/capture_reading.hpp>
#include <gsh/check/capture_words.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
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
    std::vector<Person> people; ///< in the order in which they were given
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

/// What follows for training from a low overlap that no mistake explains; empty if the overlap is as usual. Exact poses
/// of a person in loose clothes give 0.86, with errors of a centimetre 0.82; errors of 4 cm give 0.7.
[[nodiscard]] inline std::string advice_on_poses(const CaptureCheck& check) {
    const std::optional<double> iou = check.mean_iou();
    if (!iou || *iou >= 0.79 || !check.findings.empty()) return {};
    return "poses look rough: mask and posed body overlap by " + detail::digits(*iou, 2) +
           ", 0.86 is usual in loose clothes; gsh-reconstruct --refine fits poses and shape before training";
}

namespace detail {

/// "a, b and 4 more".
template <class Name>
std::string listing(std::size_t count, std::size_t most, const Name& name) {
    std::string text;
    for (std::size_t i = 0; i < std::min(most, count); ++i) text += (i ? ", " : "") + name(i);
    return text + (count > most ? " and " + std::to_string(count - most) + " more" : "");
}

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
} // namespace gsh
