// SPDX-License-Identifier: Apache-2.0
/// @file  Whether a rig is an animal on four legs, which may have the joints' names of a person.
#pragma once

#include <gsh/body/joint_finder.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>

namespace gsh {

/// Whether a rig stands on its hands in its rest pose, with the trunk across its legs, and has arms as long as legs or
/// a trunk as long: an animal. A person whose rest pose crawls or bends has shorter arms (two thirds of a leg) and a
/// shorter trunk; a figure with long arms stands upright in its rest pose.
///
/// A rig with a tail, whose rest pose may be none, is also an animal if it stands so in nine of ten frames.
[[nodiscard]] inline bool stands_on_four_legs(const RigMotion& rig, const MatchedJoints& matched);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Places of the joints that a pose is judged by: the means of both sides, so that a step does not count.
class FourLegs {
public:
    FourLegs(const vec3<double>* joints, const MatchedJoints& matched) {
        const auto mean = [&](const char* joint) {
            vec3<double> sum(0);
            for (const char* side : {"left_", "right_"})
                sum += joints[matched[static_cast<std::size_t>(smplx_joint(std::string(side) + joint))]] * 0.5;
            return sum;
        };
        const auto along = [&](const char* a, const char* b, const char* c) { // length of a limb
            double sum = 0;
            for (const std::string side : {"left_", "right_"}) {
                const auto at = [&](const char* joint) {
                    return joints[matched[static_cast<std::size_t>(smplx_joint(side + joint))]];
                };
                sum += (length(at(b) - at(a)) + length(at(c) - at(b))) * 0.5;
            }
            return sum;
        };
        hips_ = mean("hip"), shoulders_ = mean("shoulder"), hands_ = mean("wrist"), feet_ = mean("ankle");
        arm_ = along("shoulder", "elbow", "wrist"), leg_ = along("hip", "knee", "ankle");
    }
    /// Legs stand across the trunk, and so do the arms, with hands as low as feet.
    [[nodiscard]] bool stands() const {
        const vec3<double> leg = feet_ - hips_, arm = hands_ - shoulders_, trunk = shoulders_ - hips_;
        const double height = length(leg);
        const vec3<double> down = leg * (1 / height);
        return std::abs(dot(trunk, down)) < 0.5 * length(trunk) && dot(arm, down) > 0.7 * length(arm) &&
               std::abs(dot(hands_ - feet_, down)) < 0.35 * height; // false for NaN
    }
    [[nodiscard]] bool has_animal_proportions() const {
        return arm_ > 0.8 * leg_ || length(shoulders_ - hips_) > 0.9 * leg_;
    }

private:
    vec3<double> hips_, shoulders_, hands_, feet_;
    double arm_ = 0, leg_ = 0;
};

} // namespace detail

inline bool stands_on_four_legs(const RigMotion& rig, const MatchedJoints& matched) {
    for (const std::string side : {"left_", "right_"})
        for (const char* joint : {"hip", "knee", "ankle", "shoulder", "elbow", "wrist"})
            if (matched[static_cast<std::size_t>(smplx_joint(side + joint))] < 0) return false;
    const detail::FourLegs rest(rig.rest_joints.data(), matched);
    if (!rest.has_animal_proportions()) return false;
    if (rest.stands()) return true;
    const bool tail = std::any_of(rig.names.begin(), rig.names.end(),
                                  [](const std::string& name) { return joint_words(name).part.starts_with("tail"); });
    if (!tail) return false;
    std::size_t standing = 0;
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        standing += detail::FourLegs(&rig.joints[t * rig.joint_count()], matched).stands();
    return 10 * standing >= 9 * rig.frame_count();
}

} // namespace gsh
