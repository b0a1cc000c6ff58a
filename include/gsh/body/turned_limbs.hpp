// SPDX-License-Identifier: Apache-2.0
/// @file  Turns a rig's limbs to where its joints are, where rotations alone point elsewhere.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// The mean angles, in radians, between bones of the frames and the directions to which rotations turn those of the
/// rest pose; 0 without such bones.
struct LimbTurns {
    double limbs = 0;   ///< thighs, shins, upper arms, forearms
    double fingers = 0; ///< hands and fingers
};

/// Turns the rotations of a rig's frames such that limbs, hands and fingers point to the joints at their ends.
/// Positions and rotations differ where joints are moved in their parent's frame (position channels of BVH,
/// translations of glTF), where a joint between the two ends turns, and where an estimator has refined positions
/// alone.
///
/// A bone is turned by the smallest angle, so its twist stays. A hand is turned by its knuckles: the direction to the
/// middle finger, and the line from the little finger to the index. A phalanx without a joint at its end turns with the
/// bone before it. Turns below 1e-6 rad are left out, so a rig whose positions follow from its rotations is unchanged.
/// Hips, spine, collars, neck, head and feet are left as they are.
inline LimbTurns turn_limbs_to_joints(RigMotion& rig, const MatchedJoints& matched);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The turns of one frame.
class LimbTurner {
public:
    /// `short_bone` is the length below which a bone has no direction.
    LimbTurner(RigMotion& rig, const MatchedJoints& matched, std::size_t frame, double short_bone)
        : rig_(rig), matched_(matched), frame_(frame), short_bone_(short_bone) {}

    /// Turns the bone between two joints of SMPL-X.
    void turn_limb(const std::string& from, const std::string& to) {
        mat3<double> turn(1.0);
        if (turn_between(joint(from), joint(to), turn)) limbs_.add(apply(joint(from), turn));
    }
    void turn_hand(const std::string& side) {
        const int wrist = joint(side + "wrist");
        if (wrist < 0) return;
        mat3<double> hand(1.0);
        if (turn_of_knuckles(wrist, side, hand)) fingers_.add(apply(wrist, hand));
        for (const char* finger : {"index", "middle", "ring", "pinky", "thumb"}) {
            mat3<double> turn = hand;
            for (const char* number : {"1", "2", "3"}) {
                const int from = joint(side + finger + number);
                if (from < 0) continue;
                const int next = number[0] == '3' ? -1 : joint(side + finger + char(number[0] + 1));
                const bool known = turn_between(from, next >= 0 ? next : only_child(rig_, from), turn);
                const double angle = apply(from, turn);
                if (known) fingers_.add(angle);
            }
        }
    }

    /// A sum of angles, and their number.
    struct Sum {
        double angles = 0;
        std::size_t count = 0;
        void add(double angle) { angles += angle, ++count; }
        [[nodiscard]] double mean() const { return count ? angles / static_cast<double>(count) : 0; }
    };
    [[nodiscard]] const Sum& limbs() const { return limbs_; }
    [[nodiscard]] const Sum& fingers() const { return fingers_; }

private:
    RigMotion& rig_;
    const MatchedJoints& matched_;
    std::size_t frame_;
    double short_bone_;
    Sum limbs_, fingers_;

    [[nodiscard]] int joint(std::string_view name) const { return matched_joint(matched_, name); }

    /// Where a joint is by the rotation of one above it, and where it is; both from that one.
    struct Bone {
        vec3<double> expected, found;
    };
    [[nodiscard]] Bone bone(int from, int to) const {
        const auto i = static_cast<std::size_t>(from), k = static_cast<std::size_t>(to);
        return {rig_.rotation(frame_, from) * transpose(rig_.rest_rotations[i]) *
                    (rig_.rest_joints[k] - rig_.rest_joints[i]),
                rig_.joint(frame_, to) - rig_.joint(frame_, from)};
    }
    [[nodiscard]] bool has_length(const Bone& b) const {
        return length(b.expected) > short_bone_ && length(b.found) > short_bone_;
    }
    /// The shortest turn of a bone; false, and no change, if it has no direction.
    [[nodiscard]] bool turn_between(int from, int to, mat3<double>& turn) const {
        if (from < 0 || to < 0) return false;
        const Bone b = bone(from, to);
        if (!has_length(b)) return false;
        turn = shortest_turn(normalize(b.expected), normalize(b.found));
        return true;
    }
    /// The turn of a hand by the joints of its fingers that hang on the wrist.
    [[nodiscard]] bool turn_of_knuckles(int wrist, const std::string& side, mat3<double>& turn) const {
        std::vector<Bone> knuckles; // from the index to the little finger
        Bone along{vec3<double>(0), vec3<double>(0)};
        for (const char* finger : {"index1", "middle1", "ring1", "pinky1"}) {
            int at = joint(side + finger);
            while (at >= 0 && rig_.parents[static_cast<std::size_t>(at)] != wrist)
                at = rig_.parents[static_cast<std::size_t>(at)]; // a metacarpal bone has a turn of its own
            if (at < 0 || !has_length(bone(wrist, at))) continue;
            knuckles.push_back(bone(wrist, at));
            along.expected += normalize(knuckles.back().expected), along.found += normalize(knuckles.back().found);
        }
        if (knuckles.empty() || !(length(along.expected) > 0.1 && length(along.found) > 0.1)) return false;
        const Bone across{knuckles.front().expected - knuckles.back().expected,
                          knuckles.front().found - knuckles.back().found};
        const auto frame = [](const vec3<double>& y, const vec3<double>& x) {
            const vec3<double> z = normalize(cross(x, y)), up = normalize(y);
            return mat3<double>(cross(up, z), up, z);
        };
        const auto spans = [](const vec3<double>& y, const vec3<double>& x) {
            return length(cross(x, y)) > 0.1 * length(x) * length(y);
        };
        if (has_length(across) && spans(along.expected, across.expected) && spans(along.found, across.found))
            turn = frame(along.found, across.found) * transpose(frame(along.expected, across.expected));
        else
            turn = shortest_turn(normalize(along.expected), normalize(along.found));
        return true;
    }
    /// Returns the angle of the turn.
    double apply(int joint, const mat3<double>& turn) {
        const double angle = length(axis_angle_from_rotation(turn));
        if (angle < 1e-6) return 0;
        mat3<double>& own = rig_.rotations[frame_ * rig_.joint_count() + static_cast<std::size_t>(joint)];
        own = turn * own;
        return angle;
    }
};

} // namespace detail

inline LimbTurns turn_limbs_to_joints(RigMotion& rig, const MatchedJoints& matched) {
    const double leg = std::max(detail::leg_length(rig, matched, "left_"), detail::leg_length(rig, matched, "right_"));
    detail::LimbTurner::Sum limbs, fingers;
    for (std::size_t t = 0; t < rig.frame_count(); ++t) {
        detail::LimbTurner turner(rig, matched, t, std::max(leg * 0.005, 1e-9)); // 4 mm of a leg of 0.82 m
        for (const std::string side : {"left_", "right_"}) {
            for (const auto& [from, to] :
                 {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}})
                turner.turn_limb(side + from, side + to);
            turner.turn_hand(side);
        }
        limbs.angles += turner.limbs().angles, limbs.count += turner.limbs().count;
        fingers.angles += turner.fingers().angles, fingers.count += turner.fingers().count;
    }
    return {limbs.mean(), fingers.mean()};
}

} // namespace gsh
