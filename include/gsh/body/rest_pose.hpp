// SPDX-License-Identifier: Apache-2.0
/// @file  Measures of a rig's pose: where it faces, how high its hips are, which unit it has.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <string_view>

namespace gsh {

/// The rotation of least angle that turns unit vector `from` to unit vector `to`; half a turn about an axis that is
/// perpendicular to both if they are opposite.
[[nodiscard]] inline mat3<double> shortest_turn(const vec3<double>& from, const vec3<double>& to);

/// The axes of a rig's rest pose: columns left, up, forward, from hips and upper arms. Axes within 25 degrees of a
/// coordinate axis are that axis, since no rig is modelled askew on purpose.
///
/// Errors  ValueError if hips and shoulders do not span a plane.
[[nodiscard]] inline mat3<double> facing(const RigMotion& rig, const MatchedJoints& matched, std::string_view where);

/// Height of the hips above the ankles in the rest pose with legs stretched: the length of the legs, and the height of
/// the hips' joint above those of the legs.
///
/// Errors  those of facing.
[[nodiscard]] inline double hip_height(const RigMotion& rig, const MatchedJoints& matched,
                                       std::string_view where = "hip_height");

/// A guess of the unit of lengths, from the legs: a person's are 0.3 to 3 m long.
struct LengthUnit {
    std::string_view name; ///< "centimetres"
    double metres = 1;     ///< per unit
    double leg = 0;        ///< length of the legs in that unit; 0: no legs were found
};
[[nodiscard]] inline LengthUnit guess_length_unit(const RigMotion& rig, const MatchedJoints& matched);

/// Scales the rest pose so that its legs are as long as in the first frame, for rest poses in a unit of their own.
/// Returns false, without a change, if no leg has a length in both.
inline bool fit_rest_to_frames(RigMotion& rig, const MatchedJoints& matched);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline int matched_joint(const MatchedJoints& matched, std::string_view joint) {
    return matched[static_cast<std::size_t>(smplx_joint(joint))];
}

/// The only child of a joint, or -1.
inline int only_child(const RigMotion& rig, int joint) {
    int child = -1;
    for (std::size_t j = 0; j < rig.joint_count(); ++j)
        if (rig.parents[j] == joint) {
            if (child >= 0) return -1;
            child = static_cast<int>(j);
        }
    return child;
}

/// The mean of the positions of a left and a right joint at `joints`, and their difference.
struct JointPair {
    vec3<double> mean{0.0}, left_from_right{0.0};

    JointPair(const vec3<double>* joints, const MatchedJoints& matched, std::string_view left, std::string_view right) {
        const vec3<double> l = joints[matched_joint(matched, left)], r = joints[matched_joint(matched, right)];
        mean = (l + r) * 0.5, left_from_right = l - r;
    }
};

/// The signed coordinate axis within 25 degrees of a unit vector, else the vector.
inline vec3<double> snapped(const vec3<double>& v) {
    for (int k = 0; k < 3; ++k)
        if (std::abs(v[k]) > 0.906) {
            vec3<double> axis(0);
            axis[k] = v[k] > 0 ? 1 : -1;
            return axis;
        }
    return v;
}

inline bool has_trunk(const MatchedJoints& matched) {
    for (const char* joint : {"left_hip", "right_hip", "left_shoulder", "right_shoulder"})
        if (matched_joint(matched, joint) < 0) return false;
    return true;
}

/// Thigh and shin of one side; a missing ankle counts as a shin as long as the thigh. -1 without hip or knee.
inline double leg_length(const RigMotion& rig, const MatchedJoints& matched, const std::string& side) {
    const auto at = [&](const char* joint) { return matched_joint(matched, side + joint); };
    const int hip = at("hip"), knee = at("knee"), ankle = at("ankle");
    if (hip < 0 || knee < 0) return -1;
    const auto distance = [&](int a, int b) {
        return length(rig.rest_joints[static_cast<std::size_t>(a)] - rig.rest_joints[static_cast<std::size_t>(b)]);
    };
    return distance(hip, knee) + (ankle < 0 ? distance(hip, knee) : distance(knee, ankle));
}

} // namespace detail

inline mat3<double> shortest_turn(const vec3<double>& from, const vec3<double>& to) {
    const vec3<double> axis = cross(from, to);
    const double sine = length(axis), cosine = dot(from, to);
    if (sine < 1e-12) {
        if (cosine > 0) return mat3<double>(1.0);
        const vec3<double> other = std::abs(from.y) < 0.9 ? vec3<double>(0, 1, 0) : vec3<double>(1, 0, 0);
        return rotation_from_axis_angle(normalize(cross(from, other)) * std::numbers::pi);
    }
    return rotation_from_axis_angle(axis * (std::atan2(sine, cosine) / sine));
}

inline mat3<double> facing(const RigMotion& rig, const MatchedJoints& matched, std::string_view where) {
    const detail::JointPair hips(rig.rest_joints.data(), matched, "left_hip", "right_hip");
    const detail::JointPair shoulders(rig.rest_joints.data(), matched, "left_shoulder", "right_shoulder");
    const vec3<double> up = shoulders.mean - hips.mean, left = hips.left_from_right + shoulders.left_from_right;
    const vec3<double> across = cross(left, up);
    check_value(length(across) > 1e-3 * length(up) * length(left) && length(up) > 0, where,
                "hips and shoulders of the rest pose do not span a plane, so it is not known where it faces");
    const vec3<double> y = detail::snapped(normalize(up));
    const vec3<double> x = detail::snapped(normalize(left - y * dot(left, y)));
    if (std::abs(dot(x, y)) < 1e-12) return {x, y, cross(x, y)};
    const vec3<double> z = normalize(across); // one axis was snapped and the other not
    const vec3<double> exact = normalize(up);
    return {cross(exact, z), exact, z};
}

inline double hip_height(const RigMotion& rig, const MatchedJoints& matched, std::string_view where) {
    const double left = detail::leg_length(rig, matched, "left_"), right = detail::leg_length(rig, matched, "right_");
    const detail::JointPair hips(rig.rest_joints.data(), matched, "left_hip", "right_hip");
    const mat3<double> axes = facing(rig, matched, where);
    const int pelvis = detail::matched_joint(matched, "pelvis");
    return (left + right) / 2 + dot(rig.rest_joints[static_cast<std::size_t>(pelvis)] - hips.mean, axes[1]);
}

inline LengthUnit guess_length_unit(const RigMotion& rig, const MatchedJoints& matched) {
    const double left = detail::leg_length(rig, matched, "left_"), right = detail::leg_length(rig, matched, "right_");
    const double leg = left > 0 && right > 0 ? (left + right) / 2 : std::max(left, right);
    if (!(leg > 0)) return {"metres", 1, 0};
    struct Range {
        double from, to;
        LengthUnit unit;
    };
    for (const Range& range :
         {Range{0.3, 3, {"metres", 1}}, Range{8, 20, {"units of CMU (inches / 0.45)", 0.0254 / 0.45}},
          Range{20, 45, {"inches", 0.0254}}, Range{45, 200, {"centimetres", 0.01}},
          Range{300, 3000, {"millimetres", 0.001}}})
        if (leg >= range.from && leg < range.to) return {range.unit.name, range.unit.metres, leg};
    return {"", 0.82 / leg, leg}; // no unit that is known
}

inline bool fit_rest_to_frames(RigMotion& rig, const MatchedJoints& matched) {
    if (rig.frame_count() == 0) return false;
    RigMotion posed;
    posed.rest_joints.assign(rig.joints.begin(), rig.joints.begin() + static_cast<std::ptrdiff_t>(rig.joint_count()));
    double rest = 0, frame = 0;
    for (const char* side : {"left_", "right_"}) {
        const double own = detail::leg_length(rig, matched, side), there = detail::leg_length(posed, matched, side);
        if (own > 0 && there > 0) rest += own, frame += there; // a side without hip or knee has -1
    }
    if (!(rest > 0 && frame > 0)) return false;
    for (auto& joint : rig.rest_joints) joint = joint * (frame / rest);
    return true;
}

} // namespace gsh
