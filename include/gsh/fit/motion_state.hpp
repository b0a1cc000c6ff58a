// SPDX-License-Identifier: Apache-2.0
/// @file  A motion that is being fitted, and the weights of its energy.
#pragma once

#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/math/vec.hpp>

#include <optional>
#include <vector>

namespace gsh {

/// A motion that is being fitted.
struct MotionState {
    std::vector<FrameNumbers> frames; // [T]
    std::vector<double> betas;        // [S]
    double log_focal = 0;             ///< logarithm of the factor on the focal lengths
    // Of a person who turns in place in one pose:
    std::vector<double> held_angles; // [limb axes] the pose
    vec3<double> axis{0};            ///< the direction of the body's axis in the world
};

/// The weights of the energy's terms. Those without a comment multiply the term.
struct MotionTerms {
    bool fingers = true;      ///< whether fingers move; else their points do not count, but for the knuckles
    bool hold_shared = false; ///< whether shape and focal length stay
    double hands = 1;         ///< of keypoints of fingers
    double face = 0.5;        ///< of keypoints of the face's mesh
    double metric = 0.3;      ///< of the detector's guesses in metres
    double prior = 0.3;       ///< of the angles' usual range
    double finger_prior = 0.3;
    double acceleration = 0.1;
    double statue = 0;            ///< of the angles' distance from their mean over time
    double axis_spread = 0.02;    ///< with `statue`, radians: of the body's axis about its mean direction in the world
    double outline = 0;           ///< of all points of a view's outline together
    double outline_spread = 0.01; ///< metres
    double cloth = 0.5;           ///< factor on distances of masks that reach beyond the body: people wear clothes
    double betas = 2;             ///< of the shape, for each 20 frames
    double focal_spread = 0;      ///< of the focal length's logarithm; 0 keeps it
    std::optional<double> height = {}; ///< metres, of the body at rest
    double height_spread = 0.002;
};

} // namespace gsh
