// SPDX-License-Identifier: Apache-2.0
/// @file  Finds detections in which left and right are swapped, and swaps them back.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/fit/triangulation.hpp>
#include <gsh/fit/view_keypoints.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

/// Exchanges left and right. Points of the face's mesh stay: their network sees a face, not sides.
inline void swap_sides(ViewKeypoints& view) {
    constexpr int first_face = landmark_number("face_nose");
    for (Keypoint& point : view.points)
        if (point.landmark < first_face) point.landmark = mirrored_landmark(point.landmark);
    for (MetricPoint& point : view.metric) point.landmark = mirrored_landmark(point.landmark);
}

/// Swaps back what several views of one moment contradict: of all choices of at most half the views, the one whose
/// triangulated landmarks of trunk and limbs lie nearest to their rays, if it is clearly nearer than no swap at all.
/// Returns which views were swapped.
inline std::vector<bool> swap_contradicting_sides(std::vector<ViewKeypoints>& views) {
    std::vector<bool> best(views.size(), false);
    if (views.size() < 2) return best;
    constexpr int first_hand = landmark_number("left_hand_wrist");
    const auto misfit = [&](const std::vector<bool>& swapped) {
        std::vector<std::vector<SightLine>> lines(static_cast<std::size_t>(first_hand));
        for (std::size_t v = 0; v < views.size(); ++v)
            for (const Keypoint& point : views[v].points) {
                if (point.landmark >= first_hand || point.confidence < 0.3) continue;
                const int landmark = swapped[v] ? mirrored_landmark(point.landmark) : point.landmark;
                lines[static_cast<std::size_t>(landmark)].push_back({&views[v].camera, point.pixel, point.confidence});
            }
        double sum = 0, count = 0;
        for (const auto& of : lines)
            if (const auto point = triangulate(of))
                sum += point->distance * static_cast<double>(of.size()), count += static_cast<double>(of.size());
        return count > 0 ? sum / count : 0;
    };
    constexpr double margin = 0.01; // metres for each swap: noise does not swap
    double least = misfit(best);
    const auto try_out = [&](const std::vector<bool>& choice) {
        const auto count = static_cast<std::size_t>(std::count(choice.begin(), choice.end(), true));
        if (2 * count > views.size()) return;
        const double found = misfit(choice) + margin * static_cast<double>(count);
        if (found < least) least = found, best = choice;
    };
    if (views.size() <= 6) {
        for (std::uint32_t bits = 1; bits < 1u << views.size(); ++bits) {
            std::vector<bool> choice(views.size());
            for (std::size_t v = 0; v < views.size(); ++v) choice[v] = bits >> v & 1;
            try_out(choice);
        }
    } else {
        for (bool better = true; better;) { // one view after the other
            const double before = least;
            const std::vector<bool> from = best;
            for (std::size_t v = 0; v < views.size(); ++v) {
                std::vector<bool> choice = from;
                choice[v] = !choice[v];
                try_out(choice);
            }
            better = least < before;
        }
    }
    for (std::size_t v = 0; v < views.size(); ++v)
        if (best[v]) swap_sides(views[v]);
    return best;
}

/// Swaps back what the views before and after contradict, in the views of one camera in the order of their frames: of
/// all choices, the one whose shoulders, elbows, wrists, hips, knees and ankles move least from view to view. A swap
/// costs a tenth of the distance between left and right, so that a doubtful view stays. Returns which views were
/// swapped.
///
/// Source  Viterbi, "Error bounds for convolutional codes and an asymptotically optimum decoding algorithm", 1967.
inline std::vector<bool> swap_jumping_sides(const std::vector<ViewKeypoints*>& views) {
    std::vector<bool> swapped(views.size(), false);
    if (views.size() < 3) return swapped;
    constexpr std::array<int, 6> left{landmark_number("left_shoulder"), landmark_number("left_elbow"),
                                      landmark_number("left_wrist"),    landmark_number("left_hip"),
                                      landmark_number("left_knee"),     landmark_number("left_ankle")};
    const auto place = [](const ViewKeypoints& view, int landmark) -> const vec2<double>* {
        for (const Keypoint& point : view.points)
            if (point.landmark == landmark && point.confidence >= 0.3) return &point.pixel;
        return nullptr;
    };
    const auto apart = [](const vec2<double>& a, const vec2<double>& b) { return std::hypot(a.x - b.x, a.y - b.y); };
    // Cost of the best choice up to a view, for both of its states, and the state before it.
    std::vector<std::array<double, 2>> cost(views.size(), {0, 0});
    std::vector<std::array<int, 2>> before(views.size(), {0, 1});
    for (std::size_t v = 0; v < views.size(); ++v) {
        double width = 0, same = 0, crossed = 0;
        for (const int l : left) {
            const vec2<double>*a = place(*views[v], l), *b = place(*views[v], mirrored_landmark(l));
            if (!a || !b) continue;
            width += apart(*a, *b);
            if (v == 0) continue;
            const vec2<double>*p = place(*views[v - 1], l), *q = place(*views[v - 1], mirrored_landmark(l));
            if (!p || !q) continue;
            same += apart(*a, *p) + apart(*b, *q), crossed += apart(*a, *q) + apart(*b, *p);
        }
        for (const int state : {0, 1}) {
            const auto s = static_cast<std::size_t>(state);
            cost[v][s] = 0.1 * width * state;
            if (v == 0) continue;
            const double stay = cost[v - 1][s] + same, change = cost[v - 1][1 - s] + crossed;
            before[v][s] = change < stay ? 1 - state : state;
            cost[v][s] += std::min(stay, change);
        }
    }
    int state = cost.back()[1] < cost.back()[0] ? 1 : 0;
    for (std::size_t v = views.size(); v-- > 0;) {
        if (state == 1) swap_sides(*views[v]), swapped[v] = true;
        state = before[v][static_cast<std::size_t>(state)];
    }
    return swapped;
}

} // namespace gsh
