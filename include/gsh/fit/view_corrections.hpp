// SPDX-License-Identifier: Apache-2.0
/// @file  Corrects what detectors get wrong in one person's views: sides, and points that jump.
#pragma once

#include <gsh/fit/jumping_points.hpp>
#include <gsh/fit/side_swaps.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/fit/view_misfit.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// Camera and frame of views.
using ViewPlaces = std::vector<std::pair<std::size_t, std::size_t>>;

struct ViewCorrections {
    ViewPlaces swapped;  ///< left and right were exchanged
    ViewPlaces left_out; ///< the detector was wrong about the whole person, so the view has no keypoints any more
};

/// Swaps sides back that other views of the moment contradict, or, where no other view shows it, the views before and
/// after; then leaves points out that jump. No body is needed.
///
/// Shapes  views [T] of each frame, one person's, at most one for each camera.
inline ViewCorrections correct_views(std::vector<std::vector<ViewKeypoints>>& views, std::size_t camera_count) {
    ViewCorrections result;
    for (std::size_t t = 0; t < views.size(); ++t) {
        const std::vector<bool> swapped = swap_contradicting_sides(views[t]);
        for (std::size_t v = 0; v < swapped.size(); ++v)
            if (swapped[v]) result.swapped.emplace_back(views[t][v].camera_number, t);
    }
    for (std::size_t c = 0; c < camera_count; ++c) {
        std::vector<ViewKeypoints*> of_camera, alone; // alone: of moments that no other camera shows
        std::vector<std::size_t> frames, frames_alone;
        for (std::size_t t = 0; t < views.size(); ++t)
            for (ViewKeypoints& view : views[t]) {
                if (view.camera_number != c) continue;
                of_camera.push_back(&view), frames.push_back(t);
                if (views[t].size() == 1) alone.push_back(&view), frames_alone.push_back(t);
            }
        const std::vector<bool> swapped = swap_jumping_sides(alone);
        for (std::size_t v = 0; v < swapped.size(); ++v)
            if (swapped[v]) result.swapped.emplace_back(c, frames_alone[v]);
        const std::vector<bool> dropped = drop_jumping_points(of_camera);
        for (std::size_t v = 0; v < dropped.size(); ++v)
            if (dropped[v]) result.left_out.emplace_back(c, frames[v]);
    }
    return result;
}

/// Swaps sides back that a motion contradicts (ViewMisfit::contradicts_sides), and notes the views in `swapped`, where
/// a second swap of a view takes back the first. Returns whether any were swapped.
///
/// places(t) gives what view_misfit() asks for in the t-th of these frames, which is frame first_frame + t of the
/// motion.
///
/// Shapes  views [T] of each frame, one person's.
template <std::invocable<std::size_t> Places>
bool swap_sides_against_motion(std::vector<std::vector<ViewKeypoints>>& views, const Places& places,
                               ViewPlaces& swapped, double focal = 1, std::size_t first_frame = 0) {
    bool any = false;
    for (std::size_t t = 0; t < views.size(); ++t) {
        const auto place = places(t);
        for (ViewKeypoints& view : views[t]) {
            if (!view_misfit(view, place, focal).contradicts_sides()) continue;
            swap_sides(view);
            any = true;
            const std::pair which(view.camera_number, t + first_frame);
            const auto found = std::find(swapped.begin(), swapped.end(), which);
            if (found == swapped.end())
                swapped.push_back(which);
            else
                swapped.erase(found);
        }
    }
    return any;
}

} // namespace gsh
