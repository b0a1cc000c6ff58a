// SPDX-License-Identifier: Apache-2.0
/// @file  Skinning weights of the actor: each vertex is influenced by a few neighbouring bones of one chain.
#pragma once

#include <gsh/synthetic/actor_shape.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace gsh {

using ActorWeights = std::array<double, actor_joint_count>;

namespace detail {

/// Smooth step from 0 to 1 across a plane through `at` with unit normal n, over a band of half-width w.
inline double beyond(const Point& p, const Point& at, const Point& n, double w) {
    return smooth_step(-w, w, dot(p - at, n));
}

/// The share of its parent's weight that passes to the left (or middle) joint; x >= 0. It is a smooth step across a
/// plane through the joint, and zero wherever another limb could cross that plane.
inline double body_share(const Point& p, int joint) {
    const Point at = actor_joint(joint);
    switch (joint) {
    case smplx::left_hip: // the crease of the groin, from the crotch to the hip bone
        return beyond(p, at + Point(0, -0.010, 0), normalize(Point(0.50, -0.86, 0)), 0.055) *
               smooth_step(-0.026, 0.026, p.x) * smooth_step(0.16, 0.10, p.y);
    case smplx::left_knee:
        return beyond(p, at, {0, -1, 0}, 0.050);
    case smplx::left_ankle:
        return beyond(p, at, normalize(Point(0, -1, 0.5)), 0.026);
    case smplx::left_foot:
        return beyond(p, at, normalize(Point(0.14, 0, 1)), 0.025);
    case smplx::spine1:
    case smplx::spine2:
    case smplx::spine3:
        return beyond(p, at, {0, 1, 0}, 0.050);
    case smplx::neck:
        return beyond(p, at + Point(0, 0.008, 0), normalize(Point(0, 1, 0.15)), 0.032) *
               smooth_step(0.135, 0.060, p.x - std::max(0.0, p.y - 0.51));
    case smplx::head:
        return beyond(p, at, normalize(Point(0, 1, 0.55)), 0.028);
    case smplx::left_collar: // lower towards the armpit
        return smooth_step(0.005, 0.110, p.x) * smooth_step(0.34, 0.42, p.y + std::max(0.0, p.x - 0.13));
    case smplx::left_shoulder:
        return beyond(p, at + Point(0.004, 0, 0), {1, 0, 0}, 0.055);
    case smplx::left_elbow:
        return beyond(p, at, {1, 0, 0}, 0.038);
    case smplx::left_wrist:
        return beyond(p, at, {1, 0, 0}, 0.022);
    default:
        return 0;
    }
}

/// Share of the jaw: lower lip, chin, and the cheeks below the line from the mouth's corner to the hinge.
inline double jaw_share(const Point& p) {
    const double bend = 0.0030 * (p.x / 0.024) * (p.x / 0.024);
    const double line = p.z > 0.118 ? actor_mouth_y - std::min(bend, 0.003) : 0.6035 + 0.38 * (0.118 - p.z);
    const double soft =
        0.0003 + 0.6 * std::max(0.0, p.x - (actor_mouth_corner_x - 0.0045)) + 0.35 * std::max(0.0, 0.10 - p.z);
    return smooth_step(-1, 1, (line - p.y) / std::min(soft, 0.025)) * smooth_step(0.035, 0.080, p.z);
}

/// Share of the wrist's weight that passes to a finger: for points beyond the knuckle and nearest to that finger.
inline double finger_share(const Point& p, int finger) {
    constexpr double softness = 0.0018;
    const int first = smplx::left_index1 + 3 * finger;
    const Point at = actor_joint(first), along = normalize(actor_joint(first + 1) - at);
    const bool thumb = finger == 4;
    const double mine = finger_distance(p, finger);
    double others = thumb ? std::exp((mine - palm_distance(p)) / (3 * softness)) : 0;
    for (int other = 0; other < 5; ++other)
        if (other != finger) others += std::exp(std::min(50.0, (mine - finger_distance(p, other)) / softness));
    return beyond(p, at + along * (thumb ? 0.010 : 0.004), along, thumb ? 0.016 : 0.010) / (1 + others);
}

} // namespace detail

/// Weights of a T-pose surface point: non-negative, with sum 1, at most five of them non-zero.
///
/// Weights are distributed down the tree. The root starts with weight 1, and each joint takes its share of its parent's
/// weight. A finger can therefore share weight only with its own hand.
[[nodiscard]] inline ActorWeights actor_weights(const vec3<double>& point) {
    using namespace detail;
    ActorWeights weights{};
    weights[smplx::pelvis] = 1;
    for (int joint = 1; joint < actor_joint_count; ++joint) {
        const auto& info = actor_joints[static_cast<std::size_t>(joint)];
        double& parent = weights[static_cast<std::size_t>(info.parent)];
        if (parent < 1e-6) continue;
        const bool right = info.position[0] < 0;
        const Point p(right ? -point.x : info.position[0] > 0 ? point.x : std::abs(point.x), point.y, point.z);
        int twin = joint; // the corresponding left joint, for which the shares are defined
        if (right) twin = joint >= smplx::right_index1 ? joint - actor_finger_joints : joint - 1;
        double share = 0;
        if (twin == smplx::jaw)
            share = jaw_share(p);
        else if (twin == smplx::left_eye)
            share = smooth_step(0.0142, 0.0136, length(p - actor_joint(smplx::left_eye)));
        else if (twin < smplx::jaw)
            share = body_share(p, twin);
        else if ((twin - smplx::left_index1) % 3 == 0)
            share = finger_share(p, (twin - smplx::left_index1) / 3);
        else
            share = beyond(p, actor_joint(twin), normalize(actor_joint(twin) - actor_joint(twin - 1)), 0.0080);
        weights[static_cast<std::size_t>(joint)] = parent * share;
        parent -= parent * share;
    }
    // Keep at most five weights, and drop negligible ones.
    ActorWeights sorted = weights;
    std::nth_element(sorted.begin(), sorted.begin() + 5, sorted.end(), [](double a, double b) { return a > b; });
    const double cut = std::max(sorted[5], 5e-3);
    double sum = 0;
    for (double& w : weights) sum += w = w > cut ? w : 0;
    for (double& w : weights) w /= sum;
    return weights;
}

} // namespace gsh
