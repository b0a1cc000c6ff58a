// SPDX-License-Identifier: Apache-2.0
/// @file  Fits the motions of several people who are filmed by the same cameras.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/fit/fit_motion.hpp>
#include <gsh/fit/motion_fit.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// One of several people.
struct PersonToFit {
    std::vector<PersonPhoto> photos;
    std::optional<double> height = {}; ///< metres
};

/// What all people together show of their cameras.
///
/// Offsets of clocks τ minimise Σ (τ_c + g_p - τ_pc)² / σ_pc², with τ_pc and σ_pc those of person p alone, which are
/// only known up to a common g_p. Those of less than a tenth of a frame are zero. Shifts of principal points are
/// means, weighted by the number of keypoints, and zero below 0.5% of the image. The focal length is the geometric
/// mean.
[[nodiscard]] inline CameraFindings common_findings(const std::vector<MotionFit>& fits,
                                                    const std::vector<Camera<double>>& cameras, double frame_seconds) {
    const std::size_t C = cameras.size();
    CameraFindings result{std::vector<double>(C, 0.0), std::vector<vec2<double>>(C, vec2<double>(0))};
    const auto weight = [&](const MotionFit& fit, std::size_t c) {
        return 1 / (fit.time_errors[c] * fit.time_errors[c]);
    };
    std::vector<double> gauge(fits.size(), 0.0);
    for (int pass = 0; pass < 50; ++pass) { // the minimum over one, then over the other
        for (std::size_t c = 0; c < C; ++c) {
            double sum = 0, weights = 0;
            for (std::size_t p = 0; p < fits.size(); ++p)
                sum += weight(fits[p], c) * (fits[p].time_offsets[c] - gauge[p]), weights += weight(fits[p], c);
            result.time_offsets[c] = sum / weights;
        }
        for (std::size_t p = 1; p < fits.size(); ++p) { // that of the first person is the common one
            double sum = 0, weights = 0;
            for (std::size_t c = 0; c < C; ++c)
                sum += weight(fits[p], c) * (fits[p].time_offsets[c] - result.time_offsets[c]),
                    weights += weight(fits[p], c);
            gauge[p] = sum / weights;
        }
    }
    double log_focal = 0;
    for (const MotionFit& fit : fits) log_focal += std::log(fit.focal) / static_cast<double>(fits.size());
    result.focal = std::exp(log_focal);
    for (std::size_t c = 0; c < C; ++c) {
        if (std::abs(result.time_offsets[c]) < 0.1 * frame_seconds) result.time_offsets[c] = 0;
        double count = 0;
        for (const MotionFit& fit : fits) {
            const auto points = static_cast<double>(fit.camera_fit[c].count);
            result.shifts[c] += fit.shifts[c] * points, count += points;
        }
        if (count > 0) result.shifts[c] = result.shifts[c] / count;
        constexpr double least = 0.005; // of the longer side
        if (std::hypot(result.shifts[c].x, result.shifts[c].y) < least * std::max(cameras[c].width, cameras[c].height))
            result.shifts[c] = vec2<double>(0);
    }
    return result;
}

/// Fits each person by itself (fit_motion). Where the people find different offsets of clocks, shifts of principal
/// points or focal lengths, these are averaged (common_findings), and everybody is fitted again with them: so all of
/// them live in one world. Heights are those of the people; `params.height` does not count.
///
/// Errors  those of fit_motion; ValueError without people.
template <std::same_as<double> Real = double> // see fit_motion
[[nodiscard]] std::vector<MotionFit> fit_people(const BodyModel& body, const std::vector<Camera<double>>& cameras,
                                                const std::vector<PersonToFit>& people,
                                                const std::vector<double>& times, MotionFitParams params = {}) {
    check_value(!people.empty(), "fit_people", "there are no people");
    const auto progress = params.progress;
    const std::size_t rounds = people.size() > 1 && !params.cameras ? 2 : 1;
    std::vector<MotionFit> fits;
    for (std::size_t round = 0; round < rounds; ++round) {
        fits.clear();
        for (const PersonToFit& person : people) {
            params.height = person.height;
            if (progress)
                params.progress = [&](double share) {
                    progress((static_cast<double>(round * people.size() + fits.size()) + share) /
                             static_cast<double>(rounds * people.size()));
                };
            fits.push_back(fit_motion(body, cameras, person.photos, times, params));
        }
        if (round + 1 == rounds) break;
        const double frame =
            times.size() > 1 ? (times.back() - times.front()) / static_cast<double>(times.size() - 1) : 1;
        params.cameras = common_findings(fits, cameras, frame);
        const bool agree = std::all_of(fits.begin(), fits.end(), [&](const MotionFit& fit) {
            return fit.time_offsets == params.cameras->time_offsets && fit.shifts == params.cameras->shifts &&
                   fit.focal == params.cameras->focal;
        });
        if (agree) break;
    }
    return fits;
}

} // namespace gsh
