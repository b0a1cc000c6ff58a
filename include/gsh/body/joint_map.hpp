// SPDX-License-Identifier: Apache-2.0
/// @file  Which joint of a rig plays the part of which joint of SMPL-X, by the names that programs give them.
#pragma once

#include <gsh/body/joint_finder.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// Finds the joints of a rig by name. Known are the names of SMPL-X, Mixamo, VRM, CMU (BVH and ASF) and other BVH
/// files, MHR, Unreal, 3ds Max Biped, Rigify, DAZ Genesis, Character Creator, MakeHuman, MocapNET, Kinect, ARKit,
/// Roblox, Second Life and others (body/joint_name_table.hpp), with any prefix up to a colon, and with words that most
/// names share.
///
/// Three parts are found by their place in the tree. The hips are above both thighs. The spine is the chain from the
/// hips to the joint that carries both arms: of n bones, the first is spine1, the last of three or more is spine3, one
/// between them spine2. The neck is the first joint between that one and the head. LeftShoulder is the collar where the
/// side has an upper arm of another name (Mixamo, VRM), else the upper arm (SMPL-X, BVH with LeftCollar); LeftFoot,
/// LeftHand and LeftHip likewise.
///
/// Of several candidates for a joint that moves no limb (eyes, jaw, fingers, toes, neck), the one with the plainest
/// name is taken, with a warning.
struct JointMap {
    /// Names that take precedence: a rig's joint → a joint of SMPL-X, or "" for a joint that is to be left out.
    std::map<std::string, std::string, std::less<>> named;

    /// Errors  ValueError that lists all joints of limbs for which several joints of the rig qualify; or if `named`
    ///         holds a joint that SMPL-X or the rig does not have.
    [[nodiscard]] MatchedJoints match(const RigMotion& rig, std::string_view where,
                                      std::vector<std::string>* warnings = nullptr) const;
};

/// Throws ValueError, with the names of all joints, unless hips, thighs, knees, upper arms and elbows are matched.
inline void check_limbs(const RigMotion& rig, const MatchedJoints& matched, std::string_view where);

// -------------------------------------------------------------------------------------------------------------

inline MatchedJoints JointMap::match(const RigMotion& rig, std::string_view where,
                                     std::vector<std::string>* warnings) const {
    return detail::JointFinder(rig, named, where).find(warnings);
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
