// SPDX-License-Identifier: Apache-2.0
/// @file  Finds detections that jump away from those before and after them, and leaves them out.
#pragma once

#include <gsh/body/landmarks.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// Removes points that lie far from where the views before and after have them, in the views of one camera in the order
/// of their frames. Far is more than five times the median distance of these neighbours from their own median, and more
/// than a tenth of the person's height. Fast hands are no outliers: their neighbours lie far apart, too. Where most
/// points of trunk and limbs jump, the detector was wrong about the whole person: then all points go, and the mask
/// alone is left. Returns for each view whether that was so.
inline std::vector<bool> drop_jumping_points(const std::vector<ViewKeypoints*>& views) {
    std::vector<bool> dropped(views.size(), false);
    constexpr std::size_t around = 3; // views to each side
    if (views.size() < 2 * around) return dropped;
    constexpr int first_hand = landmark_number("left_hand_wrist");
    const std::size_t L = 2 * landmark_places.size();
    // The pixel of each landmark in each view, and the usual height of the person.
    std::vector<std::vector<const vec2<double>*>> pixels(views.size(), std::vector<const vec2<double>*>(L, nullptr));
    std::vector<double> heights;
    for (std::size_t v = 0; v < views.size(); ++v) {
        double low = 1e300, high = -1e300;
        for (const Keypoint& point : views[v]->points) {
            pixels[v][static_cast<std::size_t>(point.landmark)] = &point.pixel;
            if (point.landmark < first_hand) low = std::min(low, point.pixel.y), high = std::max(high, point.pixel.y);
        }
        if (high > low) heights.push_back(high - low);
    }
    if (heights.empty()) return dropped;
    const double height = median(heights);
    std::vector<std::vector<bool>> jumps(views.size(), std::vector<bool>(L, false));
    std::vector<double> xs, ys, distances;
    for (std::size_t v = 0; v < views.size(); ++v)
        for (std::size_t l = 0; l < L; ++l) {
            if (!pixels[v][l]) continue;
            xs.clear(), ys.clear(), distances.clear();
            std::vector<vec2<double>> others;
            for (std::size_t w = v < around ? 0 : v - around; w < std::min(views.size(), v + around + 1); ++w)
                if (w != v && pixels[w][l]) others.push_back(*pixels[w][l]);
            if (others.size() < 3) continue;
            for (const auto& p : others) xs.push_back(p.x), ys.push_back(p.y);
            const vec2<double> usual{median(xs), median(ys)};
            for (const auto& p : others) distances.push_back(std::hypot(p.x - usual.x, p.y - usual.y));
            const double away = std::hypot(pixels[v][l]->x - usual.x, pixels[v][l]->y - usual.y);
            jumps[v][l] = away > std::max(0.1 * height, 5 * median(distances));
        }
    for (std::size_t v = 0; v < views.size(); ++v) {
        std::size_t body = 0, jumping = 0;
        for (const Keypoint& point : views[v]->points)
            if (point.landmark < first_hand) ++body, jumping += jumps[v][static_cast<std::size_t>(point.landmark)];
        dropped[v] = body > 0 && 3 * jumping > body; // a third: hips and head seldom jump, even then
        if (dropped[v]) {
            views[v]->points.clear(), views[v]->metric.clear();
            continue;
        }
        std::erase_if(views[v]->points,
                      [&](const Keypoint& point) { return jumps[v][static_cast<std::size_t>(point.landmark)]; });
    }
    return dropped;
}

} // namespace gsh
