// SPDX-License-Identifier: Apache-2.0
/// @file  Evaluation of a scene on photographs that training did not use.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/photo/photo.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Figures of one of several people: of all pixels that show the person, and of regions among them.
struct PersonScore {
    RegionScore whole;
    std::vector<RegionScore> regions = {};
};

/// Figures of one image, not quantised, over the training background.
struct ImageScore {
    std::string name;
    double psnr = 0;        ///< decibels over the full image, range 1
    double ssim = 0;        ///< see loss/metrics.hpp
    double psnr_person = 0; ///< decibels over the pixels whose true alpha exceeds 1/2
    std::vector<RegionScore> regions = {}; ///< face, hands, …
    std::optional<double> lpips = {};
    std::vector<PersonScore> people = {}; ///< of each person, if there are several
};

/// Means over images, for tables. NaN if there are no images.
[[nodiscard]] inline ImageScore mean_score(const std::vector<ImageScore>& scores) {
    ImageScore mean{.name = "mean"};
    double lpips = 0;
    bool measured = !scores.empty(); // whether all images have LPIPS
    for (const ImageScore& score : scores) {
        mean.psnr += score.psnr, mean.ssim += score.ssim, mean.psnr_person += score.psnr_person;
        measured = measured && score.lpips;
        lpips += score.lpips.value_or(0);
    }
    for (double* sum : {&mean.psnr, &mean.ssim, &mean.psnr_person}) *sum /= static_cast<double>(scores.size());
    if (measured) mean.lpips = lpips / static_cast<double>(scores.size());
    return mean;
}

/// Means of each region over the images that show enough of it.
[[nodiscard]] inline std::vector<RegionMean> mean_regions(const std::vector<ImageScore>& scores) {
    std::vector<RegionMean> means;
    for (std::size_t r = 0; !scores.empty() && r < scores.front().regions.size(); ++r) {
        std::vector<RegionScore> of_images;
        for (const ImageScore& score : scores) of_images.push_back(score.regions[r]);
        means.push_back(mean_over_images(of_images));
    }
    return means;
}

/// One person's means over the images that show enough of the person.
struct PersonMean {
    RegionMean whole;
    std::vector<RegionMean> regions = {};
};

/// Means of each of several people.
[[nodiscard]] inline std::vector<PersonMean> mean_people(const std::vector<ImageScore>& scores) {
    std::vector<PersonMean> means;
    for (std::size_t p = 0; !scores.empty() && p < scores.front().people.size(); ++p) {
        const auto mean = [&](auto region) {
            std::vector<RegionScore> of_images;
            for (const ImageScore& score : scores) of_images.push_back(region(score.people[p]));
            return mean_over_images(of_images);
        };
        means.push_back({.whole = mean([](const PersonScore& person) { return person.whole; })});
        for (std::size_t r = 0; r < scores.front().people[p].regions.size(); ++r)
            means.back().regions.push_back(mean([&](const PersonScore& person) { return person.regions[r]; }));
    }
    return means;
}

/// The test photographs of a training that left a span of the motion out, by the motion that they show: indices into
/// the list of test photographs. A photograph may be in neither list.
struct MotionSplit {
    std::vector<std::size_t> seen;   ///< of frames that training used, or `between` them
    std::vector<std::size_t> unseen; ///< of the span that was left out: new motion
    /// No test photograph is of a frame that training used, as when the test is by frames of the training cameras. Then
    /// `seen` are the photographs outside of the span that lie between frames that training used.
    bool between = false;
};

/// Sorts the test photographs by the motion that they show. New motion is judged by the cameras that judge seen motion,
/// so that the two differ in the motion alone; if these took no photograph of the span, by all cameras that did.
///
/// Shapes  held_out: frames of the span; timestamps [frames] of the motion.
/// Errors  ValueError for a photograph or a span with a frame that the motion does not have, and for a photograph in
///         `training` that shows a frame of the span.
[[nodiscard]] inline MotionSplit split_by_motion(const std::vector<Photo>& training, const std::vector<Photo>& test,
                                                 Span<const std::size_t> held_out, Span<const double> timestamps) {
    const auto check_frame = [&](const std::string& what, std::size_t frame) {
        check_value(frame < timestamps.size(), "split_by_motion",
                    what + " is of frame " + std::to_string(frame) + ", the motion has " +
                        std::to_string(timestamps.size()) + " frames");
    };
    std::vector<bool> left_out(timestamps.size(), false), trained = left_out;
    for (const std::size_t frame : held_out) {
        check_frame("the span", frame);
        left_out[frame] = true;
    }
    double first = std::numeric_limits<double>::infinity(), last = -first; // times between which training took place
    for (const Photo& photo : training) {
        check_frame(photo.name, photo.frame);
        check_value(!left_out[photo.frame], "split_by_motion",
                    photo.name + " is for training, but frame " + std::to_string(photo.frame) + " is to be left out");
        trained[photo.frame] = true;
        first = std::min(first, timestamps[photo.frame]), last = std::max(last, timestamps[photo.frame]);
    }
    const auto photos_where = [&](const auto& condition) {
        std::vector<std::size_t> photos;
        for (std::size_t i = 0; i < test.size(); ++i)
            if (condition(test[i])) photos.push_back(i);
        return photos;
    };
    for (const Photo& photo : test) check_frame(photo.name, photo.frame);
    MotionSplit split;
    split.seen = photos_where([&](const Photo& photo) { return trained[photo.frame]; });
    if (split.seen.empty()) {
        split.seen = photos_where([&](const Photo& photo) {
            const double time = timestamps[photo.frame];
            return !left_out[photo.frame] && first < time && time < last;
        });
        split.between = !split.seen.empty();
    }
    std::set<std::size_t> cameras;
    for (const std::size_t i : split.seen) cameras.insert(test[i].camera_index);
    split.unseen = photos_where(
        [&](const Photo& photo) { return left_out[photo.frame] && cameras.contains(photo.camera_index); });
    if (split.unseen.empty()) split.unseen = photos_where([&](const Photo& photo) { return left_out[photo.frame]; });
    return split;
}

/// A photograph and its render.
template <std::floating_point T>
struct Comparison {
    ImageScore score;
    Image<T> render, truth; // [3, height, width]
    Image<T> mask;          // [1, height, width] the photograph's alpha
};

/// Renders the photograph's view at its frame and compares the two. At hidden pixels (UnknownPixel) the truth is the
/// render, and the mask is 0.
/// Errors  ValueError for a photograph with an empty mask, which shows no person.
template <class TrainerType>
[[nodiscard]] auto compare(TrainerType& trainer, const Photo& any_photo) {
    using T = typename TrainerType::Scalar;
    const HeldPhoto held(any_photo);
    const Photo& photo = *held;
    Comparison<T> result;
    trainer.render(photo, result.render);
    trainer.photo_pixels(photo, result.truth, result.mask);
    const std::size_t plane = result.mask.data.size();
    for (const UnknownPixel& pixel : photo.unknown) {
        if (!pixel.hidden) continue;
        for (std::size_t at = pixel.index; at < 3 * plane; at += plane) result.truth.data[at] = result.render.data[at];
        result.mask.data[pixel.index] = T(0);
    }
    const auto render = std::as_const(result.render).view(), truth = std::as_const(result.truth).view();
    result.score = ImageScore{.name = photo.name,
                              .psnr = psnr(render, truth),
                              .ssim = ssim(render, truth),
                              .psnr_person = psnr(render, truth, std::as_const(result.mask).view())};
    return result;
}

} // namespace gsh
