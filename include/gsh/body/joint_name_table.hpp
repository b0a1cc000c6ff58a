// SPDX-License-Identifier: Apache-2.0
/// @file  What programs call the joints of a person: the table of names, without sides and signs.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// The names of one joint, in lower case, as joint_words makes them. Earlier ones are preferred.
struct KnownJoint {
    std::string joint; ///< of SMPL-X, without its side
    std::vector<std::string> parts;
};

/// Joints of the middle, without the spine, which is found by its place in the tree.
///
/// Source  files and documents of the programs. hipcenter, spinebase: Kinect 1 and 2; lowertorso: Roblox R15;
///         lowerneck: CMU's ASF; necktwist, jawroot: Reallusion's Character Creator; necklower, lowerjaw: DAZ Genesis;
///         facejaw: Second Life; head1: ValveBiped.
[[nodiscard]] inline const std::vector<KnownJoint>& known_middle_joints() {
    static const std::vector<KnownJoint> joints = {
        {"pelvis", {"hips", "hip", "pelvis", "hipscenter", "hipcenter", "spinebase", "lowertorso"}},
        {"neck", {"neck", "neck1", "lowerneck", "necklower", "necktwist1"}},
        {"head", {"head", "head1"}},
        {"jaw", {"jaw", "lowerjaw", "jawroot", "facejaw"}},
    };
    return joints;
}

/// Names of the hips that mean other joints elsewhere: root (MHR, CMU's ASF, SMPL's FBX; else a joint on the ground)
/// and spine (Blender's Rigify; else the first joint above the hips). They count where both legs begin at them.
[[nodiscard]] inline const std::vector<std::string>& ambiguous_hips() {
    static const std::vector<std::string> names = {"root", "spine"};
    return names;
}

/// Joints of one side, with all fingers.
///
/// Source  as above. femur, tibia, humerus, radius: CMU's ASF; …bend: DAZ Genesis 3 and 8; shldr: Poser, DAZ; upperleg1
///         and others with a 1: MakeHuman, whose limbs have two bones; loarm, loleg: its older rig; …stretch: Auto-Rig
///         Pro; uarm, farm: OptiTrack; scapula, …finger1: Advanced Skeleton; mid1: DAZ, Character Creator; findex1:
///         Rigify (f_index.01); shoulder1: ARKit, MakeHuman.
[[nodiscard]] inline const std::vector<KnownJoint>& known_side_joints() {
    static const std::vector<KnownJoint> joints = [] {
        std::vector<KnownJoint> list = {
            {"hip", {"upleg", "upperleg", "thigh", "thighbend", "thighstretch", "femur", "upperleg1", "hip"}},
            {"knee",
             {"knee", "lowerleg", "lowleg", "loleg", "calf", "shin", "tibia", "legstretch", "lowerleg1", "leg"}},
            {"ankle", {"ankle", "foot"}},
            {"foot", {"toebase", "toes", "toe", "ball", "toe0", "toes1", "forefoot", "foot"}},
            {"shoulder",
             {"upperarm", "uparm", "arm", "shldr", "shldrbend", "armstretch", "humerus", "upperarm1", "uarm",
              "shoulder"}},
            {"elbow",
             {"elbow", "forearm", "forearmbend", "lowerarm", "lowarm", "loarm", "forearmstretch", "radius", "lowerarm1",
              "farm"}},
            {"collar", {"collar", "clavicle", "collarbone", "scapula", "shoulder", "shoulder1"}},
            {"wrist", {"wrist", "hand"}},
            {"eye", {"eye", "eyeball", "eyesmplhf"}},
        };
        struct Finger {
            std::string joint;
            std::vector<std::string> words;
            std::vector<std::string> phalanges; ///< of VRM and OpenXR
        };
        const std::vector<std::string> usual = {"proximal", "intermediate", "distal"};
        for (const Finger& finger : {Finger{"index", {"index"}, usual}, Finger{"middle", {"middle", "mid"}, usual},
                                     Finger{"pinky", {"pinky", "little"}, usual}, Finger{"ring", {"ring"}, usual},
                                     Finger{"thumb", {"thumb"}, {"metacarpal", "proximal", "distal"}}})
            for (std::size_t n = 0; n < 3; ++n) {
                const std::string number = std::to_string(n + 1);
                KnownJoint known{finger.joint + number, {}};
                for (const std::string& word : finger.words)
                    for (const std::string& part : {word + number, "hand" + word + number, word + finger.phalanges[n],
                                                    "f" + word + number, word + "finger" + number})
                        known.parts.push_back(part);
                for (const std::string& word : finger.words) // a finger of one joint
                    if (n == 0) known.parts.push_back(word), known.parts.push_back("hand" + word);
                list.push_back(known);
            }
        return list;
    }();
    return joints;
}

/// Fingers by number: those of 3ds Max Biped (Finger0, Finger01, Finger02 are the thumb, Finger1, Finger11, Finger12
/// the index), and of MakeHuman (finger1-1, finger1-2, finger1-3 are the thumb, finger2-1 … the index). Empty for
/// others.
[[nodiscard]] inline std::string numbered_finger(std::string_view joint, bool biped) {
    static const std::vector<std::string> fingers = {"thumb", "index", "middle", "ring", "pinky"};
    if (joint.empty()) return {};
    const auto found = std::find(fingers.begin(), fingers.end(), joint.substr(0, joint.size() - 1));
    if (found == fingers.end()) return {};
    const auto finger = static_cast<int>(found - fingers.begin()), phalanx = joint.back() - '1';
    if (!biped) return "finger" + std::to_string(finger + 1) + std::to_string(phalanx + 1);
    return "finger" + std::to_string(finger) + (phalanx == 0 ? "" : std::to_string(phalanx));
}

/// Whether a word is the name of a joint, and with `sided` of one that a left and a right side have.
[[nodiscard]] inline bool is_known_part(std::string_view word, bool sided) {
    const auto in = [&](const std::vector<KnownJoint>& joints) {
        for (const KnownJoint& known : joints)
            if (std::find(known.parts.begin(), known.parts.end(), word) != known.parts.end()) return true;
        return false;
    };
    return in(known_side_joints()) || (!sided && in(known_middle_joints()));
}

} // namespace gsh
