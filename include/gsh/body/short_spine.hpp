// SPDX-License-Identifier: Apache-2.0
/// @file  Spines of one or two joints: which joints of the body they move.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>
#include <vector>

namespace gsh {

/// Gives the one or two joints of a short spine to those joints of the body's that are at the same shares of the way
/// from the hips to the shoulders. `source` holds the rig's joints, `target` the body's; both rigs are at rest.
inline void match_short_spine(const RigMotion& rest, MatchedJoints& source, const RigMotion& own,
                              const MatchedJoints& target) {
    constexpr std::array<std::string_view, 3> names = {"spine1", "spine2", "spine3"};
    const auto share = [](const RigMotion& rig, const MatchedJoints& matched, int joint) {
        const detail::JointPair hips(rig.rest_joints.data(), matched, "left_hip", "right_hip");
        const vec3<double> way =
            detail::JointPair(rig.rest_joints.data(), matched, "left_shoulder", "right_shoulder").mean - hips.mean;
        return dot(rig.rest_joints[static_cast<std::size_t>(joint)] - hips.mean, way) / dot(way, way);
    };
    std::vector<int> joints;
    std::vector<std::size_t> places; // those of the body's joints that exist
    for (const auto name : names) {
        const auto k = static_cast<std::size_t>(smplx_joint(name));
        if (source[k] >= 0) joints.push_back(source[k]);
        if (target[k] >= 0) places.push_back(k);
    }
    if (joints.empty() || joints.size() >= places.size()) return;
    const auto distance = [&](std::size_t joint, std::size_t place) {
        return std::abs(share(rest, source, joints[joint]) - share(own, target, target[places[place]]));
    };
    std::array<std::size_t, 2> best{};
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t a = 0; a < places.size(); ++a)
        for (std::size_t b = joints.size() == 1 ? a : a + 1; b < (joints.size() == 1 ? a + 1 : places.size()); ++b) {
            const double sum = distance(0, a) + (joints.size() == 1 ? 0 : distance(1, b));
            if (sum < least) least = sum, best = {a, b};
        }
    if (!std::isfinite(least)) return; // hips and shoulders coincide
    for (const auto name : names) source[static_cast<std::size_t>(smplx_joint(name))] = -1;
    for (std::size_t n = 0; n < joints.size(); ++n) source[places[best[n]]] = joints[n];
}

} // namespace gsh
