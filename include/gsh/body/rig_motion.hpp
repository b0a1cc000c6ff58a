// SPDX-License-Identifier: Apache-2.0
/// @file  The motion of any skeleton: names, parents, a rest pose, and the joints' world frames over time.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// What readers of BVH, glTF and SAM 3D Body make, and what `retarget` turns into a Motion of a body.
///
/// Shapes  given at each member; J joints, T frames.
/// Frame   right-handed, y up. The rest pose may face anywhere and may have any axes: only its difference from the
///         frames, rotations[t, j] rest_rotations[j]⁻¹, and the directions of its bones are used.
/// Units   metres, seconds.
struct RigMotion {
    std::vector<std::string> names;           // [J], each once
    std::vector<int> parents;                 // [J], -1 for a root; a parent precedes its children
    std::vector<vec3<double>> rest_joints;    // [J] world positions in the rest pose
    std::vector<mat3<double>> rest_rotations; // [J] world_from_joint in the rest pose
    std::vector<vec3<double>> joints;         // [T, J] world positions; the hips' are the root's path
    std::vector<mat3<double>> rotations;      // [T, J] world_from_joint
    std::vector<double> timestamps;           // [T]

    [[nodiscard]] std::size_t joint_count() const { return names.size(); }
    [[nodiscard]] std::size_t frame_count() const { return timestamps.size(); }
    [[nodiscard]] const vec3<double>& joint(std::size_t frame, int j) const {
        return joints[frame * names.size() + static_cast<std::size_t>(j)];
    }
    [[nodiscard]] const mat3<double>& rotation(std::size_t frame, int j) const {
        return rotations[frame * names.size() + static_cast<std::size_t>(j)];
    }
};

/// Throws ShapeError or ValueError at the first inconsistency: sizes, no frames, a name twice, a child before its
/// parent, NaN, a coordinate beyond 1e30, a matrix that is not a rotation within 1e-3.
inline void validate(const RigMotion& rig, std::string_view where);

/// Throws ValueError if a motion of that many joints and frames would take more than 1.6 GB. Readers call it before
/// they allocate.
inline void check_rig_size(std::string_view where, std::size_t joints, std::size_t frames);

/// Moves a rig to another world: a point at x moves to `scale` A x. A is a rotation.
inline void move_rig(RigMotion& rig, const mat3<double>& A, double scale = 1);

/// A body's skeleton and its motion, with the joint names of the SMPL family. Rest rotations are the axes. The shape is
/// the motion's; expressions have no place in a rig.
///
/// Errors  those of validate(motion, model).
[[nodiscard]] inline RigMotion rig_of_motion(const BodyModel& model, const Motion& motion);

// -------------------------------------------------------------------------------------------------------------

inline void check_rig_size(std::string_view where, std::size_t joints, std::size_t frames) {
    constexpr std::size_t most = 16'000'000; // poses of a joint, 96 bytes each
    if (joints > 0 && frames > most / joints)
        throw ValueError(std::string(where) + ": holds " + std::to_string(frames) + " frames of " +
                         std::to_string(joints) + " joints, expected at most " + std::to_string(most / joints) +
                         " frames; cut the motion into parts");
}

inline void validate(const RigMotion& rig, std::string_view where) {
    const std::size_t J = rig.joint_count(), T = rig.frame_count();
    check_value(J > 0, where, "holds no joints");
    check_value(T > 0, where, "holds no frames");
    check_size(where, "parents", rig.parents.size(), J, "store one per joint");
    check_size(where, "rest_joints", rig.rest_joints.size(), J, "store one per joint");
    check_size(where, "rest_rotations", rig.rest_rotations.size(), J, "store one per joint");
    check_size(where, "joints", rig.joints.size(), T * J, "store one per frame and joint");
    check_size(where, "rotations", rig.rotations.size(), T * J, "store one per frame and joint");
    std::set<std::string_view> seen;
    for (std::size_t j = 0; j < J; ++j) {
        check_value(seen.insert(rig.names[j]).second, where,
                    "has the joint '" + detail::shortened(rig.names[j]) + "' twice, expected each name once");
        check_value(rig.parents[j] >= -1 && rig.parents[j] < static_cast<int>(j), where,
                    "joint '" + detail::shortened(rig.names[j]) + "' has parent " + std::to_string(rig.parents[j]) +
                        ", expected -1 or a joint before it");
    }
    detail::check_coordinates(where, "rest_joints", rig.rest_joints);
    detail::check_coordinates(where, "joints", rig.joints);
    check_finite<double>(where, "timestamps", rig.timestamps);
    const auto check_rotations = [&](const char* argument, const std::vector<mat3<double>>& rotations) {
        for (std::size_t i = 0; i < rotations.size(); ++i)
            if (!is_rotation(rotations[i], 1e-3)) // false for NaN
                throw ValueError(std::string(where) + ": " + argument + " of joint '" +
                                 detail::shortened(rig.names[i % J]) + "', frame " + std::to_string(i / J) +
                                 ", is not a rotation (orthonormal, determinant +1)");
    };
    check_rotations("rest_rotations", rig.rest_rotations);
    check_rotations("rotations", rig.rotations);
}

inline void move_rig(RigMotion& rig, const mat3<double>& A, double scale) {
    check_value(is_rotation(A, 1e-6), "move_rig", "A is not a rotation (orthonormal, determinant +1)");
    for (auto& x : rig.rest_joints) x = A * x * scale;
    for (auto& x : rig.joints) x = A * x * scale;
    for (auto& R : rig.rest_rotations) R = A * R;
    for (auto& R : rig.rotations) R = A * R;
}

inline RigMotion rig_of_motion(const BodyModel& model, const Motion& motion) {
    validate(motion, model, "rig_of_motion");
    const std::size_t J = model.joint_count(), T = motion.frame_count();
    check_rig_size("rig_of_motion", J, T);
    RigMotion rig;
    rig.names = joint_names_of(model);
    rig.parents = model.parents;
    rig.rest_joints = regress_joints(model, shaped_vertices(model, motion.betas));
    rig.rest_rotations.assign(J, mat3<double>(1.0));
    rig.joints.reserve(T * J);
    rig.rotations.reserve(T * J);
    rig.timestamps = motion.timestamps;
    for (std::size_t t = 0; t < T; ++t)
        for (std::size_t j = 0; j < J; ++j) {
            const mat3<double> local = rotation_from_axis_angle(motion.pose_at(t)[j]);
            if (rig.parents[j] < 0) {
                rig.joints.push_back(rig.rest_joints[j] + motion.transl[t]);
                rig.rotations.push_back(local);
                continue;
            }
            const auto p = static_cast<std::size_t>(rig.parents[j]);
            const mat3<double> parent = rig.rotations[t * J + p];
            rig.joints.push_back(rig.joints[t * J + p] + parent * (rig.rest_joints[j] - rig.rest_joints[p]));
            rig.rotations.push_back(parent * local);
        }
    return rig;
}

} // namespace gsh
