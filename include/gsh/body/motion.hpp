// SPDX-License-Identifier: Apache-2.0
/// @file  Motions: body poses over time, and their conversion from other parametrisations.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// The motion of a body over T frames, stored on the host in double precision.
///
/// Shapes  given at each member; J joints, E expression coefficients, S shape coefficients.
/// Units   radians (axis times angle, relative to the parent joint), metres, seconds.
struct Motion {
    std::size_t joint_count = 0;      ///< J
    std::size_t expression_count = 0; ///< E
    std::vector<double> betas;        // [S], one shape for all frames
    std::vector<vec3<double>> pose;   // [T, J] axis-angle, mean hand already added
    std::vector<double> expression;   // [T, E]
    std::vector<vec3<double>> transl; // [T]
    std::vector<double> timestamps;   // [T]

    [[nodiscard]] std::size_t frame_count() const { return transl.size(); }
    [[nodiscard]] Span<const vec3<double>> pose_at(std::size_t frame) const {
        return Span<const vec3<double>>(pose).subspan(frame * joint_count, joint_count);
    }
    [[nodiscard]] Span<const double> expression_at(std::size_t frame) const {
        return Span<const double>(expression).subspan(frame * expression_count, expression_count);
    }
};

/// Throws ShapeError or ValueError unless the motion's arrays agree with each other and with the body: one pose per
/// frame and joint, no more coefficients than directions, no NaN. `where` appears in the message.
inline void validate(const Motion& motion, const BodyModel& model, std::string_view where);

/// A motion in the layout of the SMPL family's files: one array per part of the body, one row per frame. An empty part
/// is at rest.
///
/// Shapes  T rows each; body_pose 63 numbers for bodies of 52 or 55 joints, 3 (J - 1) for all others (SMPL: 69);
///         hands 45 numbers of axis-angle, or fewer principal components; alternatively all joints in `poses`, 3 J
///         numbers.
/// Units   radians, metres, seconds.
struct MotionParts {
    Span<const double> poses = {};           // [T, 3 J], instead of the parts
    Span<const double> global_orient = {};   // [T, 3]
    Span<const double> body_pose = {};       // [T, 63], [T, 69], …
    Span<const double> jaw_pose = {};        // [T, 3]
    Span<const double> leye_pose = {};       // [T, 3]
    Span<const double> reye_pose = {};       // [T, 3]
    Span<const double> left_hand_pose = {};  // [T, 45], or [T, components]
    Span<const double> right_hand_pose = {}; // [T, 45], or [T, components]
    Span<const double> expression = {};      // [T, E]
    Span<const double> transl = {};          // [T, 3]
    Span<const double> timestamps = {};      // [T]; empty: frame / frames_per_second
    Span<const double> betas = {};           // [S]
    std::size_t frame_count = 0;             ///< T; 0: taken from poses or global_orient
    double frames_per_second = 30;
    bool flat_hand = false;       ///< the hand pose is relative to the flat hand: the body's mean hand is not added
    bool hand_components = false; ///< 45 hand numbers are principal components (fewer than 45 always are)
};

/// Assembles the parts in the body's joint order: root, body, jaw, left eye, right eye, left hand, right hand for 55
/// joints (SMPL-X); root, body, left hand, right hand for 52 (SMPL-H); root, body for all others.
///
/// Errors  ShapeError if a part has the wrong size or does not exist in this body, or if frames are missing.
[[nodiscard]] inline Motion assemble_motion(const BodyModel& model, const MotionParts& parts);

/// Axis-angle vectors from Euler angles in radians; the order names the factors, as in rotation_from_euler.
[[nodiscard]] inline std::vector<vec3<double>> axis_angles_from_euler(Span<const vec3<double>> angles,
                                                                      EulerOrder order);
/// Axis-angle vectors from quaternions of any length but zero.
[[nodiscard]] inline std::vector<vec3<double>> axis_angles_from_quats(Span<const quat<double>> quats);
/// Axis-angle vectors from rotation matrices. Throws ValueError for a matrix that is not a rotation within 1e-3.
[[nodiscard]] inline std::vector<vec3<double>> axis_angles_from_matrices(Span<const mat3<double>> rotations);

// -------------------------------------------------------------------------------------------------------------

inline void validate(const Motion& motion, const BodyModel& model, std::string_view where) {
    const std::size_t T = motion.frame_count(), J = model.joint_count();
    check_size(where, "joints of a pose", motion.joint_count, J, "the motion was made for another body");
    check_size(where, "pose", motion.pose.size(), T * J, "store one vector per frame and joint");
    check_size(where, "expression", motion.expression.size(), T * motion.expression_count, "store one row per frame");
    check_size(where, "timestamps", motion.timestamps.size(), T, "store one per frame");
    detail::check_coefficients(where, "betas", motion.betas.size(), static_cast<std::size_t>(model.shape_count));
    detail::check_coefficients(where, "a row of expression", motion.expression_count,
                               static_cast<std::size_t>(model.expression_count));
    detail::check_coordinates(where, "pose", motion.pose);
    detail::check_coordinates(where, "transl", motion.transl);
    detail::check_magnitude(where, "betas", motion.betas);
    detail::check_magnitude(where, "expression", motion.expression);
    check_finite<double>(where, "timestamps", motion.timestamps);
}

namespace detail {

/// Copies [frames, width] numbers into consecutive joints of a motion, from `first_joint` on.
inline void place_joints(Motion& motion, Span<const double> numbers, std::size_t width, std::size_t first_joint) {
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        for (std::size_t n = 0; n < width; ++n)
            motion.pose[t * motion.joint_count + first_joint + n / 3][static_cast<int>(n % 3)] = numbers[t * width + n];
}

/// Writes one hand's joints from axis-angle numbers or principal components, and adds the mean hand unless flat_hand.
inline void place_hand(Motion& motion, std::string_view part, Span<const double> numbers, const MotionParts& parts,
                       const std::vector<vec3<double>>& mean, const std::vector<double>& components,
                       std::size_t first_joint) {
    constexpr auto where = "assemble_motion";
    constexpr std::size_t full = 45;
    const std::size_t T = motion.frame_count();
    if (!numbers.empty()) {
        const std::size_t width = numbers.size() / T;
        check_size(where, part, numbers.size(), T * width, "store one row per frame");
        if (width == full && !parts.hand_components) {
            place_joints(motion, numbers, full, first_joint);
        } else {
            if (width * full > components.size())
                throw ShapeError(std::string(where) + ": " + std::string(part) + " has " + std::to_string(width) +
                                 " numbers a frame, expected 45, or at most " +
                                 std::to_string(components.size() / full) + " principal components of this body");
            std::vector<double> unfolded(T * full, 0);
            for (std::size_t t = 0; t < T; ++t)
                for (std::size_t c = 0; c < width; ++c)
                    for (std::size_t n = 0; n < full; ++n)
                        unfolded[t * full + n] += numbers[t * width + c] * components[c * full + n];
            place_joints(motion, unfolded, full, first_joint);
        }
    }
    if (!parts.flat_hand && !mean.empty())
        for (std::size_t t = 0; t < T; ++t)
            for (std::size_t j = 0; j < mean.size(); ++j)
                motion.pose[t * motion.joint_count + first_joint + j] += mean[j];
}

} // namespace detail

inline Motion assemble_motion(const BodyModel& model, const MotionParts& parts) {
    constexpr auto where = "assemble_motion";
    const std::size_t J = model.joint_count();
    std::size_t T = parts.frame_count;
    if (T == 0) T = parts.poses.empty() || J == 0 ? parts.global_orient.size() / 3 : parts.poses.size() / (3 * J);
    check_value(T > 0, where, "there are no frames; give poses, global_orient or frame_count");

    Motion motion;
    motion.joint_count = J;
    motion.betas.assign(parts.betas.begin(), parts.betas.end());
    motion.pose.assign(T * J, vec3<double>(0));
    motion.transl.assign(T, vec3<double>(0));
    motion.expression_count = parts.expression.size() / T;
    motion.expression.assign(parts.expression.begin(), parts.expression.end());
    const auto place = [&](const char* part, Span<const double> numbers, std::size_t width, std::size_t first_joint,
                           bool has_it) {
        if (numbers.empty()) return;
        check_value(has_it, where,
                    std::string(part) + " is given, but a body of " + std::to_string(J) + " joints has no such part");
        check_size(where, part, numbers.size(), T * width, "one row per frame");
        detail::place_joints(motion, numbers, width, first_joint);
    };
    const bool face = J == 55, hands = face || J == 52;
    const std::size_t body_joints = hands ? 21 : J - 1, left = face ? 25 : 22;
    if (!parts.poses.empty()) {
        place("poses", parts.poses, 3 * J, 0, true);
        if (hands && !parts.flat_hand) {
            detail::place_hand(motion, "hands_mean_left", {}, parts, model.hands_mean_left, {}, left);
            detail::place_hand(motion, "hands_mean_right", {}, parts, model.hands_mean_right, {}, left + 15);
        }
    } else {
        place("global_orient", parts.global_orient, 3, 0, true);
        place("body_pose", parts.body_pose, 3 * body_joints, 1, true);
        place("jaw_pose", parts.jaw_pose, 3, 22, face);
        place("leye_pose", parts.leye_pose, 3, 23, face);
        place("reye_pose", parts.reye_pose, 3, 24, face);
        check_value(hands || (parts.left_hand_pose.empty() && parts.right_hand_pose.empty()), where,
                    "a hand pose is given, but only bodies of 52 or 55 joints have hands of 15 joints");
        if (hands) {
            detail::place_hand(motion, "left_hand_pose", parts.left_hand_pose, parts, model.hands_mean_left,
                               model.hands_components_left, left);
            detail::place_hand(motion, "right_hand_pose", parts.right_hand_pose, parts, model.hands_mean_right,
                               model.hands_components_right, left + 15);
        }
    }
    if (!parts.transl.empty()) {
        check_size(where, "transl", parts.transl.size(), 3 * T, "one row per frame");
        for (std::size_t n = 0; n < 3 * T; ++n) motion.transl[n / 3][static_cast<int>(n % 3)] = parts.transl[n];
    }
    if (parts.timestamps.empty())
        check_value(parts.frames_per_second > 0, where, "frames_per_second must be positive");
    else
        check_size(where, "timestamps", parts.timestamps.size(), T, "one per frame");
    for (std::size_t t = 0; t < T; ++t)
        motion.timestamps.push_back(parts.timestamps.empty() ? static_cast<double>(t) / parts.frames_per_second
                                                             : parts.timestamps[t]);
    validate(motion, model, where);
    return motion;
}

inline std::vector<vec3<double>> axis_angles_from_euler(Span<const vec3<double>> angles, EulerOrder order) {
    std::vector<vec3<double>> result;
    for (const auto& a : angles) result.push_back(axis_angle_from_rotation(rotation_from_euler(a, order)));
    return result;
}

inline std::vector<vec3<double>> axis_angles_from_quats(Span<const quat<double>> quats) {
    std::vector<vec3<double>> result;
    for (const auto& q : quats) {
        const double squared = dot(q, q);
        check_value(squared > 0 && std::isfinite(squared), "axis_angles_from_quats",
                    "a quaternion is zero or not finite, expected a direction");
        result.push_back(axis_angle_from_rotation(rotation_from_quat(q)));
    }
    return result;
}

inline std::vector<vec3<double>> axis_angles_from_matrices(Span<const mat3<double>> rotations) {
    std::vector<vec3<double>> result;
    for (const auto& R : rotations) {
        const mat3<double> product = transpose(R) * R;
        bool rotation = std::abs(determinant(R) - 1) < 1e-3;
        for (int c = 0; c < 3; ++c)
            for (int r = 0; r < 3; ++r) rotation = rotation && std::abs(product[c][r] - (r == c ? 1 : 0)) < 1e-3;
        check_value(rotation, "axis_angles_from_matrices",
                    "a matrix is not a rotation; its columns must be orthonormal and right-handed");
        result.push_back(axis_angle_from_rotation(R));
    }
    return result;
}

} // namespace gsh
