// SPDX-License-Identifier: Apache-2.0
/// @file  A neutral rest pose of a rig, found from the frames of its motion.
#pragma once

#include <gsh/body/bone_end.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/body/trunk_frames.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/mean_direction.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// The rig's names and parents with a rest pose in a T that faces +z, y up, and no frames: for rigs whose own rest pose
/// is no pose (rest_pose_fault). Joints are where the bones' mean lengths put them.
///
/// Limbs. A bone's direction in its joint's axes is the same in all frames. Its twist is that which makes a knee bend
/// back and an elbow bend forward: the mean axis of the bend, in which clear bends count most. A limb that is never
/// bent has no twist against the trunk.
///
/// Trunk. In each frame the lines of hips and shoulders and the line between their middles give the axes of pelvis and
/// chest. Their mean in a joint's axes is how that joint lies in the body; upright frames with stretched legs count
/// most. Where the mean is near a coordinate axis of the joint and the joint's bones lie in the plane of symmetry that
/// follows, that axis is taken: rigs are made so, and a back that is bent throughout stays bent.
///
/// Feet. The sole is level where a foot stands; the toes give the heading. A foot that never stands slopes as usual.
///
/// Everything else (hands without fingers, fingers, toes, eyes) rests as it lies on average against its parent.
///
/// Frame   the frames' y must be up.
/// Errors  ValueError if hips and shoulders span a plane in no frame. Warned: feet that point backwards, and, where
///         it is needed, that no frame shows the body upright, so it is uncertain how far hips and chest lean.
[[nodiscard]] inline RigMotion rest_from_frames(const RigMotion& rig, const MatchedJoints& matched,
                                                const std::string& where, std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

class RestFromFrames {
public:
    RestFromFrames(const RigMotion& rig, const MatchedJoints& matched, const std::string& where,
                   std::vector<std::string>* warnings)
        : rig_(rig), matched_(matched), where_(where), warnings_(warnings),
          world_from_joint_(rig.joint_count(), mat3<double>(1.0)), known_(rig.joint_count(), false) {
        const std::size_t step = 1 + rig.frame_count() / 3000;
        for (std::size_t t = 0; t < rig.frame_count(); t += step) frames_.push_back(t);
    }

    RigMotion find() {
        trunk_ = trunk_frames(rig_, matched_, frames_, where_);
        for (const TrunkFrame& frame : trunk_) straightest_ = std::max(straightest_, frame.straight);
        place_trunk();
        for (const std::string side : {"left_", "right_"}) {
            place_collar(side);
            const double x = side == "left_" ? 1 : -1;
            place_limb(side + "shoulder", side + "elbow", side + "wrist", {x, 0, 0}, {0, -x, 0}, true);
            place_limb(side + "elbow", side + "shoulder", side + "wrist", {x, 0, 0}, {0, -x, 0}, false);
            place_limb(side + "hip", side + "knee", side + "ankle", {0, -1, 0}, {1, 0, 0}, true);
            place_limb(side + "knee", side + "hip", side + "ankle", {0, -1, 0}, {1, 0, 0}, false);
            place_foot(side);
            place_hand(side, x);
        }
        for (std::size_t k = 0; k < matched_.size(); ++k) // in the order of SMPL-X parents precede their children
            if (matched_[k] >= 0 && !known_[static_cast<std::size_t>(matched_[k])]) place_as_on_average(matched_[k]);
        warn();
        return rest_pose();
    }

private:
    const RigMotion& rig_;
    const MatchedJoints& matched_;
    const std::string& where_;
    std::vector<std::string>* warnings_;
    std::vector<std::size_t> frames_;
    std::vector<TrunkFrame> trunk_;              // of frames_
    std::vector<mat3<double>> world_from_joint_; // the rest rotations that are found
    std::vector<bool> known_;
    double straightest_ = 0, forward_toes_ = 0;
    bool lean_is_exact_ = true; ///< of pelvis and spine

    [[nodiscard]] int at(std::string_view joint) const { return matched_joint(matched_, joint); }
    [[nodiscard]] vec3<double> place(std::size_t t, int joint) const { return rig_.joint(t, joint); }
    [[nodiscard]] vec3<double> place(std::size_t t, const std::string& joint) const { return rig_.joint(t, at(joint)); }
    /// A joint's axes in the body's neutral pose, in frame t.
    [[nodiscard]] mat3<double> neutral(std::size_t t, int joint) const {
        return rig_.rotation(t, joint) * transpose(world_from_joint_[static_cast<std::size_t>(joint)]);
    }
    void set(int joint, const mat3<double>& rotation) {
        world_from_joint_[static_cast<std::size_t>(joint)] = rotation;
        known_[static_cast<std::size_t>(joint)] = true;
    }
    /// The nearest joint above whose rest rotation is found, or -1.
    [[nodiscard]] int known_above(int joint) const {
        while ((joint = rig_.parents[static_cast<std::size_t>(joint)]) >= 0)
            if (known_[static_cast<std::size_t>(joint)]) return joint;
        return -1;
    }

    /// Mean position of `other` in the axes of `joint`.
    [[nodiscard]] vec3<double> offset(int joint, int other) const {
        vec3<double> sum(0);
        for (const std::size_t t : frames_)
            sum += transpose(rig_.rotation(t, joint)) * (place(t, other) - place(t, joint));
        return sum * (1.0 / static_cast<double>(frames_.size()));
    }
    /// Direction of a bone in its joint's axes. The first frame's direction is exact where the bone is rigid.
    [[nodiscard]] vec3<double> bone(int joint, int other) const {
        const vec3<double> b = offset(joint, other);
        const double size = length(b);
        return size > 0 ? b * (1 / size) : b;
    }

    /// Pelvis, spine, neck and head.
    void place_trunk() {
        const double chest_share = [&] { // of the way from the pelvis to the joint that carries the arms
            double n = 0;
            for (const char* joint : {"spine1", "spine2", "spine3"}) n += at(joint) >= 0;
            return std::max(n, 1.0);
        }();
        struct Placed {
            int joint;
            std::string_view name;
            vec3<double> left, up; // of the body, in the joint's axes
        };
        std::vector<Placed> placed;
        double passed = 0;
        for (const char* joint : {"pelvis", "spine1", "spine2", "spine3", "neck", "head"}) {
            const int j = at(joint);
            if (j < 0) continue;
            const std::string_view name = joint;
            const double share = name == "pelvis" ? 0 : name.starts_with("spine") ? ++passed / chest_share : 1;
            MeanDirection left, up;
            for (std::size_t f = 0; f < frames_.size(); ++f) {
                const TrunkFrame& frame = trunk_[f];
                const mat3<double> to_joint = transpose(rig_.rotation(frames_[f], j));
                left.add(to_joint * (frame.pelvis[0] * (1 - share) + frame.chest[0] * share), frame.weight());
                up.add(to_joint * (share == 0 ? frame.pelvis[1] : frame.chest[1]), frame.weight());
            }
            placed.push_back({j, name, left.value(), up.value()});
        }
        // Axes are exact in most joints of a rig or in none; a single one may be near by chance.
        std::size_t exact = 0, open = 0;
        for (const Placed& joint : placed) {
            const Symmetry shown = symmetry_of(joint.joint, nearest_axis(joint.left));
            exact += shown == Symmetry::shown && is_near_axis(joint.left), open += shown != Symmetry::unknown;
        }
        for (const Placed& joint : placed) {
            const bool snaps = 2 * exact > open && is_near_axis(joint.left) &&
                               symmetry_of(joint.joint, nearest_axis(joint.left)) != Symmetry::contradicted;
            const vec3<double> x = snaps ? nearest_axis(joint.left) : joint.left;
            const vec3<double> axis = nearest_axis(joint.up);
            const bool upright = snaps && dot(axis, x) == 0 && dot(axis, joint.up) > 0.8;
            if (joint.name != "neck" && joint.name != "head") lean_is_exact_ = lean_is_exact_ && upright;
            set(joint.joint, transpose(axes_of(x, upright ? axis : joint.up))); // of the body's axes in the joint's
        }
    }

    /// What the joints beside and above a joint of the trunk show of its plane of symmetry, if `axis` is across it.
    enum class Symmetry { unknown, shown, contradicted };
    [[nodiscard]] Symmetry symmetry_of(int joint, const vec3<double>& axis) const {
        Symmetry result = Symmetry::unknown;
        const auto is_child = [&](int other) {
            return other >= 0 && rig_.parents[static_cast<std::size_t>(other)] == joint;
        };
        for (const char* other : {"spine1", "spine2", "spine3", "neck", "head"}) {
            if (!is_child(at(other))) continue;
            const vec3<double> b = bone(joint, at(other));
            if (length(b) < 0.5) continue;
            if (std::abs(dot(b, axis)) > 0.03) return Symmetry::contradicted;
            result = Symmetry::shown;
        }
        for (const std::string pair : {"hip", "collar", "shoulder", "eye"}) {
            const int l = at("left_" + pair), r = at("right_" + pair);
            if (!is_child(l) || !is_child(r)) continue;
            const vec3<double> a = offset(joint, l), b = offset(joint, r), across = a - b;
            if (length(across) < 0.02 * (length(a) + length(b))) continue;
            if (dot(across, axis) < 0.99 * length(across)) return Symmetry::contradicted;
            result = Symmetry::shown;
        }
        return result;
    }
    /// Within 25 degrees.
    [[nodiscard]] static bool is_near_axis(const vec3<double>& v) { return dot(v, nearest_axis(v)) > 0.906; }
    [[nodiscard]] static vec3<double> nearest_axis(const vec3<double>& v) {
        int k = 0;
        for (int i = 1; i < 3; ++i)
            if (std::abs(v[i]) > std::abs(v[k])) k = i;
        vec3<double> axis(0);
        axis[k] = v[k] < 0 ? -1 : 1;
        return axis;
    }

    /// A collar rests as it lies against the chest while the arm is not raised.
    void place_collar(const std::string& side) {
        const int j = at(side + "collar");
        if (j < 0) return;
        MeanDirection left, up;
        const int chest = known_above(j);
        for (std::size_t f = 0; f < frames_.size(); ++f) {
            const std::size_t t = frames_[f];
            const mat3<double> body = chest >= 0 ? neutral(t, chest) : trunk_[f].chest;
            const vec3<double> arm = place(t, side + "elbow") - place(t, side + "shoulder");
            const double weight = dot(arm, body[1]) < 0.3 * length(arm) ? 1 : 0.05;
            const mat3<double> to_joint = transpose(rig_.rotation(t, j));
            left.add(to_joint * body[0], weight), up.add(to_joint * body[1], weight);
        }
        set(j, transpose(axes_of(left.value(), up.value())));
    }

    /// The bone from `joint`. Its direction at rest is `direction`, and the joint of knee or elbow bends about `hinge`.
    /// `other` is the joint at the other end of a lower bone, or that of an upper one.
    void place_limb(const std::string& joint, const std::string& other, const std::string& end,
                    const vec3<double>& direction, const vec3<double>& hinge, bool is_upper) {
        const int j = at(joint);
        if (j < 0) return;
        const int far = at(is_upper ? other : end);
        if (far < 0) return place_as_on_average(j);
        const vec3<double> b = bone(j, far);
        if (!(length(b) > 0.5)) return place_as_on_average(j);
        MeanDirection bends;
        const std::string first = is_upper ? joint : other, middle = is_upper ? other : joint;
        if (at(end) >= 0)
            for (const std::size_t t : frames_) {
                const vec3<double> upper = place(t, middle) - place(t, first), lower = place(t, end) - place(t, middle);
                const vec3<double> axis = cross(upper, lower);
                const double size = length(upper) * length(lower);
                const double sine = size > 0 ? length(axis) / size : 0;
                if (sine > 0.15) bends.add(transpose(rig_.rotation(t, j)) * axis, sine * sine);
            }
        const vec3<double> untwisted = untwisted_hinge(j, far, direction, hinge);
        vec3<double> local = bends.value();
        // A bend of 15 degrees in a tenth of the frames weighs as much as no bend at all.
        const double doubt = 0.0067 * static_cast<double>(frames_.size());
        local = local * bends.weight() + untwisted * doubt;
        set(j, axes_of(direction, hinge) * transpose(axes_of(b, length(local) > 1e-9 ? local : untwisted)));
    }

    /// The axis `hinge` in a joint's axes, if the bone has no twist against the next joint above.
    [[nodiscard]] vec3<double> untwisted_hinge(int joint, int far, const vec3<double>& direction,
                                               const vec3<double>& hinge) const {
        int above = known_above(joint);
        MeanDirection mean;
        for (const std::size_t t : frames_) {
            const mat3<double> body = above >= 0 ? neutral(t, above) : mat3<double>(1.0);
            const vec3<double> now = transpose(body) * (place(t, far) - place(t, joint));
            if (!(length(now) > 0)) continue;
            // Close to the opposite direction the shortest turn is about any axis.
            const double weight = 1.001 + dot(normalize(now), direction);
            mean.add(transpose(rig_.rotation(t, joint)) * (body * (shortest_turn(direction, normalize(now)) * hinge)),
                     weight);
        }
        return mean.value();
    }

    void place_foot(const std::string& side) {
        const int j = at(side + "ankle"), shin = at(side + "knee");
        if (j < 0) return;
        int toes = at(side + "foot");
        if (toes < 0) toes = end_of(rig_, j);
        MeanDirection sole, left, ahead, trunk_ahead;
        double lowest = rig_.joint(0, j).y;
        for (std::size_t t = 0; t < rig_.frame_count(); ++t) lowest = std::min(lowest, rig_.joint(t, j).y);
        const double leg =
            length(place(0, side + "knee") - place(0, side + "hip")) + length(place(0, j) - place(0, shin));
        std::size_t standing = 0;
        for (const std::size_t t : frames_) {
            const mat3<double> to_joint = transpose(rig_.rotation(t, j)), body = neutral(t, shin);
            left.add(to_joint * body[0]), ahead.add(to_joint * body[2]);
            trunk_ahead.add(to_joint * neutral(t, at("pelvis"))[2]);
            const std::size_t next = t + 1 < rig_.frame_count() ? t + 1 : t, before = t > 0 ? t - 1 : t;
            const double elapsed = rig_.timestamps[next] - rig_.timestamps[before];
            const double way = length(rig_.joint(next, j) - rig_.joint(before, j));
            if (rig_.joint(t, j).y < lowest + 0.06 * leg && (next == before || way < 0.2 * leg * elapsed))
                sole.add(to_joint * vec3<double>(0, 1, 0)), ++standing;
        }
        const vec3<double> toe = toes >= 0 ? bone(j, toes) : vec3<double>(0);
        const bool has_toe = length(toe) > 0.5 && (at(side + "foot") >= 0 || dot(toe, ahead.value()) > 0.5);
        vec3<double> up = standing > 0 ? sole.value() : vec3<double>(0);
        const double pitch = has_toe ? std::asin(std::clamp(dot(toe, up), -1.0, 1.0)) : 0; // toes are below the ankle
        const bool stands =
            length(up) > 0.5 && pitch > -1.2 && pitch < 0.35 && dot(up, cross(ahead.value(), left.value())) > 0.5;
        if (!stands && has_toe) { // the toes are 25 degrees below the ankle
            const mat3<double> axes = axes_of(toe, cross(toe, left.value()));
            up = axes[1] * std::cos(0.436) - axes[0] * std::sin(0.436);
        } else if (!stands) {
            up = cross(ahead.value(), left.value());
        }
        const vec3<double> forward = has_toe ? toe : ahead.value();
        if (has_toe) forward_toes_ += dot(toe, trunk_ahead.value());
        if (!(length(up) > 0.5) || !(length(forward) > 0.5)) return place_as_on_average(j);
        const mat3<double> axes = axes_of(up, forward); // up, forward, and to the left
        set(j, transpose(mat3<double>(axes[2], axes[0], axes[1])));
    }

    /// Points along ±x, palm down. Without fingers the palm is as the forearm has it.
    void place_hand(const std::string& side, double x) {
        const int j = at(side + "wrist");
        if (j < 0) return;
        const int middle = at(side + "middle1");
        int end = middle >= 0 ? middle : end_of(rig_, j);
        const int elbow = at(side + "elbow");
        if (middle < 0 && end >= 0 &&
            mean_angle(
                rig_,
                [&](std::size_t t) { return std::pair(place(t, end) - place(t, j), place(t, j) - place(t, elbow)); }) >
                0.8)
            end = -1; // an end of a fixed direction, as some programs write it
        const vec3<double> b = end >= 0 ? bone(j, end) : vec3<double>(0);
        if (!(length(b) > 0.5)) return place_as_on_average(j);
        const int index = at(side + "index1");
        int last = at(side + "pinky1");
        if (last < 0) last = at(side + "ring1");
        vec3<double> ahead(0); // from the little finger to the index finger
        if (index >= 0 && last >= 0) ahead = offset(j, index) - offset(j, last);
        if (!(length(ahead) > 0)) ahead = untwisted_hinge(j, end, {x, 0, 0}, {0, 0, 1});
        set(j, axes_of({x, 0, 0}, {0, 0, 1}) * transpose(axes_of(b, ahead)));
    }

    void place_as_on_average(int joint) {
        const int above = known_above(joint);
        if (above < 0) return set(joint, mat3<double>(1.0));
        MeanDirection left, up;
        for (const std::size_t t : frames_) {
            const mat3<double> to_joint = transpose(rig_.rotation(t, joint)), body = neutral(t, above);
            left.add(to_joint * body[0]), up.add(to_joint * body[1]);
        }
        set(joint, transpose(axes_of(left.value(), up.value())));
    }

    void warn() const {
        if (!warnings_) return;
        if (straightest_ < 0.3 && !lean_is_exact_)
            warnings_->push_back(where_ + ": no frame shows the body upright with stretched legs, so how far hips and "
                                          "chest lean is uncertain");
        if (forward_toes_ < -0.3)
            warnings_->push_back(where_ + ": the feet point backwards; are left and right swapped, or the axes "
                                          "left-handed?");
    }

    [[nodiscard]] RigMotion rest_pose() const {
        RigMotion rest;
        rest.names = rig_.names, rest.parents = rig_.parents;
        rest.rest_rotations = world_from_joint_;
        rest.rest_joints.assign(rig_.joint_count(), vec3<double>(0));
        for (std::size_t j = 0; j < rig_.joint_count(); ++j) { // parents precede their children
            const int joint = static_cast<int>(j), above = known_above(joint);
            if (!known_[j])
                rest.rest_rotations[j] =
                    above < 0 ? mat3<double>(1.0) : rest.rest_rotations[static_cast<std::size_t>(above)];
            if (above >= 0)
                rest.rest_joints[j] = rest.rest_joints[static_cast<std::size_t>(above)] +
                                      world_from_joint_[static_cast<std::size_t>(above)] * offset(above, joint);
        }
        return rest;
    }
};

} // namespace detail

inline RigMotion rest_from_frames(const RigMotion& rig, const MatchedJoints& matched, const std::string& where,
                                  std::vector<std::string>* warnings) {
    check_limbs(rig, matched, where);
    check_value(rig.frame_count() > 0, where, "holds no frames");
    return detail::RestFromFrames(rig, matched, where, warnings).find();
}

} // namespace gsh
