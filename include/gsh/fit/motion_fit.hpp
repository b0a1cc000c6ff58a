// SPDX-License-Identifier: Apache-2.0
/// @file  What a fit of a motion takes and gives.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/fit/mask_view.hpp>
#include <gsh/fit/motion_state.hpp>
#include <gsh/fit/turn.hpp>
#include <gsh/fit/view_corrections.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

namespace gsh {

/// A person in one photograph.
struct PersonPhoto {
    std::size_t camera = 0, frame = 0;
    Detection person;
    MaskView mask = {}; ///< if there is one; the caller owns its pixels
};

/// What photographs show of their cameras, beside the calibration.
struct CameraFindings {
    std::vector<double> time_offsets; // [cameras] seconds by which photographs are later than their time stamps
    std::vector<vec2<double>> shifts; // [cameras] pixels by which principal points had to move, mostly none
    double focal = 1;                 ///< factor on the focal lengths
};

struct MotionFitParams {
    std::optional<double> height = {};          ///< of the person, metres
    std::optional<bool> turn = {};              ///< whether the person turns in place in one pose; found if not given
    bool learn_focal = false;                   ///< whether the focal length is a guess, of 15%; for one camera
    std::optional<CameraFindings> cameras = {}; ///< if they are known, as from other people; found if not given
    int betas = 10;                             ///< shape coefficients that are fitted
    std::size_t window = 600; ///< frames that are fitted at once; the shape of a longer motion is that of the first
    Landmarks landmarks = default_landmarks();
    std::function<void(double share)> progress = {};
};

/// Distances of the fitted landmarks from the keypoints of trunk, limbs and head, across the ray.
struct KeypointFit {
    double pixels = 0, metres = 0; ///< medians
    std::size_t count = 0;
};

/// Views in which sides were swapped are in order.
struct MotionFit : CameraFindings, ViewCorrections {
    Motion motion;
    MotionState state;               ///< the same as numbers of a FittedBody with the same number of shape coefficients
    Turn turn;                       ///< how far the person turns
    bool held = false;               ///< whether the pose was held alike, as that of a person who turns in place
    std::vector<double> time_errors; // [cameras] standard errors of offsets, seconds; large if nothing moves
    std::vector<KeypointFit> camera_fit; // [cameras]
    std::vector<double> frame_fit;       // [T] metres, median; NaN without keypoints
    std::size_t outlines = 0;            ///< photographs whose mask was used
};

} // namespace gsh
