// SPDX-License-Identifier: Apache-2.0
/// @file  Finds the joints of a person in a rig: by names, by their places in the tree, and among several candidates.
#pragma once

#include <gsh/body/joint_name_table.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

namespace gsh {

/// The joint of a rig for each joint of SMPL-X, -1 where there is none.
using MatchedJoints = std::array<int, smplx_joint_names.size()>;

namespace detail {

/// A rig's tree, which may have no rest pose.
class RigTree {
public:
    explicit RigTree(const RigMotion& rig) : rig_(rig) {}

    [[nodiscard]] int parent(int joint) const { return rig_.parents[static_cast<std::size_t>(joint)]; }
    [[nodiscard]] bool is_above(int joint, int other) const { // or the same
        while (other >= 0 && other != joint) other = parent(other);
        return other == joint;
    }
    /// The lowest joint that is above both, or one of them; -1 if there is none.
    [[nodiscard]] int common(int a, int b) const {
        while (a >= 0 && !is_above(a, b)) a = parent(a);
        return a;
    }
    /// The joints between two, from the upper one down, without both.
    [[nodiscard]] std::vector<int> between(int upper, int lower) const {
        std::vector<int> chain;
        for (int j = parent(lower); j >= 0 && j != upper; j = parent(j)) chain.insert(chain.begin(), j);
        return chain;
    }
    [[nodiscard]] int depth(int joint) const {
        int result = 0;
        while ((joint = parent(joint)) >= 0) ++result;
        return result;
    }
    [[nodiscard]] double distance(int a, const vec3<double>& x) const {
        return rig_.rest_joints.empty() ? 0 : length(rig_.rest_joints[static_cast<std::size_t>(a)] - x);
    }
    [[nodiscard]] vec3<double> middle(int a, int b) const {
        if (rig_.rest_joints.empty()) return vec3<double>(0);
        return (rig_.rest_joints[static_cast<std::size_t>(a)] + rig_.rest_joints[static_cast<std::size_t>(b)]) * 0.5;
    }

private:
    const RigMotion& rig_;
};

/// A name's letters and digits in lower case, and how many other signs it has.
struct PlainName {
    std::string letters;
    std::size_t signs = 0;

    explicit PlainName(std::string_view name) {
        for (const char c : name)
            if (std::isalnum(static_cast<unsigned char>(c)))
                letters.push_back(static_cast<char>(std::tolower(static_cast<unsigned char>(c))));
            else
                ++signs;
    }
};

class JointFinder {
public:
    using Named = std::map<std::string, std::string, std::less<>>;

    JointFinder(const RigMotion& rig, const Named& named, std::string_view where)
        : rig_(rig), tree_(rig), where_(where), words_(joint_words(rig.names)) {
        matched_.fill(-1);
        used_.assign(rig.joint_count(), false);
        for (const auto& [own, joint] : named) take_named(own, joint);
        keep_one_layer();
    }

    /// Errors  ValueError that names all joints of limbs for which there are several candidates.
    MatchedJoints find(std::vector<std::string>* warnings) {
        for (const char side : {'l', 'r'})
            for (const KnownJoint& known : known_side_joints())
                if (known.joint != "eye") find_side_joint(side, known);
        find_pelvis();
        for (const KnownJoint& known : known_middle_joints())
            if (known.joint != "pelvis") find_of_trunk(known);
        for (const char side : {'l', 'r'})
            for (const KnownJoint& known : known_side_joints())
                if (known.joint == "eye") find_side_joint(side, known);
        find_spine_and_neck();
        check_value(conflicts_.empty(), where_,
                    "several joints could be one of a limb: " + joined(conflicts_) +
                        "; choose in a joint map (--joint-map FILE.json)");
        if (warnings && !choices_.empty())
            warnings->push_back(std::string(where_) + ": several joints could be one: " + joined(choices_) +
                                "; a joint map can choose others");
        return matched_;
    }

private:
    const RigMotion& rig_;
    RigTree tree_;
    std::string_view where_;
    std::vector<JointWords> words_;
    std::vector<bool> used_; // joints that are matched already, or left out by name
    MatchedJoints matched_;
    std::vector<std::string> conflicts_, choices_;

    [[nodiscard]] const std::string& name(int joint) const { return rig_.names[static_cast<std::size_t>(joint)]; }
    [[nodiscard]] std::string quoted(int joint) const { return "'" + shortened(name(joint)) + "'"; }
    [[nodiscard]] static std::string joined(const std::vector<std::string>& texts) {
        return listing(texts.size(), 60, [&](std::size_t i) { return texts[i]; });
    }
    int& at(std::string_view joint) { return matched_[static_cast<std::size_t>(smplx_joint(joint))]; }
    [[nodiscard]] int at(std::string_view joint) const {
        return matched_[static_cast<std::size_t>(smplx_joint(joint))];
    }
    void take(std::string_view joint, int own) {
        at(joint) = own;
        used_[static_cast<std::size_t>(own)] = true;
    }

    void take_named(const std::string& own, const std::string& joint) {
        const auto found = std::find(rig_.names.begin(), rig_.names.end(), own);
        check_value(found != rig_.names.end(), where_,
                    "the joint map names '" + shortened(own) +
                        "', which is not a joint of this rig: " + list_of_names(rig_.names, 200));
        const auto j = static_cast<std::size_t>(found - rig_.names.begin());
        used_[j] = true;
        if (joint.empty()) return;
        check_value(smplx_joint(joint) >= 0, where_,
                    "the joint map assigns '" + shortened(own) + "' to '" + shortened(joint) +
                        "', expected a joint of SMPL-X such as "
                        "left_elbow");
        int& matched = at(joint);
        check_value(matched < 0, where_,
                    "the joint map assigns '" + joint + "' twice, to '" + shortened(own) + "' and to another joint");
        matched = static_cast<int>(j);
    }

    /// Rigs of Rigify hold each limb several times. Joints of other layers than that which deforms the mesh, or else
    /// the first one with both thighs, are left out.
    void keep_one_layer() {
        using Layer = JointWords::Layer;
        const auto thighs = known_side_joints().front().parts;
        for (const Layer layer : {Layer::deforming, Layer::none, Layer::original, Layer::mechanical}) {
            bool has[2] = {false, false};
            for (const JointWords& words : words_)
                if (words.layer == layer && words.side &&
                    std::find(thighs.begin(), thighs.end(), words.part) != thighs.end())
                    has[words.side == 'r'] = true;
            if (!has[0] || !has[1]) continue;
            for (JointWords& words : words_)
                if (words.layer != layer) words.part.clear();
            return;
        }
    }

    [[nodiscard]] std::vector<int> called(char side, std::string_view part) const {
        std::vector<int> joints;
        for (std::size_t j = 0; j < words_.size(); ++j)
            if (!used_[j] && words_[j].side == side && words_[j].part == part) joints.push_back(static_cast<int>(j));
        return joints;
    }
    [[nodiscard]] bool has(char side, std::string_view part) const {
        return std::any_of(words_.begin(), words_.end(),
                           [&](const JointWords& words) { return words.side == side && words.part == part; });
    }
    /// The joints with the first of some names that the rig has.
    [[nodiscard]] std::vector<int> candidates(char side, const std::vector<std::string>& parts) const {
        for (const std::string& part : parts)
            if (auto joints = called(side, part); !joints.empty()) return joints;
        return {};
    }

    /// The names of a joint, without those that mean another joint in this rig.
    [[nodiscard]] std::vector<std::string> parts_of(const KnownJoint& known, char side) const {
        std::vector<std::string> parts = known.parts;
        if (known.joint == "collar") {
            const bool arm = at(side == 'l' ? "left_shoulder" : "right_shoulder") >= 0; // by a joint map
            bool other = false;
            for (const KnownJoint& joint : known_side_joints())
                for (const std::string& part : joint.parts)
                    other = other || (joint.joint == "shoulder" && part != "shoulder" && has(side, part));
            if (!other && !arm) std::erase(parts, "shoulder");
        }
        if (known.joint.starts_with("thumb") && !has(side, "thumbmetacarpal") && has(side, "thumbintermediate")) {
            if (known.joint == "thumb1") parts = {"thumbproximal"}; // VRM 0.x begins at the second joint's name
            if (known.joint == "thumb2") parts = {"thumbintermediate"};
        }
        if (known.joint == "hip" && has(side, "knee"))
            parts.emplace_back("leg"); // "Left leg" above "Left knee", of CATS
        if (auto finger = numbered_finger(known.joint, has(side, "finger0")); !finger.empty()) parts.push_back(finger);
        return parts;
    }

    /// The joint above another one, and the one below it, without their sides.
    struct Place {
        std::string_view joint, above, below;
    };
    static Place place_of(std::string_view joint) {
        for (const Place& place : {Place{"hip", "", "knee"},
                                   {"knee", "hip", "ankle"},
                                   {"ankle", "knee", ""},
                                   {"foot", "ankle", ""},
                                   {"shoulder", "", "elbow"},
                                   {"elbow", "shoulder", "wrist"},
                                   {"wrist", "elbow", ""},
                                   {"collar", "", "shoulder"}})
            if (place.joint == joint) return place;
        return {joint, joint.empty() || joint.back() < '1' || joint.back() > '3' ? "" : "wrist", ""}; // fingers
    }

    void find_side_joint(char side, const KnownJoint& known) {
        const std::string prefix = side == 'l' ? "left_" : "right_";
        const Place place = place_of(known.joint);
        const auto matched = [&](std::string_view joint) {
            return joint.empty() ? -1 : at(prefix + std::string(joint));
        };
        const int above = known.joint == "eye" ? at("head") : matched(place.above);
        std::vector<bool> carries(rig_.joint_count(), false); // joints above one that may be the one below
        const auto mark = [&](int below) {
            for (int j = tree_.parent(below); j >= 0 && !carries[static_cast<std::size_t>(j)]; j = tree_.parent(j))
                carries[static_cast<std::size_t>(j)] = true;
        };
        const int known_below = matched(place.below);
        if (known_below >= 0) mark(known_below);
        for (const KnownJoint& other : known_side_joints())
            if (other.joint == place.below && known_below < 0)
                for (const std::string& part : other.parts)
                    for (const int joint : called(side, part)) mark(joint);
        match_fitting(prefix + known.joint, side, parts_of(known, side), [&](int joint) {
            if (above >= 0 && !tree_.is_above(above, joint)) return false;
            return place.below.empty() || carries[static_cast<std::size_t>(joint)];
        });
    }

    /// Head, neck and jaw: above the joint that carries both arms, or on the head.
    void find_of_trunk(const KnownJoint& known) {
        const int above = known.joint == "jaw" ? at("head") : chest();
        match_fitting(known.joint, 0, known.parts,
                      [&](int joint) { return above < 0 || tree_.is_above(above, joint); });
    }

    /// Matches a joint to those called by the first name of which any fits into the tree, or else by the first name. A
    /// helper beside the limb (L_Knee beside L_Calf) or a mesh that is called Head does not fit.
    template <class Fits>
    void match_fitting(const std::string& joint, char side, const std::vector<std::string>& parts, const Fits& fits) {
        for (const std::string& part : parts) {
            std::vector<int> joints = called(side, part);
            std::erase_if(joints, [&](int own) { return !fits(own); });
            if (!joints.empty()) return match(joint, joints);
        }
        match(joint, candidates(side, parts));
    }

    /// The joint that carries both arms, or -1.
    [[nodiscard]] int chest() const {
        const int left = at("left_shoulder"), right = at("right_shoulder");
        return left < 0 || right < 0 || tree_.parent(left) < 0 ? -1 : tree_.common(tree_.parent(left), right);
    }

    static bool is_of_limb(std::string_view joint) {
        for (const std::string_view part : {"pelvis", "hip", "knee", "ankle", "shoulder", "elbow", "wrist"})
            if (joint == part || joint == std::string("left_").append(part) ||
                joint == std::string("right_").append(part))
                return true;
        return false;
    }

    /// Matches a joint, if it is not matched yet, to the best of its candidates.
    void match(std::string_view joint, const std::vector<int>& joints) {
        if (at(joint) >= 0 || joints.empty()) return;
        const int best = *std::min_element(joints.begin(), joints.end(), [&](int a, int b) { return is_better(a, b); });
        at(joint) = best;
        for (const int other : joints)
            used_[static_cast<std::size_t>(other)] = true; // LeftFoot is the ankle or the toes
        if (joints.size() == 1) return;
        bool helpers = true; // names like __LeftArm above LeftArm, as MakeHuman writes them
        std::vector<int> others;
        for (const int other : joints) {
            if (other == best) continue;
            const bool nested = tree_.is_above(other, best) || tree_.is_above(best, other);
            helpers = helpers && nested && PlainName(name(other)).letters == PlainName(name(best)).letters &&
                      PlainName(name(other)).signs != PlainName(name(best)).signs;
            others.push_back(other);
        }
        const std::string named = listing(others.size(), 8, [&](std::size_t i) { return quoted(others[i]); });
        if (is_of_limb(joint) && !helpers)
            conflicts_.push_back(std::string(joint) + " (" + quoted(best) + ", " + named + ")");
        else
            choices_.push_back(std::string(joint) + " is " + quoted(best) + ", not " + named);
    }

    /// Fewer signs first ("Jaw", "__Jaw"), then names that begin with the side ("LeftEye", "EyeLeft"), then the upper.
    [[nodiscard]] bool is_better(int a, int b) const {
        const auto order = [&](int joint) {
            const PlainName plain(name(joint));
            const JointWords& words = words_[static_cast<std::size_t>(joint)];
            const bool behind = words.side != 0 && !plain.letters.ends_with(words.part);
            return std::tuple(plain.signs, behind, tree_.depth(joint), joint);
        };
        return order(a) < order(b);
    }

    /// The hips are above both thighs. A joint that is called so and is not, such as a control of an animator, counts
    /// only if there is no other.
    void find_pelvis() {
        if (at("pelvis") >= 0) return;
        const int left = at("left_hip"), right = at("right_hip");
        const int fork = left >= 0 && right >= 0 ? tree_.common(tree_.parent(left), right) : -1;
        const auto& parts = known_middle_joints().front().parts;
        if (fork >= 0) {
            for (const std::string& part : parts) {
                std::vector<int> joints = called(0, part);
                std::erase_if(joints, [&](int joint) { return !tree_.is_above(joint, fork); });
                if (joints.empty()) continue;
                int lowest = joints[0];
                for (const int joint : joints)
                    if (tree_.is_above(lowest, joint)) lowest = joint;
                if (joints.size() > 1) choices_.push_back("pelvis is " + quoted(lowest) + ", the lowest of that name");
                return take("pelvis", lowest);
            }
            // Where the legs begin, unless it is far from them, as a joint on the ground is.
            const vec3<double> between = tree_.middle(left, right);
            const int knee = at("left_knee");
            const bool near = knee < 0 || tree_.distance(fork, between) <=
                                              0.6 * tree_.distance(left, between) + 0.6 * distance_of(left, knee);
            const auto& names = ambiguous_hips();
            const JointWords& words = words_[static_cast<std::size_t>(fork)];
            if (near && !used_[static_cast<std::size_t>(fork)] && words.side == 0 &&
                std::find(names.begin(), names.end(), words.part) != names.end())
                return take("pelvis", fork);
        }
        match("pelvis", candidates(0, parts));
        if (fork < 0) match("pelvis", called(0, "root"));
    }
    [[nodiscard]] double distance_of(int a, int b) const {
        return rig_.rest_joints.empty() ? 0 : tree_.distance(a, rig_.rest_joints[static_cast<std::size_t>(b)]);
    }

    void find_spine_and_neck() {
        const int pelvis = at("pelvis"), chest = this->chest();
        if (chest < 0 || pelvis < 0) return;
        std::vector<int> spine; // from the hips up
        for (int joint = chest; joint >= 0 && !tree_.is_above(joint, pelvis); joint = tree_.parent(joint))
            if (!used_[static_cast<std::size_t>(joint)]) spine.insert(spine.begin(), joint);
        if (at("spine1") < 0 && at("spine2") < 0 && at("spine3") < 0 && !spine.empty()) {
            const std::size_t n = spine.size();
            at("spine1") = spine[0];
            if (n == 2) at("spine2") = spine[1];
            if (n >= 3) at("spine2") = spine[(n - 1) / 2], at("spine3") = spine[n - 1];
        }
        if (at("head") < 0) find_head_of_spine(chest);
        const int head = at("head");
        if (head < 0 || at("neck") >= 0 || !tree_.is_above(chest, head) || head == chest) return;
        const std::vector<int> above = tree_.between(chest, head);
        if (!above.empty() && !used_[static_cast<std::size_t>(above[0])]) at("neck") = above[0];
    }
    /// In Rigify all joints from the hips to the head are called spine: the last one above the chest is the head.
    void find_head_of_spine(int chest) {
        int last = -1;
        for (std::size_t j = 0; j < words_.size(); ++j) {
            const auto joint = static_cast<int>(j);
            if (words_[j].side == 0 && words_[j].part.starts_with("spine") && joint != chest &&
                tree_.is_above(chest, joint) && !used_[j] && (last < 0 || tree_.is_above(last, joint)))
                last = joint;
        }
        if (last >= 0) take("head", last);
    }
};

} // namespace detail

} // namespace gsh
