// SPDX-License-Identifier: Apache-2.0
/// @file  A body evaluated in one pose on the host: a simple reference for the faster paths.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <vector>

namespace gsh {

/// A body's joints, bones and mesh in one pose, in the world.
struct PosedBody {
    std::vector<Affine<double>> bones;  // [J] world from canonical
    std::vector<vec3<double>> joints;   // [J]
    std::vector<vec3<double>> vertices; // [V]
};

/// Evaluates shape and expression, joints by the regressor, pose blend shapes from R - I, forward kinematics and linear
/// blend skinning, and adds transl.
///
/// Shapes  pose [J] axis-angle; betas and expression as for shaped_vertices; rest_joints [J], or empty for the
///         regressor's.
/// Units   radians, metres.
/// Errors  ShapeError if a size is wrong.
/// Source  Loper et al., "SMPL", 2015, equations 2 to 10; Pavlakos et al., "SMPL-X", 2019, equation 1.
[[nodiscard]] inline PosedBody pose_body(const BodyModel& model, Span<const vec3<double>> pose,
                                         const vec3<double>& transl = vec3<double>(0), Span<const double> betas = {},
                                         Span<const double> expression = {},
                                         Span<const vec3<double>> rest_joints = {}) {
    const std::size_t J = model.joint_count(), V = model.vertex_count(), P = model.pose_feature_count();
    check_size("pose_body", "pose", pose.size(), J, "store one axis-angle vector per joint");
    if (!rest_joints.empty()) check_size("pose_body", "rest_joints", rest_joints.size(), J);

    PosedBody body{std::vector<Affine<double>>(J), {}, shaped_vertices(model, betas, expression)};
    const std::vector<vec3<double>> joints = rest_joints.empty()
                                                 ? regress_joints(model, body.vertices)
                                                 : std::vector<vec3<double>>(rest_joints.begin(), rest_joints.end());
    std::vector<mat3<double>> rotations;
    std::vector<double> feature(P);
    for (std::size_t j = 0; j < J; ++j) {
        rotations.push_back(rotation_from_axis_angle(pose[j]));
        if (j > 0) pose_feature<double>(j, rotations[j], feature);
    }
    bone_transforms<double>(model.parents, rotations, joints, transl, body.bones);
    for (std::size_t j = 0; j < J; ++j) body.joints.push_back(body.bones[j](joints[j]));
    for (std::size_t v = 0; v < V; ++v) {
        vec3<double> point = body.vertices[v];
        if (!model.posedirs.empty())
            for (std::size_t k = 0; k < P; ++k) point += model.posedirs[v * P + k] * feature[k];
        Affine<double> blended = Affine<double>::zero();
        for (std::size_t j = 0; j < J; ++j)
            if (const double weight = model.weights[v * J + j]; weight != 0) blended.add_scaled(body.bones[j], weight);
        body.vertices[v] = blended(point);
    }
    return body;
}

} // namespace gsh
