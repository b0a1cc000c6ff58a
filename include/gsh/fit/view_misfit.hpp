// SPDX-License-Identifier: Apache-2.0
/// @file  How far a posed body lies from the keypoints of a view, as they are and with their sides swapped.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/fit/keypoint_distance.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <vector>

namespace gsh {

/// Distances of a view's landmarks of trunk, limbs and head from their keypoints.
struct ViewMisfit {
    std::vector<double> metres, pixels;
    double straight = 0, swapped = 0; ///< sums of distances, each at most 0.3 m

    /// Whether left and right are swapped: clearly nearer after a swap, and far before it.
    [[nodiscard]] bool contradicts_sides() const {
        return metres.size() >= 6 && swapped <= 0.6 * straight && straight >= 0.05 * static_cast<double>(metres.size());
    }
};

/// place(landmark) is where a landmark is, as a std::optional, empty if the body does not have it. `focal` is a factor
/// on the camera's focal lengths. Guesses, with a confidence below a half, do not count.
///
/// Frame   places in the world.
template <std::invocable<int> Place>
[[nodiscard]] ViewMisfit view_misfit(const ViewKeypoints& view, const Place& place, double focal = 1) {
    constexpr int first_hand = landmark_number("left_hand_wrist");
    constexpr double most = 0.3;
    ViewMisfit result;
    for (const Keypoint& point : view.points) {
        if (point.landmark >= first_hand || point.confidence < 0.5) continue;
        const auto own = place(point.landmark), other = place(mirrored_landmark(point.landmark));
        if (!own || !other) continue;
        const auto [pixels, metres] = keypoint_distance(*own, view.camera, point.pixel, focal);
        result.pixels.push_back(pixels), result.metres.push_back(metres);
        result.straight += std::min(most, metres);
        result.swapped += std::min(most, keypoint_distance(*other, view.camera, point.pixel, focal).metres);
    }
    return result;
}

} // namespace gsh
