// SPDX-License-Identifier: Apache-2.0
/// @file  Compares a retargeted motion with the sample that it came from: directions of limbs, hips, sides.
#pragma once

#include "support/sample_rig.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// The posed joints of a body in a frame, by products of rotations along the tree.
inline SamplePose pose_of(const BodyModel& body, const Motion& motion, std::size_t frame) {
    const auto rest = regress_joints(body, shaped_vertices(body, motion.betas));
    SamplePose pose;
    for (std::size_t j = 0; j < body.joint_count(); ++j) {
        const mat3<double> local = rotation_from_axis_angle(motion.pose_at(frame)[j]);
        const int p = body.parents[j];
        const auto parent = static_cast<std::size_t>(p < 0 ? 0 : p);
        pose.joints.push_back(p < 0 ? rest[j] + motion.transl[frame]
                                    : pose.joints[parent] + pose.rotations[parent] * (rest[j] - rest[parent]));
        pose.rotations.push_back(p < 0 ? local : pose.rotations[parent] * local);
    }
    return pose;
}

inline double degrees_between(const vec3<double>& a, const vec3<double>& b) {
    return std::atan2(length(cross(a, b)), dot(a, b)) * 57.295779513082323;
}

/// The largest differences over all frames.
struct RetargetErrors {
    double limbs = 0;  ///< degrees, thighs, shins, upper arms, forearms, and fingers where the sample has them
    double trunk = 0;  ///< degrees, between the turns of hips and chest from the rest pose
    double hips = 0;   ///< metres, of the hips' way from the first frame, in proportion to their heights
    double ankles = 0; ///< metres, of the ankles' height in the rest pose from that above the body's own soles
    double left = 1;   ///< smallest cosine between the lines from right to left hip
};

/// `names` are those of the body's joints.
inline RetargetErrors compare(const SampleRig& sample, const std::string& order, const SampleOptions& o,
                              const Motion& motion, const BodyModel& body, const std::vector<std::string>& names) {
    RetargetErrors errors;
    const mat3<double> y_up = o.z_up ? turn_about(0, -1.5707963267948966) : mat3<double>(1.0);
    const auto own = [&](const std::string& part) {
        return static_cast<std::size_t>(std::find(names.begin(), names.end(), part) - names.begin());
    };
    const auto source = [&](const std::string& part) { return static_cast<std::size_t>(sample.joint(part)); };
    const auto height = [](const auto& joints, const auto& at, const vec3<double>& up) {
        const auto segment = [&](const char* a, const char* b) { return length(joints[at(a)] - joints[at(b)]); };
        return segment("left_hip", "left_knee") + segment("left_knee", "left_ankle") +
               dot(joints[at("pelvis")] - joints[at("left_hip")], up);
    };
    const auto rest = regress_joints(body, shaped_vertices(body, motion.betas));
    const double own_height = height(rest, own, vec3<double>(0, 1, 0));
    const double ratio = own_height / height(sample.rest, source, sample.world_from_person * vec3<double>(0, 1, 0));
    std::vector<std::pair<std::string, std::string>> bones = {
        {"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}};
    if (o.fingers && own("left_index1") < names.size())
        bones.insert(bones.end(), {{"wrist", "middle1"},
                                   {"middle1", "middle2"},
                                   {"index1", "index2"},
                                   {"index2", "index3"},
                                   {"thumb1", "thumb2"}});
    vec3<double> raised(0);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        const SamplePose posed = pose_of(sample, t, order), result = pose_of(body, motion, t);
        for (const std::string side : {"left_", "right_"})
            for (const auto& [from, to] : bones) {
                const vec3<double> wanted =
                    y_up * (posed.joints[source(side + to)] - posed.joints[source(side + from)]);
                const vec3<double> found = result.joints[own(side + to)] - result.joints[own(side + from)];
                errors.limbs = std::max(errors.limbs, degrees_between(wanted, found));
            }
        // The chest is the joint that carries the arms: the last of the spine, whatever its number.
        const std::string chest = "spine" + std::to_string(o.spine);
        for (const auto& [part, target] :
             {std::pair<std::string, std::string>{"pelvis", "pelvis"}, {chest, "spine3"}}) {
            const mat3<double> wanted = y_up * posed.rotations[source(part)] * sample.world_from_person;
            for (int k = 0; k < 3; ++k)
                errors.trunk = std::max(errors.trunk, degrees_between(wanted[k], result.rotations[own(target)][k]));
        }
        const vec3<double> offset = result.joints[own("pelvis")] - y_up * posed.joints[0] * ratio;
        if (t == 0) raised = {0, offset.y, 0}; // ankles are not equally high
        errors.hips = std::max(errors.hips, length(offset - raised));
        const vec3<double> side = y_up * (posed.joints[source("left_hip")] - posed.joints[source("right_hip")]);
        errors.left =
            std::min(errors.left,
                     dot(normalize(side), normalize(result.joints[own("left_hip")] - result.joints[own("right_hip")])));
        if (t == 0) {
            double sole = rest[own("left_ankle")].y;
            for (const auto& v : shaped_vertices(body, motion.betas)) sole = std::min(sole, v.y);
            errors.ankles = std::abs(result.joints[own("left_ankle")].y - (rest[own("left_ankle")].y - sole));
        }
    }
    return errors;
}

} // namespace gsh::test
