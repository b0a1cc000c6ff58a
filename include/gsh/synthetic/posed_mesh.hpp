// SPDX-License-Identifier: Apache-2.0
/// @file  A body model's vertices in a frame of a motion: shape, expression, kinematics and skinning on the host.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/math/rotation.hpp>

#include <cstddef>
#include <vector>

namespace gsh {

/// Poses one body again and again; pose blend shapes are left out, the actor has none.
class MeshPoser {
public:
    /// Keeps a reference to the model.
    explicit MeshPoser(const BodyModel& model)
        : model_(&model), skin_(sparse_weights(model.weights, model.joint_count())) {}

    /// World positions [V] in a frame.
    /// Errors  ShapeError if the motion is not for this body.
    [[nodiscard]] std::vector<vec3<double>> vertices(const Motion& motion, std::size_t frame) const {
        const std::size_t J = model_->joint_count();
        check_size("MeshPoser", "motion.joint_count", motion.joint_count, J, "use a motion for this body");
        check_size("MeshPoser", "motion.pose", motion.pose.size(), motion.frame_count() * J);
        std::vector<vec3<double>> points = shaped_vertices(*model_, motion.betas, motion.expression_at(frame));
        const std::vector<vec3<double>> joints = regress_joints(*model_, points);
        std::vector<mat3<double>> rotations;
        for (const auto& axis_angle : motion.pose_at(frame)) rotations.push_back(rotation_from_axis_angle(axis_angle));
        std::vector<Affine<double>> bones(J);
        bone_transforms<double>(model_->parents, rotations, joints, motion.transl[frame], bones);
        const SkinWeights<double> skin = skin_.view();
        for (std::size_t v = 0; v < points.size(); ++v) points[v] = blend<double>(skin, v, bones)(points[v]);
        return points;
    }

private:
    const BodyModel* model_;
    SkinWeightTable<double> skin_;
};

} // namespace gsh
