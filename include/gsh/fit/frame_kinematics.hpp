// SPDX-License-Identifier: Apache-2.0
/// @file  Where a posed body's landmarks are, and how they move with the numbers of its pose and shape.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/pose_axes.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// The numbers of a body in one frame.
struct FrameNumbers {
    mat3<double> root{1.0};
    vec3<double> transl{0};
    std::vector<double> angles; // [A] one for each PoseAxis
};

/// A body as a motion is fitted to it: its joints at rest, how they follow the shape, and its axes.
struct FittedBody {
    std::vector<int> parents;             // [J]
    std::vector<vec3<double>> joints;     // [J] at rest, mean shape
    std::vector<vec3<double>> directions; // [J, S] their change per unit of each shape coefficient
    std::vector<PoseAxis> axes;           // [A]
    Landmarks marks;                      ///< joints are the body's, or -1
    std::size_t limb_axes = 0;            ///< the axes before those of fingers
    int shape_count = 0;                  ///< S

    /// Uses the first `most_betas` shape directions.
    explicit FittedBody(const BodyModel& body, int most_betas, const Landmarks& places = default_landmarks())
        : parents(body.parents), joints(regress_joints(body, body.v_template)), axes(pose_axes(body, joints)),
          marks(landmarks_of(body, places)), shape_count(std::min(most_betas, body.shape_count)) {
        while (limb_axes < axes.size() && !axes[limb_axes].finger) ++limb_axes;
        fingers_.assign(joints.size(), false);
        for (const PoseAxis& axis : axes)
            if (axis.finger) fingers_[static_cast<std::size_t>(axis.joint)] = true;
        const auto all = joint_directions(body, body.shapedirs);
        for (std::size_t j = 0; j < joints.size(); ++j)
            for (int k = 0; k < shape_count; ++k)
                directions.push_back(all[j * static_cast<std::size_t>(body.shape_count) + static_cast<std::size_t>(k)]);
    }

    /// Numbers of a frame: turn of the root, translation, angles.
    [[nodiscard]] std::size_t number_count() const { return 6 + axes.size(); }

    /// Whether a joint moves when fingers do: all of their joints but the knuckles.
    [[nodiscard]] bool follows_finger(int joint) const {
        const int parent = parents[static_cast<std::size_t>(joint)];
        return parent >= 0 && fingers_[static_cast<std::size_t>(parent)];
    }

    /// The joints of a shape at rest.
    [[nodiscard]] std::vector<vec3<double>> rest_joints(Span<const double> betas) const {
        const auto S = static_cast<std::size_t>(shape_count);
        std::vector<vec3<double>> rest = joints;
        for (std::size_t j = 0; j < rest.size(); ++j)
            for (std::size_t k = 0; k < S; ++k) rest[j] += directions[j * S + k] * betas[k];
        return rest;
    }

    /// The axis-angle vectors of all joints but the root.
    [[nodiscard]] std::vector<vec3<double>> pose(Span<const double> angles) const {
        std::vector<vec3<double>> result(parents.size(), vec3<double>(0));
        for (std::size_t a = 0; a < axes.size(); ++a)
            result[static_cast<std::size_t>(axes[a].joint)] += axes[a].axis * angles[a];
        return result;
    }

private:
    std::vector<bool> fingers_; // [J]
};

/// The joints of a frame in the world, with what their derivatives need.
///
/// The root turns by R exp([d]x), so its axes are the columns of R.
class FrameKinematics {
public:
    FrameKinematics(const FittedBody& body, const FrameNumbers& numbers, Span<const double> betas)
        : body_(&body), rotations_(body.parents.size()), joints_(body.parents.size()),
          directions_(body.directions.size()) {
        twists_.reserve(body.number_count());
        const std::size_t J = body.parents.size(), S = static_cast<std::size_t>(body.shape_count);
        const std::vector<vec3<double>> pose = body.pose(numbers.angles);
        const std::vector<vec3<double>> rest = body.rest_joints(betas);
        std::vector<mat3<double>> jacobians(J, mat3<double>(1.0));
        for (std::size_t j = 0; j < J; ++j) {
            if (body.parents[j] < 0) {
                rotations_[j] = numbers.root, joints_[j] = rest[j] + numbers.transl;
                for (std::size_t k = 0; k < S; ++k) directions_[j * S + k] = body.directions[j * S + k];
                continue;
            }
            const auto p = static_cast<std::size_t>(body.parents[j]);
            rotations_[j] = rotations_[p] * rotation_from_axis_angle(pose[j]);
            jacobians[j] = rotations_[p] * axis_angle_jacobian(pose[j]);
            joints_[j] = joints_[p] + rotations_[p] * (rest[j] - rest[p]);
            for (std::size_t k = 0; k < S; ++k)
                directions_[j * S + k] =
                    directions_[p * S + k] + rotations_[p] * (body.directions[j * S + k] - body.directions[p * S + k]);
        }
        const auto add_turn = [&](const vec3<double>& axis, const vec3<double>& center) {
            const vec3<double> shift = cross(center, axis); // axis × (x - center)
            twists_.push_back((Twist() << axis.x, axis.y, axis.z, shift.x, shift.y, shift.z).finished());
        };
        for (int k = 0; k < 3; ++k) add_turn(numbers.root[k], joints_[0]);
        for (int k = 0; k < 3; ++k) twists_.push_back(Twist::Unit(3 + k));
        for (const PoseAxis& axis : body.axes) {
            const auto j = static_cast<std::size_t>(axis.joint);
            add_turn(jacobians[j] * axis.axis, joints_[j]);
        }
    }

    [[nodiscard]] const mat3<double>& rotation(std::size_t joint) const { return rotations_[joint]; }
    [[nodiscard]] const vec3<double>& joint(std::size_t joint) const { return joints_[joint]; }

    /// A point that lies at `offset` from its joint at rest.
    [[nodiscard]] vec3<double> point(std::size_t joint, const vec3<double>& offset) const {
        return joints_[joint] + rotations_[joint] * offset;
    }

    [[nodiscard]] vec3<double> landmark(int number) const {
        const Landmark& mark = body_->marks[static_cast<std::size_t>(number)];
        return point(static_cast<std::size_t>(mark.joint), mark.offset);
    }

    /// How a joint's points move per unit of a number of its own or of a joint above: a point x moves by
    /// turn × x + shift. The first three numbers turn the root, the next three shift it; the others are angles.
    using Twist = Eigen::Matrix<double, 6, 1>; // (turn, shift)
    [[nodiscard]] const Twist& twist(std::size_t number) const { return twists_[number]; }
    /// The same motions seen from a point that is fixed to the root: the root turns about it and does not shift.
    [[nodiscard]] FrameKinematics about(const vec3<double>& center) const {
        FrameKinematics result = *this;
        for (std::size_t k = 0; k < 3; ++k) {
            const vec3<double> axis = rotations_[0][static_cast<int>(k)], shift = cross(center, axis);
            result.twists_[k] << axis.x, axis.y, axis.z, shift.x, shift.y, shift.z;
            result.twists_[3 + k].setZero();
        }
        return result;
    }
    /// The joint from which on a number moves the body.
    [[nodiscard]] std::size_t joint_of(std::size_t number) const {
        return number < 6 ? 0 : static_cast<std::size_t>(body_->axes[number - 6].joint);
    }
    /// How the joint follows a shape coefficient while the pose stays.
    [[nodiscard]] const vec3<double>& shape_direction(std::size_t joint, std::size_t k) const {
        return directions_[joint * static_cast<std::size_t>(body_->shape_count) + k];
    }
    /// Whether a joint is `below` or above it in the tree.
    [[nodiscard]] bool is_above(std::size_t joint, std::size_t below) const {
        while (below > joint) below = static_cast<std::size_t>(body_->parents[below]); // parents come first
        return below == joint;
    }

private:
    const FittedBody* body_;
    std::vector<mat3<double>> rotations_;  // [J] from the joint's frame to the world
    std::vector<vec3<double>> joints_;     // [J]
    std::vector<vec3<double>> directions_; // [J, S]
    std::vector<Twist> twists_;            // [6 + A]
};

} // namespace gsh
