// SPDX-License-Identifier: Apache-2.0
/// @file  Which joint of a rig plays the part of which joint of SMPL-X, by the names that programs give them.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// The joint of a rig for each joint of SMPL-X, -1 where there is none.
using MatchedJoints = std::array<int, smplx_joint_names.size()>;

/// Finds the joints of a rig by name. Known are the names of SMPL-X, Mixamo, VRM, CMU and other BVH files, MHR, Unreal,
/// 3ds Max Biped and Rigify, with any prefix up to a colon.
///
/// Three parts are found by their place in the tree. The spine is the chain from the hips to the joint that carries
/// both arms: of n bones, the first is spine1, the last of three or more is spine3, one between them spine2. The neck
/// is the first joint between that one and the head. LeftShoulder is the collar where the side has an upper arm of
/// another name (Mixamo, VRM), else the upper arm (SMPL-X, BVH with LeftCollar); LeftFoot, LeftHand and LeftHip
/// likewise.
struct JointMap {
    /// Names that take precedence: a rig's joint → a joint of SMPL-X, or "" for a joint that is to be left out.
    std::map<std::string, std::string, std::less<>> named;

    /// Errors  ValueError if two joints of the rig qualify for one part, or if `named` holds a joint that SMPL-X or the
    ///         rig does not have.
    [[nodiscard]] MatchedJoints match(const RigMotion& rig, std::string_view where) const;
};

/// Throws ValueError, with the names of all joints, unless hips, thighs, knees, upper arms and elbows are matched.
inline void check_limbs(const RigMotion& rig, const MatchedJoints& matched, std::string_view where);

/// Up to `most` names, "and 12 more" after them.
[[nodiscard]] inline std::string list_of_names(const std::vector<std::string>& names, std::size_t most = 12);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

using JointParts = std::vector<std::string_view>;

/// Parts of names for joints of the middle and of one side; earlier ones are preferred.
struct KnownJoint {
    std::string_view joint; ///< of SMPL-X, without its side
    JointParts parts;
};
// clang-format off
inline const std::vector<KnownJoint>& known_middle_joints() {
    static const std::vector<KnownJoint> joints = {
        {"pelvis", {"hips", "hip", "pelvis", "hipscenter", "root"}}, {"neck", {"neck", "neck1"}},
        {"head", {"head"}}, {"jaw", {"jaw"}},
        {"spine1", {}}, {"spine2", {}}, {"spine3", {}}, // by their place
    };
    return joints;
}
inline const std::vector<KnownJoint>& known_side_joints() {
    static const std::vector<KnownJoint> joints = {
        {"hip", {"upleg", "upperleg", "thigh", "hip"}}, {"knee", {"knee", "lowerleg", "lowleg", "calf", "shin", "leg"}},
        {"ankle", {"ankle", "foot"}}, {"foot", {"toebase", "toes", "toe", "ball", "toe0", "foot"}},
        {"collar", {"collar", "clavicle", "collarbone", "shoulder"}},
        {"shoulder", {"upperarm", "uparm", "arm", "shldr", "shoulder"}},
        {"elbow", {"elbow", "forearm", "lowerarm", "lowarm"}}, {"wrist", {"wrist", "hand"}},
        {"eye", {"eye", "eyeball", "eyesmplhf"}},
        {"index1", {"index1", "handindex1", "indexproximal", "findex1"}},
        {"index2", {"index2", "handindex2", "indexintermediate", "findex2"}},
        {"index3", {"index3", "handindex3", "indexdistal", "findex3"}},
        {"middle1", {"middle1", "handmiddle1", "middleproximal", "fmiddle1"}},
        {"middle2", {"middle2", "handmiddle2", "middleintermediate", "fmiddle2"}},
        {"middle3", {"middle3", "handmiddle3", "middledistal", "fmiddle3"}},
        {"pinky1", {"pinky1", "handpinky1", "littleproximal", "fpinky1"}},
        {"pinky2", {"pinky2", "handpinky2", "littleintermediate", "fpinky2"}},
        {"pinky3", {"pinky3", "handpinky3", "littledistal", "fpinky3"}},
        {"ring1", {"ring1", "handring1", "ringproximal", "fring1"}},
        {"ring2", {"ring2", "handring2", "ringintermediate", "fring2"}},
        {"ring3", {"ring3", "handring3", "ringdistal", "fring3"}},
        {"thumb1", {"thumb1", "handthumb1", "thumbmetacarpal", "thumb"}}, // VRM 0.x: below
        {"thumb2", {"thumb2", "handthumb2", "thumbproximal"}},
        {"thumb3", {"thumb3", "handthumb3", "thumbdistal"}},
    };
    return joints;
}
// clang-format on

/// One side's joints, or those of the middle, as words.
class JointFinder {
public:
    JointFinder(const RigMotion& rig, const JointMap& map, std::string_view where) : rig_(rig), where_(where) {
        matched_.fill(-1);
        used_.assign(rig.joint_count(), false);
        for (const auto& [own, joint] : map.named) take_named(own, joint);
        for (std::size_t j = 0; j < rig.joint_count(); ++j) words_.push_back(joint_words(rig.names[j]));
    }

    MatchedJoints find() {
        for (const auto& known : known_middle_joints()) find_one("", 0, known.joint, known.parts);
        for (const char side : {'l', 'r'}) {
            const std::string prefix = side == 'l' ? "left_" : "right_";
            for (const auto& known : known_side_joints()) find_one(prefix, side, known.joint, parts_of(known, side));
        }
        find_spine_and_neck();
        return matched_;
    }

private:
    const RigMotion& rig_;
    std::string_view where_;
    std::vector<JointWords> words_;
    std::vector<bool> used_; // joints that are matched already, or left out by JointMap::named
    MatchedJoints matched_;

    int& at(std::string_view joint) { return matched_[static_cast<std::size_t>(smplx_joint(joint))]; }
    [[nodiscard]] int at(std::string_view joint) const {
        return matched_[static_cast<std::size_t>(smplx_joint(joint))];
    }

    void take_named(const std::string& own, const std::string& joint) {
        const auto found = std::find(rig_.names.begin(), rig_.names.end(), own);
        check_value(found != rig_.names.end(), where_,
                    "the joint map names '" + own +
                        "', which is not a joint of this rig: " + list_of_names(rig_.names, 200));
        const auto j = static_cast<std::size_t>(found - rig_.names.begin());
        used_[j] = true;
        if (joint.empty()) return;
        check_value(smplx_joint(joint) >= 0, where_,
                    "the joint map assigns '" + own + "' to '" + joint +
                        "', expected a joint of SMPL-X such as "
                        "left_elbow");
        int& matched = at(joint);
        check_value(matched < 0, where_,
                    "the joint map assigns '" + joint + "' twice, to '" + own + "' and to another joint");
        matched = static_cast<int>(j);
    }

    [[nodiscard]] bool has(char side, std::string_view part) const {
        for (std::size_t j = 0; j < words_.size(); ++j)
            if (words_[j].side == side && words_[j].part == part) return true;
        return false;
    }
    [[nodiscard]] bool has_any(char side, const JointParts& parts) const {
        return std::any_of(parts.begin(), parts.end(), [&](std::string_view part) { return has(side, part); });
    }

    /// The names of a joint, without those that mean another joint in this rig.
    [[nodiscard]] JointParts parts_of(const KnownJoint& known, char side) const {
        JointParts parts = known.parts;
        const auto drop = [&](std::string_view part) { std::erase(parts, part); };
        const bool left = side == 'l'; // a joint map may name the joint, too
        if (known.joint == "collar" && !has_any(side, {"upperarm", "uparm", "arm", "shldr"}) &&
            at(left ? "left_shoulder" : "right_shoulder") < 0)
            drop("shoulder");
        if (known.joint.starts_with("thumb") && !has(side, "thumbmetacarpal") && has(side, "thumbintermediate")) {
            if (known.joint == "thumb1") parts = {"thumbproximal"}; // VRM 0.x begins at the second joint's name
            if (known.joint == "thumb2") parts = {"thumbintermediate"};
        }
        return parts;
    }

    void find_one(const std::string& prefix, char side, std::string_view joint, const JointParts& parts) {
        int& matched = at(prefix + std::string(joint));
        if (matched >= 0) return;
        for (const std::string_view part : parts) {
            for (std::size_t j = 0; j < words_.size(); ++j) {
                if (used_[j] || words_[j].side != side || words_[j].part != part) continue;
                check_value(matched < 0, where_,
                            "the joints '" + rig_.names[static_cast<std::size_t>(std::max(matched, 0))] + "' and '" +
                                rig_.names[j] + "' could both be " + prefix + std::string(joint) +
                                "; choose one in a joint map");
                matched = static_cast<int>(j);
            }
            if (matched >= 0) used_[static_cast<std::size_t>(matched)] = true; // LeftFoot is the ankle or the toes
            if (matched >= 0) return;
        }
    }

    /// The joints from `joint`'s parent up to the root.
    [[nodiscard]] std::vector<int> ancestors(int joint) const {
        std::vector<int> chain;
        while (joint >= 0 && (joint = rig_.parents[static_cast<std::size_t>(joint)]) >= 0) chain.push_back(joint);
        return chain;
    }

    void find_spine_and_neck() {
        const int left = at("left_shoulder"), right = at("right_shoulder"), pelvis = at("pelvis");
        if (left < 0 || right < 0 || pelvis < 0) return;
        std::vector<int> below_hips = ancestors(pelvis); // where the way up ends
        below_hips.push_back(pelvis);
        const auto contains = [](const std::vector<int>& chain, int joint) {
            return std::find(chain.begin(), chain.end(), joint) != chain.end();
        };
        const std::vector<int> of_right = ancestors(right);
        int chest = -1;
        for (const int joint : ancestors(left))
            if (contains(of_right, joint)) {
                chest = joint;
                break;
            }
        std::vector<int> spine; // from the hips up
        for (int joint = chest; joint >= 0 && !contains(below_hips, joint);
             joint = rig_.parents[static_cast<std::size_t>(joint)])
            if (!used_[static_cast<std::size_t>(joint)]) spine.insert(spine.begin(), joint);
        if (at("spine1") < 0 && at("spine2") < 0 && at("spine3") < 0 && !spine.empty()) {
            const std::size_t n = spine.size();
            at("spine1") = spine[0];
            if (n == 2) at("spine2") = spine[1];
            if (n >= 3) at("spine2") = spine[(n - 1) / 2], at("spine3") = spine[n - 1];
        }
        if (at("head") < 0 || at("neck") >= 0 || chest < 0) return;
        int first = -1;
        for (int joint = rig_.parents[static_cast<std::size_t>(at("head"))]; joint >= 0 && joint != chest;
             joint = rig_.parents[static_cast<std::size_t>(joint)])
            first = joint;
        const bool beside = first >= 0 && !contains(ancestors(at("head")), chest); // the head hangs on another branch
        if (first >= 0 && !beside && !used_[static_cast<std::size_t>(first)]) at("neck") = first;
    }
};

} // namespace detail

inline std::string list_of_names(const std::vector<std::string>& names, std::size_t most) {
    std::string text;
    for (std::size_t i = 0; i < std::min(most, names.size()); ++i)
        text += (i ? ", " : "") + detail::shortened(names[i]);
    if (names.size() > most) text += " and " + std::to_string(names.size() - most) + " more";
    return text;
}

inline MatchedJoints JointMap::match(const RigMotion& rig, std::string_view where) const {
    return detail::JointFinder(rig, *this, where).find();
}

inline void check_limbs(const RigMotion& rig, const MatchedJoints& matched, std::string_view where) {
    std::vector<std::string> missing;
    for (const std::string_view joint : {"pelvis", "left_hip", "left_knee", "right_hip", "right_knee", "left_shoulder",
                                         "left_elbow", "right_shoulder", "right_elbow"})
        if (matched[static_cast<std::size_t>(smplx_joint(joint))] < 0) missing.emplace_back(joint);
    if (missing.empty()) return;
    throw ValueError(std::string(where) + ": no joint was found for " + list_of_names(missing) +
                     "; name them in a joint map (--joint-map FILE.json). The joints are " +
                     list_of_names(rig.names, 200));
}

} // namespace gsh
