// SPDX-License-Identifier: Apache-2.0
/// @file  Finds arms and legs that a descent left in a wrong pose, and gives them that of the frame before or after.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/keypoint_distance.hpp>
#include <gsh/fit/motion_descent.hpp>
#include <gsh/fit/motion_problem.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/view_keypoints.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// Landmarks of an arm or a leg, from the trunk to its end. Those after the first tell its pose.
using LimbLandmarks = std::array<int, 3>;
inline constexpr std::array<LimbLandmarks, 4> limb_landmarks{{
    {landmark_number("left_shoulder"), landmark_number("left_elbow"), landmark_number("left_wrist")},
    {landmark_number("right_shoulder"), landmark_number("right_elbow"), landmark_number("right_wrist")},
    {landmark_number("left_hip"), landmark_number("left_knee"), landmark_number("left_ankle")},
    {landmark_number("right_hip"), landmark_number("right_knee"), landmark_number("right_ankle")},
}};

/// The mean distance of a limb's middle from its keypoints in all views, and that of its end, added; metres.
inline double limb_misfit(const FrameKinematics& kinematics, const LimbLandmarks& limb,
                          const std::vector<ViewKeypoints>& views, double focal) {
    double sum = 0;
    for (const int landmark : {limb[1], limb[2]}) {
        const vec3<double> place = kinematics.landmark(landmark);
        double distances = 0, weights = 0;
        for (const ViewKeypoints& view : views)
            for (const Keypoint& point : view.points) {
                if (point.landmark != landmark) continue;
                const double metres = keypoint_distance(place, view.camera, point.pixel, focal).metres;
                distances += point.confidence * metres, weights += point.confidence;
            }
        if (weights > 0) sum += distances / weights;
    }
    return sum;
}

} // namespace detail

/// An arm that starts on the wrong side of its keypoints can end with the wrist in its place and the elbow far from
/// it: no small step is better. The frames before and after show where it belongs. Limbs that lie far from their
/// keypoints are tried with the pose of the nearest frame to each side in which they do not: the frame descends alone,
/// from these poses and from its own, and keeps the result of least energy if the limb is then clearly nearer. Returns
/// how many limbs were moved.
///
/// Shapes  times [T], seconds.
template <std::same_as<double> Real = double> // see fit_motion
std::size_t free_stuck_limbs(const FittedBody& body, MotionState& state,
                             const std::vector<std::vector<ViewKeypoints>>& views, const std::vector<double>& times,
                             MotionTerms terms) {
    constexpr double far = 0.1, nearer = 0.7; // metres; share of the distance that is left
    const std::size_t T = state.frames.size(), limb_count = detail::limb_landmarks.size();
    const auto misfit = [&](const detail::LimbLandmarks& limb, const FrameNumbers& frame, std::size_t t) {
        return detail::limb_misfit(FrameKinematics(body, frame, state.betas), limb, views[t],
                                   std::exp(state.log_focal));
    };
    std::vector<std::vector<double>> distances(limb_count);
    for (std::size_t l = 0; l < limb_count; ++l)
        for (std::size_t t = 0; t < T; ++t)
            distances[l].push_back(misfit(detail::limb_landmarks[l], state.frames[t], t));
    terms.hold_shared = true, terms.statue = 0, terms.outline = 0, terms.fingers = false;
    std::size_t count = 0;
    for (std::size_t t = 0; t < T; ++t)
        for (std::size_t l = 0; l < limb_count; ++l) {
            if (!(distances[l][t] > far)) continue;
            const detail::LimbLandmarks& limb = detail::limb_landmarks[l];
            const std::vector<std::vector<ViewKeypoints>> shown{views[t]};
            MotionProblem problem(body, shown, {times[t]});
            const auto descended_from = [&](std::size_t other) {
                MotionState alone = state;
                alone.frames = {state.frames[t]};
                for (std::size_t a = 0; a < body.limb_axes; ++a)
                    if (std::any_of(limb.begin(), limb.end(), [&](int landmark) {
                            return body.marks[static_cast<std::size_t>(landmark)].joint == body.axes[a].joint;
                        }))
                        alone.frames[0].angles[a] = state.frames[other].angles[a];
                const double energy = descend(problem, alone, terms, 12, 1e-3).energy;
                return std::pair(energy, alone.frames[0]);
            };
            auto best = descended_from(t);
            const auto try_pose_of = [&](std::size_t other) {
                auto found = descended_from(other);
                if (found.first < best.first) best = std::move(found);
            };
            std::size_t before = t, after = t + 1;
            while (before > 0 && distances[l][before - 1] > far) --before;
            while (after < T && distances[l][after] > far) ++after;
            if (before > 0) try_pose_of(before - 1);
            if (after < T) try_pose_of(after);
            const double left = misfit(limb, best.second, t);
            if (!(left < nearer * distances[l][t])) continue;
            state.frames[t] = best.second, distances[l][t] = left;
            ++count;
        }
    return count;
}

} // namespace gsh
