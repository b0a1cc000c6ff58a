// SPDX-License-Identifier: Apache-2.0
/// @file  A body with fewer joints: selected joints merged into their parents, for models and motions.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <string>
#include <vector>

namespace gsh {

/// The first 22 joints, those of trunk and limbs, which SMPL, SMPL-H and SMPL-X have in common. They exclude fingers,
/// jaw and eyes, and also SMPL's two hand joints, which stay at rest in its motions. A body with at most 22 joints
/// keeps all of them.
[[nodiscard]] inline std::vector<int> trunk_and_limbs(const BodyModel& model) {
    std::vector<int> joints(std::min<std::size_t>(model.joint_count(), 22));
    std::iota(joints.begin(), joints.end(), 0);
    return joints;
}

/// The body with only the `kept` joints. Every other joint becomes rigid with its nearest kept ancestor, which receives
/// its skinning weights. Pose blend shapes of removed joints are removed as well. Expression directions are kept only
/// if `keep_expression` is set, since they are of little use on a body without a jaw.
///
/// Shapes  kept: joints in ascending order, including the root.
/// Errors  ValueError for any other list.
[[nodiscard]] inline BodyModel merge_joints(const BodyModel& model, Span<const int> kept,
                                            bool keep_expression = false) {
    constexpr auto where = "merge_joints";
    const std::size_t V = model.vertex_count(), J = model.joint_count(), K = kept.size();
    check_value(K > 0 && kept[0] == 0, where, "kept must begin with the root, joint 0");
    std::vector<int> place(J, -1); // index of a joint among the kept ones
    for (std::size_t k = 0; k < K; ++k) {
        check_value(kept[k] >= 0 && static_cast<std::size_t>(kept[k]) < J && (k == 0 || kept[k] > kept[k - 1]), where,
                    "kept[" + std::to_string(k) + "] is " + std::to_string(kept[k]) +
                        ", expected ascending joints below " + std::to_string(J));
        place[static_cast<std::size_t>(kept[k])] = static_cast<int>(k);
    }
    std::vector<int> owner = place; // the kept joint that a joint follows; parents precede children
    for (std::size_t j = 1; j < J; ++j)
        if (owner[j] < 0) owner[j] = owner[static_cast<std::size_t>(model.parents[j])];

    BodyModel merged = model;
    merged.J_regressor.clear();
    merged.parents.clear();
    merged.joint_names.clear();
    merged.weights.assign(V * K, 0);
    for (std::size_t k = 0; k < K; ++k) {
        const auto j = static_cast<std::size_t>(kept[k]);
        merged.J_regressor.push_back(model.J_regressor[j]);
        merged.parents.push_back(k ? owner[static_cast<std::size_t>(model.parents[j])] : -1);
        if (!model.joint_names.empty()) merged.joint_names.push_back(model.joint_names[j]);
    }
    for (std::size_t v = 0; v < V; ++v)
        for (std::size_t j = 0; j < J; ++j)
            merged.weights[v * K + static_cast<std::size_t>(owner[j])] += model.weights[v * J + j];
    if (!model.posedirs.empty()) {
        merged.posedirs.clear();
        for (std::size_t v = 0; v < V; ++v)
            for (std::size_t k = 1; k < K; ++k)
                for (std::size_t n = 0; n < 9; ++n)
                    merged.posedirs.push_back(
                        model.posedirs[(v * (J - 1) + static_cast<std::size_t>(kept[k]) - 1) * 9 + n]);
    }
    if (!keep_expression) merged.exprdirs.clear(), merged.expression_count = 0;
    for (auto* hands : {&merged.hands_mean_left, &merged.hands_mean_right}) hands->clear();
    for (auto* components : {&merged.hands_components_left, &merged.hands_components_right}) components->clear();
    return merged;
}

/// The motion of merge_joints' body: the poses of the kept joints.
[[nodiscard]] inline Motion merge_joints(const Motion& motion, Span<const int> kept, bool keep_expression = false) {
    Motion merged = motion;
    merged.joint_count = kept.size();
    merged.pose.clear();
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        for (const int j : kept) {
            check_value(j >= 0 && static_cast<std::size_t>(j) < motion.joint_count, "merge_joints",
                        "joint " + std::to_string(j) + " is kept, the motion has " +
                            std::to_string(motion.joint_count));
            merged.pose.push_back(motion.pose_at(t)[static_cast<std::size_t>(j)]);
        }
    if (!keep_expression) merged.expression.clear(), merged.expression_count = 0;
    return merged;
}

} // namespace gsh
