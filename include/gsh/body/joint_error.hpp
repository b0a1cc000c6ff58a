// SPDX-License-Identifier: Apache-2.0
/// @file  Joint position errors between two motions, the measure for estimated poses.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_bones.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// The alignment applied before joints are compared.
enum class RootAlignment {
    none,     ///< none: the body's position counts
    position, ///< each frame is translated so that the roots coincide: the usual root-aligned error
    rotation, ///< each frame is also rotated so that the roots' orientations coincide: the limbs' own error
};

/// Distances between joints, in millimetres.
///
/// Shapes  per_joint [J] means over frames, including the root; per_frame: means over joints, one per compared frame.
struct JointErrors {
    double mean_mm = 0; ///< over frames and joints; 0 if there are none
    double worst_mm = 0;
    std::vector<double> per_joint_mm;
    std::vector<double> per_frame_mm;

    /// Mean over a subset of the joints, for instance those of one hand.
    [[nodiscard]] double mean_of_mm(Span<const std::size_t> joints) const {
        double sum = 0;
        for (const std::size_t joint : joints) {
            check_value(joint < per_joint_mm.size(), "JointErrors::mean_of_mm",
                        "joint " + std::to_string(joint) + " does not exist; the body has " +
                            std::to_string(per_joint_mm.size()) + " joints");
            sum += per_joint_mm[joint];
        }
        return joints.empty() ? 0 : sum / static_cast<double>(joints.size());
    }
};

/// World positions of a motion's joints, [T, J], with the motion's own betas and expressions.
///
/// Errors  those of validate(Motion).
[[nodiscard]] inline std::vector<vec3<double>> motion_joints(const BodyModel& model, const Motion& motion) {
    std::vector<vec3<double>> result;
    for_each_pose(model, motion, [&](std::size_t, Span<const Affine<double>> bones, Span<const vec3<double>> rest) {
        for (std::size_t j = 0; j < rest.size(); ++j) result.push_back(bones[j](rest[j]));
    });
    return result;
}

/// Mean per-joint position error between two motions of one body, frame by frame.
///
/// Each motion is posed with its own shape and expression. An avatar's learned joints are not used: both motions are
/// compared on the same model.
///
/// Shapes  frames: those to compare, or empty for all.
/// Errors  ShapeError if the motions differ in frames or are not of this body; ValueError for a frame out of range.
/// Source  MPJPE, Ionescu et al., "Human3.6M", 2014, §4. The mean includes the root, whose error is zero under
///         alignment.
[[nodiscard]] inline JointErrors joint_errors(const BodyModel& model, const Motion& motion, const Motion& truth,
                                              RootAlignment alignment = RootAlignment::position,
                                              Span<const std::size_t> frames = {}) {
    constexpr std::string_view where = "joint_errors";
    check_size(where, "frames of the motion", motion.frame_count(), truth.frame_count(), "compare the same frames");
    const std::vector<vec3<double>> found = motion_joints(model, motion), expected = motion_joints(model, truth);
    std::vector<std::size_t> compared(frames.begin(), frames.end());
    if (compared.empty())
        for (std::size_t t = 0; t < truth.frame_count(); ++t) compared.push_back(t);

    const std::size_t J = model.joint_count();
    JointErrors errors;
    errors.per_joint_mm.assign(J, 0);
    for (const std::size_t t : compared) {
        check_value(t < truth.frame_count(), where,
                    "frame " + std::to_string(t) + " does not exist; the motions have " +
                        std::to_string(truth.frame_count()) + " frames");
        mat3<double> turn(1.0);
        if (alignment == RootAlignment::rotation)
            turn = rotation_from_axis_angle(truth.pose_at(t)[0]) *
                   transpose(rotation_from_axis_angle(motion.pose_at(t)[0]));
        const vec3<double> here = alignment == RootAlignment::none ? vec3<double>(0) : found[t * J];
        const vec3<double> there = alignment == RootAlignment::none ? vec3<double>(0) : expected[t * J];
        double sum = 0;
        for (std::size_t j = 0; j < J; ++j) {
            const double error = 1000 * length(turn * (found[t * J + j] - here) - (expected[t * J + j] - there));
            errors.per_joint_mm[j] += error / static_cast<double>(compared.size());
            errors.worst_mm = std::max(errors.worst_mm, error);
            sum += error;
        }
        errors.per_frame_mm.push_back(sum / static_cast<double>(J));
        errors.mean_mm += errors.per_frame_mm.back() / static_cast<double>(compared.size());
    }
    return errors;
}

} // namespace gsh
