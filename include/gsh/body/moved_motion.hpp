// SPDX-License-Identifier: Apache-2.0
/// @file  Motions under a rigid change of the world frame, and their alignment with the y axis.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/signed_axis.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <optional>
#include <string>

namespace gsh {

/// Rest position J₀ of the root joint, the centre of the root's rotation. Evaluates only the vertices of its regressor.
///
/// Errors  ShapeError for more coefficients than the body has directions.
[[nodiscard]] inline vec3<double> root_joint(const BodyModel& model, Span<const double> betas,
                                             Span<const double> expression = {});

/// Transforms one frame of a motion to another world frame: a posed point at x moves to new_from_old(x).
///
///     R' = A R,   t' = A (J₀ + t) + a - J₀   for new_from_old(x) = A x + a,
///
/// because the body rotates about J₀ and not about the origin.
///
/// Errors  ValueError unless A is a rotation (a reflection would need a mirrored body).
inline void move_frame(const BodyModel& model, Motion& motion, std::size_t frame, const Affine<double>& new_from_old);

/// The rotation to a world in which y points up: it turns the coordinate axis along which the body stands, on average
/// over the frames, to +y. Nothing if no coordinate axis qualifies, as for motions on the floor or somersaults.
[[nodiscard]] inline std::optional<mat3<double>> upright_rotation(const Motion& motion);

// -------------------------------------------------------------------------------------------------------------

inline vec3<double> root_joint(const BodyModel& model, Span<const double> betas, Span<const double> expression) {
    const auto S = static_cast<std::size_t>(model.shape_count), E = static_cast<std::size_t>(model.expression_count);
    detail::check_coefficients("root_joint", "betas", betas.size(), S);
    detail::check_coefficients("root_joint", "expression", expression.size(), E);
    check_value(!model.J_regressor.empty(), "root_joint", "the body has no joints");
    vec3<double> joint(0);
    for (const auto& [vertex, weight] : model.J_regressor[0]) {
        const auto v = static_cast<std::size_t>(vertex);
        vec3<double> position = model.v_template[v];
        for (std::size_t k = 0; k < betas.size(); ++k) position += model.shapedirs[v * S + k] * betas[k];
        for (std::size_t k = 0; k < expression.size(); ++k) position += model.exprdirs[v * E + k] * expression[k];
        joint += position * weight;
    }
    return joint;
}

inline void move_frame(const BodyModel& model, Motion& motion, std::size_t frame, const Affine<double>& new_from_old) {
    const mat3<double>& A = new_from_old.linear;
    check_value(
        is_rotation(A, 1e-3), "move_frame",
        "the change of frame is not a rotation (orthonormal, determinant +1); a mirrored world needs a mirrored body");
    check_value(frame < motion.frame_count(), "move_frame",
                "frame " + std::to_string(frame) + " is not below " + std::to_string(motion.frame_count()));
    const vec3<double> J0 = root_joint(model, motion.betas, motion.expression_at(frame));
    vec3<double>& root = motion.pose[frame * motion.joint_count];
    root = axis_angle_from_rotation(A * rotation_from_axis_angle(root));
    motion.transl[frame] = new_from_old(J0 + motion.transl[frame]) - J0;
}

inline std::optional<mat3<double>> upright_rotation(const Motion& motion) {
    if (motion.frame_count() == 0) return std::nullopt;
    vec3<double> up(0);
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        up += rotation_from_axis_angle(motion.pose_at(t)[0])[1] / static_cast<double>(motion.frame_count());
    const auto axis = signed_axis_along(up, 0.6);
    if (!axis) return std::nullopt;
    return turn_to_y(*axis);
}

} // namespace gsh
