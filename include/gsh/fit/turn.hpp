// SPDX-License-Identifier: Apache-2.0
/// @file  Tells whether a person turns in place in one pose.
#pragma once

#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/motion_problem.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace gsh {

struct Turn {
    double degrees = 0;   ///< by which the body turns about its own axis between the extremes
    double variation = 0; ///< radians: standard deviation of the limbs' angles over time, root mean square
    /// More than 300 degrees in a pose that hardly changes: what one camera guesses in depth varies by less.
    [[nodiscard]] explicit operator bool() const { return degrees > 300 && variation < 0.3; }
};

[[nodiscard]] inline Turn turn_of(const FittedBody& body, const MotionState& state) {
    Turn turn;
    const std::size_t T = state.frames.size();
    if (T < 3) return turn;
    vec3<double> axis(0);
    for (const FrameNumbers& frame : state.frames) axis += frame.root[1];
    if (length(axis) == 0) return turn;
    axis = normalize(axis);
    const vec3<double> side =
        normalize(cross(axis, std::abs(axis.x) < 0.7 ? vec3<double>(1, 0, 0) : vec3<double>(0, 0, 1)));
    const vec3<double> front = cross(side, axis);
    double angle = 0, low = 0, high = 0, before = 0;
    for (std::size_t t = 0; t < T; ++t) {
        const vec3<double> faces = state.frames[t].root[2];
        const double now = std::atan2(dot(faces, side), dot(faces, front));
        if (t > 0) angle += std::remainder(now - before, 2 * std::numbers::pi);
        before = now;
        low = std::min(low, angle), high = std::max(high, angle);
    }
    turn.degrees = (high - low) * 180 / std::numbers::pi;
    for (std::size_t a = 0; a < body.limb_axes; ++a) {
        double mean = 0, squares = 0;
        for (const FrameNumbers& frame : state.frames) mean += frame.angles[a] / static_cast<double>(T);
        for (const FrameNumbers& frame : state.frames) squares += (frame.angles[a] - mean) * (frame.angles[a] - mean);
        turn.variation += squares / static_cast<double>(T) / static_cast<double>(body.limb_axes);
    }
    turn.variation = std::sqrt(turn.variation);
    return turn;
}

} // namespace gsh
