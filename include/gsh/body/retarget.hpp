// SPDX-License-Identifier: Apache-2.0
/// @file  Retargeting: the motion of any rig becomes the motion of a body with other bones and another rest pose.
#pragma once

#include <gsh/body/ankle_height.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/bone_end.hpp>
#include <gsh/body/foot_slide.hpp>
#include <gsh/body/four_legs.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/rest_check.hpp>
#include <gsh/body/rest_from_frames.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/short_spine.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

struct RetargetParams {
    std::vector<double> betas = {}; ///< shape of the body; missing trailing coefficients count as 0
    std::string where = "retarget"; ///< a file, for messages
    std::vector<std::string>* warnings = nullptr;
};
/// The former name of RetargetParams.
using RetargetOptions [[deprecated("use RetargetParams")]] = RetargetParams;

/// Turns the motion of a rig into one of a body whose rest frames are the axes (the SMPL family, the built-in actor).
///
/// With the source's world rotations G(t) and those of its rest pose G⁰, a joint of the body has the world rotation
///
///     W(t) = G(t) G⁰⁻¹ F C,   local rotation = W_parent⁻¹ W,
///
/// where F turns the body's rest pose so that it faces as the source's, and C turns a limb's rest direction to that of
/// the source (C = 1 if both rest in a T). C of a bone continues that of the bone before it by the shortest turn, so no
/// twist is added. Hips, spine, collars, neck and head have C = 1: how a rig places joints inside the trunk is not a
/// pose. A foot takes the heading of the source's, and its pitch only if the two differ by more than 45 degrees,
/// because feet of a rest pose stand flat wherever the joints of the toes are. A hand without fingers points to its end
/// (hand_end).
///
/// A rest pose that is none of a standing person (rest_pose_fault) is replaced by one that the frames show
/// (rest_from_frames), with a warning. The one or two joints of a short spine move those of the body's that are at the
/// same share of the way from the hips to the shoulders.
///
/// A joint without a source keeps the world turn of its parent, so the hips' position and the direction of every
/// mapped limb stay those of the source. Positions of the hips are scaled by the ratio of the two hips' heights above
/// the ankles with legs stretched, and raised or lowered so that the soles stand where the source's do
/// (ankle_height); y = 0 stays the ground. Expressions are zero.
///
/// Frame   that of the rig: y up.
/// Errors  ValueError if the body's joints have unknown names, a limb is not found (check_limbs), or the rig is
///         invalid, or an animal on four legs (body/four_legs.hpp; with a joint map, that is a warning); ShapeError for
///         too many betas. Warned: joints without a source, several joints that could be one, left and right that seem
///         swapped, feet that slide although the source's stand.
[[nodiscard]] inline Motion retarget(const RigMotion& rig, const BodyModel& body, const JointMap& map = {},
                                     const RetargetParams& options = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The body's side of a retargeting: for each joint, which joint of SMPL-X it is and which joint of the rig moves it.
struct RetargetPlan {
    std::vector<int> parts;              // [J] joint of SMPL-X, or -1
    std::vector<int> sources;            // [J] joint of the rig, or -1
    std::vector<vec3<double>> joints;    // [J] rest positions
    std::vector<mat3<double>> alignment; // [J] F C
    MatchedJoints target;                // the body's joint of each joint of SMPL-X, or -1
    MatchedJoints source;                // the rig's
    RigMotion rest;                      ///< the rig's rest pose, without frames
    mat3<double> facing{1.0};            ///< F
    double leg = 1;                      ///< the body's height of the hips above the ankles
    double scale = 1;                    ///< of the rig's positions
    double own_ankle = 0;                ///< height of the body's ankles above its soles
    std::optional<double> rig_ankle;     ///< that of the rig; none if it is not known, or if legs are alike
};

/// The joint at the far end of a limb's bone, -1 for joints that keep C = 1.
inline int bone_end(int part) {
    const std::string name(smplx_joint_names[static_cast<std::size_t>(part)]);
    const auto underscore = name.find('_');
    if (underscore == std::string::npos) return -1;
    const std::string side = name.substr(0, underscore + 1), kind = name.substr(underscore + 1);
    for (const auto& [from, to] :
         {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}, {"wrist", "middle1"}})
        if (kind == from) return smplx_joint(side + to);
    const char number = kind.back();
    return number == '1' || number == '2' ? smplx_joint(side + kind.substr(0, kind.size() - 1) + char(number + 1)) : -1;
}
/// Whether C of a joint begins anew at the axes: all but arms below the collar, legs below the hips, and fingers.
inline bool is_trunk(int part) {
    const std::string_view name = smplx_joint_names[static_cast<std::size_t>(part)];
    return name.find('_') == std::string_view::npos || name.ends_with("collar") || name.ends_with("eye");
}

/// Direction of a rig's bone in the rest pose; zero if it has no end or no length.
inline vec3<double> rest_bone(const RigMotion& rig, int joint, int end) {
    if (end < 0) return vec3<double>(0);
    const vec3<double> bone =
        rig.rest_joints[static_cast<std::size_t>(end)] - rig.rest_joints[static_cast<std::size_t>(joint)];
    const double size = length(bone);
    return size > 0 ? bone * (1 / size) : vec3<double>(0);
}

/// The rest pose that a rig's motion is measured from: its own, or one found in the frames, where its own is none.
inline RigMotion rest_of(const RigMotion& rig, const MatchedJoints& matched, const RetargetParams& options, bool& own) {
    const auto fault = rest_pose_fault(rig, matched);
    own = !fault;
    if (fault) {
        if (options.warnings)
            options.warnings->push_back(options.where + ": the rest pose " + *fault +
                                        ", so the frames show where the body faces and how limbs are twisted");
        return rest_from_frames(rig, matched, options.where, options.warnings);
    }
    RigMotion rest;
    rest.names = rig.names, rest.parents = rig.parents;
    rest.rest_joints = rig.rest_joints, rest.rest_rotations = rig.rest_rotations;
    return rest;
}

/// C of a foot (see retarget): `own` and `other` are unit vectors from ankle to toes, y up.
inline mat3<double> foot_turn(const vec3<double>& own, const vec3<double>& other) {
    const vec3<double> own_level(own.x, 0, own.z), other_level(other.x, 0, other.z);
    const double pitch = std::asin(std::clamp(other.y, -1.0, 1.0)) - std::asin(std::clamp(own.y, -1.0, 1.0));
    if (std::abs(pitch) > 0.785 || length(own_level) < 0.2 || length(other_level) < 0.2)
        return shortest_turn(own, other);
    return shortest_turn(normalize(own_level), normalize(other_level));
}

inline RetargetPlan plan_retarget(const RigMotion& rig, const BodyModel& body, const JointMap& map,
                                  const RetargetParams& options) {
    const std::string& where = options.where;
    RetargetPlan plan;
    const std::vector<vec3<double>> vertices = shaped_vertices(body, options.betas);
    plan.joints = regress_joints(body, vertices);
    RigMotion own; // the body's skeleton, at rest
    own.names = joint_names_of(body), own.parents = body.parents, own.rest_joints = plan.joints;
    plan.target = JointMap{}.match(own, "the body");
    for (const char* joint :
         {"pelvis", "left_hip", "left_knee", "right_hip", "right_knee", "left_shoulder", "right_shoulder"})
        check_value(plan.target[static_cast<std::size_t>(smplx_joint(joint))] >= 0, where,
                    "the body has no joint that is known as " + std::string(joint) +
                        ", so a motion of another rig cannot be given to it; expected 22, 24, 52 or 55 joints in the "
                        "order of SMPL-X, or known joint_names");
    plan.source = map.match(rig, where, options.warnings);
    check_limbs(rig, plan.source, where);
    if (stands_on_four_legs(rig, plan.source)) {
        const std::string animal = "stands on four legs, as an animal does, and gsh retargets people";
        check_value(!map.named.empty(), where, animal + "; if it is a person, name a joint in a joint map");
        if (options.warnings) options.warnings->push_back(where + ": " + animal);
    }
    bool own_rest = true;
    plan.rest = rest_of(rig, plan.source, options, own_rest);
    const bool spine_named = std::any_of(map.named.begin(), map.named.end(),
                                         [](const auto& name) { return name.second.starts_with("spine"); });
    if (!spine_named) match_short_spine(plan.rest, plan.source, own, plan.target);

    const std::size_t J = body.joint_count();
    plan.parts.assign(J, -1), plan.sources.assign(J, -1);
    for (std::size_t k = 0; k < smplx_joint_names.size(); ++k)
        if (const int j = plan.target[k]; j >= 0) {
            plan.parts[static_cast<std::size_t>(j)] = static_cast<int>(k);
            plan.sources[static_cast<std::size_t>(j)] = plan.source[k];
        }
    const mat3<double> F = plan.facing = own_rest ? facing(rig, plan.source, where) : mat3<double>(1.0);
    std::vector<mat3<double>> C(J, mat3<double>(1.0));
    for (std::size_t j = 0; j < J; ++j) { // parents precede their children
        const int part = plan.parts[j], source = plan.sources[j];
        if (body.parents[j] >= 0) C[j] = C[static_cast<std::size_t>(body.parents[j])];
        if (part >= 0 && is_trunk(part)) C[j] = mat3<double>(1.0);
        if (part < 0 || source < 0) continue;
        const std::string_view name = smplx_joint_names[static_cast<std::size_t>(part)];
        const bool foot = name.ends_with("ankle");
        const int end = foot ? smplx_joint(name.starts_with("left") ? "left_foot" : "right_foot") : bone_end(part);
        if (end < 0 || plan.target[static_cast<std::size_t>(end)] < 0) continue;
        const vec3<double> to = plan.joints[static_cast<std::size_t>(plan.target[static_cast<std::size_t>(end)])];
        const vec3<double> d = normalize(to - plan.joints[j]);
        int source_end = plan.source[static_cast<std::size_t>(end)];
        if (source_end < 0 && foot) continue;
        if (source_end < 0) // a hand's only child may be anything
            source_end = name.ends_with("wrist")
                             ? hand_end(rig, plan.rest, plan.source, name.starts_with("left") ? "left_" : "right_")
                             : only_child(rig, source);
        const vec3<double> wanted = transpose(F) * rest_bone(plan.rest, source, source_end);
        if (!(length(wanted) > 0.5)) continue;
        C[j] = foot ? foot_turn(d, wanted) : shortest_turn(C[j] * d, wanted) * C[j];
    }
    for (const auto& c : C) plan.alignment.push_back(F * c);
    const double height = hip_height(plan.rest, plan.source, where);
    check_value(height > 1e-9, where, "the legs of the rest pose have no length");
    plan.leg = hip_height(own, plan.target, where);
    plan.scale = plan.leg / height;
    if (!has_same_legs(own, plan.target, plan.rest, plan.source, plan.scale))
        if (matched_joint(plan.target, "left_ankle") >= 0 && matched_joint(plan.target, "right_ankle") >= 0)
            plan.rig_ankle = ankle_height(rig, plan.rest, plan.source, own_rest);
    plan.own_ankle = ankle_height(vertices, plan.joints, plan.target);
    return plan;
}

/// Warns of joints of the body that nothing moves, and of joints of the rig that move nothing.
inline void warn_of_unmatched(const RigMotion& rig, const RetargetPlan& plan, const RetargetParams& options) {
    std::vector<std::string> still, fingers, unused;
    bool no_fingers = true;
    for (std::size_t j = 0; j < plan.parts.size(); ++j) {
        if (plan.parts[j] < 0) continue;
        const bool finger = plan.parts[j] >= smplx_joint("left_index1");
        if (plan.sources[j] < 0)
            (finger ? fingers : still).emplace_back(smplx_joint_names[static_cast<std::size_t>(plan.parts[j])]);
        else if (finger)
            no_fingers = false;
    }
    if (no_fingers && !fingers.empty()) fingers = {"all fingers"};
    still.insert(still.end(), fingers.begin(), fingers.end());
    for (std::size_t j = 0; j < rig.joint_count(); ++j)
        if (std::find(plan.source.begin(), plan.source.end(), static_cast<int>(j)) == plan.source.end() &&
            !rig.names[j].substr(0, rig.names[j].find('#')).ends_with("_end")) // End Sites of BVH
            unused.push_back(rig.names[j]);
    if (!still.empty())
        options.warnings->push_back(options.where + ": no joint was found for " + list_of_names(still) +
                                    "; they keep the rest pose" +
                                    (unused.empty() ? "" : ". Not used: " + list_of_names(unused)));
    const int ankle = plan.source[static_cast<std::size_t>(smplx_joint("left_ankle"))],
              toes = plan.source[static_cast<std::size_t>(smplx_joint("left_foot"))];
    if (ankle < 0 || toes < 0) return;
    const vec3<double> foot = transpose(plan.facing) * rest_bone(plan.rest, ankle, toes);
    if (foot.z < -0.3)
        options.warnings->push_back(options.where + ": in the rest pose the left foot points backwards; are left and "
                                                    "right swapped, or the axes left-handed?");
}

} // namespace detail

inline Motion retarget(const RigMotion& rig, const BodyModel& body, const JointMap& map,
                       const RetargetParams& options) {
    validate(rig, options.where);
    const detail::RetargetPlan plan = detail::plan_retarget(rig, body, map, options);
    const std::size_t J = body.joint_count(), T = rig.frame_count();
    check_rig_size(options.where, J, T);
    const int pelvis = plan.source[0];
    const auto root = static_cast<std::size_t>(plan.target[0]);
    Motion motion;
    motion.joint_count = J, motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas = options.betas;
    motion.betas.resize(static_cast<std::size_t>(body.shape_count), 0.0);
    motion.expression.assign(T * motion.expression_count, 0.0);
    motion.timestamps = rig.timestamps;
    motion.pose.reserve(T * J);
    std::vector<mat3<double>> world(J);
    std::vector<double> lower_ankles;
    FootSlide slide(rig, body, plan.source, plan.target, plan.joints, plan.leg, plan.scale);
    for (std::size_t t = 0; t < T; ++t) {
        for (std::size_t j = 0; j < J; ++j) {
            const int source = plan.sources[j], parent = body.parents[j];
            const mat3<double> above = parent < 0 ? mat3<double>(1.0) : world[static_cast<std::size_t>(parent)];
            world[j] = above;
            if (source >= 0)
                world[j] = rig.rotation(t, source) *
                           transpose(plan.rest.rest_rotations[static_cast<std::size_t>(source)]) * plan.alignment[j];
            motion.pose.push_back(axis_angle_from_rotation(transpose(above) * world[j]));
        }
        const vec3<double> hips = rig.joint(t, pelvis) * plan.scale;
        // Where the root of the body is above its pelvis, it is placed so that the pelvis is there.
        vec3<double> offset(0);
        for (std::size_t j = root; body.parents[j] >= 0; j = static_cast<std::size_t>(body.parents[j])) {
            const auto p = static_cast<std::size_t>(body.parents[j]);
            offset += world[p] * (plan.joints[j] - plan.joints[p]);
        }
        motion.transl.push_back(hips - offset - plan.joints[0]);
        slide.add(t, world, hips - offset);
        lower_ankles.push_back(slide.lower_ankle());
    }
    if (plan.rig_ankle) {
        const double raise = ground_raise(rig, plan.source, plan.leg / plan.scale, *plan.rig_ankle, lower_ankles,
                                          plan.own_ankle, plan.scale);
        for (auto& place : motion.transl) place.y += raise;
    }
    if (options.warnings) {
        detail::warn_of_unmatched(rig, plan, options);
        if (const double most = slide.longest(); most > 0.03)
            options.warnings->push_back(options.where + ": feet slide by up to " +
                                        std::to_string(static_cast<int>(std::lround(100 * most))) +
                                        " cm while the source's stand, because the proportions differ");
    }
    validate(motion, body, options.where);
    return motion;
}

} // namespace gsh
