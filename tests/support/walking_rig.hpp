// SPDX-License-Identifier: Apache-2.0
/// @file  A sample rig that walks, and the same motion of rigs whose joints have other axes. Made by code.
#pragma once

#include "support/sample_rig.hpp"

#include <gsh/body/rig_motion.hpp>

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh::test {

/// The sample rig in a walk: arms hang and swing, elbows bend forward and knees back. Angles are in the order "XYZ".
/// `lean` bends the spine forward in all frames; in radians, as `yaw`.
inline SampleRig walking_rig(SampleOptions o = {}, double lean = 0, double yaw = 0) {
    o.frames = 40;
    SampleRig rig = sample_rig(o);
    for (std::size_t t = 0; t < o.frames; ++t) {
        const double s = std::sin(0.21 * static_cast<double>(t));
        auto& angles = rig.angles[t];
        for (auto& a : angles) a = vec3<double>(0);
        const auto set = [&](const std::string& part, const vec3<double>& angle) {
            if (const int j = rig.joint(part); j >= 0) angles[static_cast<std::size_t>(j)] = angle;
        };
        set("pelvis", {0, yaw + 0.1 * s, 0});
        for (int k = 1; k <= o.spine; ++k)
            set("spine" + std::to_string(k), {lean / o.spine, k == o.spine ? -0.2 * s : 0, 0});
        set("neck", {0, 0.1 * s, 0});
        for (const double x : {1.0, -1.0}) {
            const std::string side = x > 0 ? "left_" : "right_";
            const double down = o.rest == Rest::T ? -1.3 : o.rest == Rest::A ? -0.6 : 0;
            set(side + "shoulder", {0.4 * s * x, 0, x * down});
            set(side + "elbow", o.rest == Rest::T ? vec3<double>(0, -x * (0.5 + 0.2 * s * x), 0)
                                                  : vec3<double>(-0.5 - 0.2 * s * x, 0, 0));
            set(side + "hip", {-0.35 * s * x, 0, 0});
            set(side + "knee", {0.4 - 0.2 * s * x, 0, 0});
            set(side + "ankle", {-0.2, 0, 0});
        }
        const vec3<double> ahead(std::sin(yaw), 0, std::cos(yaw));
        rig.root[t] = rig.rest[0] + rig.world_from_person * (ahead * (0.03 * static_cast<double>(t))) * o.units;
    }
    return rig;
}

/// The sample as a RigMotion with rest rotations that are the axes.
inline RigMotion rig_motion_of(const SampleRig& sample, const std::string& order = "XYZ") {
    RigMotion rig;
    rig.names = sample.names, rig.parents = sample.parents, rig.rest_joints = sample.rest;
    rig.rest_rotations.assign(sample.names.size(), mat3<double>(1.0));
    for (std::size_t t = 0; t < sample.root.size(); ++t) {
        const auto pose = pose_of(sample, t, order);
        rig.joints.insert(rig.joints.end(), pose.joints.begin(), pose.joints.end());
        rig.rotations.insert(rig.rotations.end(), pose.rotations.begin(), pose.rotations.end());
        rig.timestamps.push_back(static_cast<double>(t) / 30);
    }
    return rig;
}

/// How joints lie along their bones: local x points to the next joint.
struct BoneAxes {
    bool mirrored = false;      ///< -x on the right side
    double spine_roll = 0;      ///< radians about the bones of spine, neck and head
    double arm_roll = 0;        ///< of upper arms, forearms and hands
    bool hips_as_world = false; ///< the root has the world's axes
};

/// Local axes of each joint while the sample is in its rest pose.
inline std::vector<mat3<double>> axes_along_bones(const SampleRig& sample, const BoneAxes& o = {}) {
    std::vector<mat3<double>> axes;
    for (std::size_t j = 0; j < sample.names.size(); ++j) {
        const std::string& part = sample.parts[j];
        vec3<double> d(0, 1, 0);
        for (std::size_t c = 0; c < sample.names.size(); ++c)
            if (sample.parents[c] == static_cast<int>(j) && part.find('_') != std::string::npos) {
                d = normalize(sample.rest[c] - sample.rest[j]);
                break;
            }
        if (o.mirrored && part.starts_with("right_")) d = d * -1.0;
        vec3<double> z(0, 0, 1);
        if (std::abs(d.z) > 0.8) z = {0, 1, 0};
        const vec3<double> y = normalize(cross(z, d));
        const mat3<double> along(d, y, cross(d, y));
        const bool arm = part.ends_with("shoulder") || part.ends_with("elbow") || part.ends_with("wrist");
        const bool trunk = part.starts_with("spine") || part == "neck" || part == "head";
        axes.push_back(j == 0 && o.hips_as_world ? mat3<double>(1.0)
                                                 : along * turn_about(0, arm     ? o.arm_roll
                                                                         : trunk ? o.spine_roll
                                                                                 : 0));
    }
    return axes;
}

/// The same motion of a rig whose joints have the given axes while `rig` is at rest, and whose rest pose is that of
/// zero angles, as in BVH: with axes along the bones, these lie on a heap.
inline RigMotion with_axes(const RigMotion& rig, const std::vector<mat3<double>>& axes) {
    RigMotion other = rig;
    const std::size_t J = rig.joint_count();
    for (std::size_t i = 0; i < rig.rotations.size(); ++i) other.rotations[i] = rig.rotations[i] * axes[i % J];
    for (std::size_t j = 0; j < J; ++j) {
        other.rest_rotations[j] = mat3<double>(1.0);
        if (rig.parents[j] < 0) continue;
        const auto p = static_cast<std::size_t>(rig.parents[j]);
        other.rest_joints[j] = other.rest_joints[p] + transpose(axes[p]) * (rig.rest_joints[j] - rig.rest_joints[p]);
    }
    return other;
}

} // namespace gsh::test
