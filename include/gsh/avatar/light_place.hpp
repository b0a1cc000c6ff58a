// SPDX-License-Identifier: Apache-2.0
/// @file  Brings the light of a capture to a motion that takes place in another world frame.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

namespace gsh {

/// Where a person moves in a world: which way is up, and the box in which the root joint moves.
///
/// Units   metres.
struct MotionPlace {
    std::optional<mat3<double>> upright = {}; ///< upright_rotation of the motion
    vec3<double> low = vec3<double>(0), high = vec3<double>(0);
};

/// The place of some frames of a motion. `root_joint` is the root's rest position.
/// Errors  ValueError without frames, and for a frame that does not exist.
[[nodiscard]] inline MotionPlace place_of(const Motion& motion, const vec3<double>& root_joint,
                                          Span<const std::size_t> frames) {
    check_value(!frames.empty(), "place_of", "there are no frames");
    constexpr double far = std::numeric_limits<double>::infinity();
    MotionPlace place{upright_rotation(motion), vec3<double>(far), vec3<double>(-far)};
    for (const std::size_t frame : frames) {
        check_value(frame < motion.frame_count(), "place_of", "a frame does not exist in the motion");
        const vec3<double> root = motion.transl[frame] + root_joint;
        place.low = glm::min(place.low, root), place.high = glm::max(place.high, root);
    }
    return place;
}

/// The place of a whole motion.
[[nodiscard]] inline MotionPlace place_of(const Motion& motion, const vec3<double>& root_joint) {
    std::vector<std::size_t> frames(motion.frame_count());
    std::iota(frames.begin(), frames.end(), std::size_t(0));
    return place_of(motion, root_joint, frames);
}

/// Metres between the boxes of two motions along an axis, up to which both are in the same place.
inline constexpr double same_place_distance = 1;

/// The light of a capture at `from`, for a motion at `to`. If their worlds have different vertical axes, it turns
/// so that it comes from above where it came from above. If the motion is in another place (same_place_distance), the
/// light moves from the middle of one box to that of the other, since its points are near the people whom they light.
/// A motion in the world and at the place of the capture has the light of the capture, unchanged.
[[nodiscard]] inline LightData light_at(LightData light, const MotionPlace& from, const MotionPlace& to) {
    mat3<double> turn(1.0);
    if (from.upright && to.upright) turn = transpose(*to.upright) * *from.upright;
    const vec3<double> corner = turn * from.low, opposite = turn * from.high;
    const vec3<double> gap = glm::max(to.low - glm::max(corner, opposite), glm::min(corner, opposite) - to.high);
    vec3<double> shift(0);
    if (std::max({gap.x, gap.y, gap.z}) > same_place_distance) shift = (to.low + to.high - corner - opposite) * 0.5;
    for (vec3<double>& point : light.points) point = turn * point + shift;
    for (vec3<double>& direction : light.directions) direction = turn * direction;
    return light;
}

} // namespace gsh
