// SPDX-License-Identifier: Apache-2.0
/// @file  The bone transforms of a motion, frame by frame, on the host.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <vector>

namespace gsh {

/// Calls visit(frame, bones [J], rest [J]) for each frame, with the motion's own betas and expressions:
/// bones[j](rest[j]) is joint j in the world.
///
/// Errors  those of validate(Motion).
template <class Visit>
void for_each_pose(const BodyModel& model, const Motion& motion, const Visit& visit) {
    validate(motion, model, "for_each_pose");
    const std::size_t J = model.joint_count(), E = static_cast<std::size_t>(model.expression_count);
    const auto shaped = regress_joints(model, shaped_vertices(model, motion.betas));
    const auto directions =
        motion.expression_count ? joint_directions(model, model.exprdirs) : std::vector<vec3<double>>();
    std::vector<vec3<double>> rest(J);
    std::vector<mat3<double>> rotations(J);
    std::vector<Affine<double>> bones(J);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) {
        for (std::size_t j = 0; j < J; ++j) {
            rest[j] = shaped[j];
            for (std::size_t k = 0; k < motion.expression_count; ++k)
                rest[j] += directions[j * E + k] * motion.expression_at(t)[k];
            rotations[j] = rotation_from_axis_angle(motion.pose_at(t)[j]);
        }
        bone_transforms<double>(model.parents, rotations, rest, motion.transl[t], bones);
        visit(t, Span<const Affine<double>>(bones), Span<const vec3<double>>(rest));
    }
}

} // namespace gsh
