// SPDX-License-Identifier: Apache-2.0
/// @file  Evaluation of a scene on photographs that training did not use.
#pragma once

#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/pipeline/photo.hpp>

#include <cmath>
#include <cstddef>
#include <optional>
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

/// A photograph and its render.
template <std::floating_point T>
struct Comparison {
    ImageScore score;
    Image<T> render, truth; // [3, height, width]
    Image<T> mask;          // [1, height, width] the photograph's alpha
};

/// Renders the photograph's view at its frame and compares the two.
/// Errors  ValueError for a photograph with an empty mask, which shows no person.
template <class TrainerType>
[[nodiscard]] auto compare(TrainerType& trainer, const Photo& photo) {
    using T = typename TrainerType::Scalar;
    Comparison<T> result;
    trainer.render(photo, result.render);
    trainer.photo_pixels(photo, result.truth, result.mask);
    const auto render = std::as_const(result.render).view(), truth = std::as_const(result.truth).view();
    result.score = {.name = photo.name,
                    .psnr = psnr(render, truth),
                    .ssim = ssim(render, truth),
                    .psnr_person = psnr(render, truth, std::as_const(result.mask).view())};
    return result;
}

} // namespace gsh
