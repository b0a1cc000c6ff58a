// SPDX-License-Identifier: Apache-2.0
/// @file  Complete lists of the joints' names that programs write, with the tree of a person.
#pragma once

#include <gsh/body/joint_names.hpp>
#include <gsh/body/rig_motion.hpp>

#include <cstddef>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::test {

/// The names of one program. "@" stands for a side.
struct RigNames {
    std::string program, left, right;
    std::vector<std::pair<std::string, std::string>> names; ///< joint of SMPL-X without its side, name
    /// Joints that are none of SMPL-X: name, and the part below which it hangs; with a third part, that one hangs on
    /// it.
    struct Other {
        std::string name, above, below;
    };
    std::vector<Other> others;
};

/// Names of fingers 1 to 3: {"index1", "@Index1"}, …; `name` takes the program's word for a finger and the number.
inline std::vector<std::pair<std::string, std::string>>
fingers(const std::map<std::string, std::string>& words,
        const std::function<std::string(const std::string&, int)>& name) {
    std::vector<std::pair<std::string, std::string>> result;
    for (const auto& [finger, word] : words)
        for (int n = 1; n <= 3; ++n) result.emplace_back(finger + std::to_string(n), name(word, n));
    return result;
}
inline std::map<std::string, std::string> usual_fingers(const std::string& middle = "Mid",
                                                        const std::string& pinky = "Pinky") {
    return {{"thumb", "Thumb"}, {"index", "Index"}, {"middle", middle}, {"ring", "Ring"}, {"pinky", pinky}};
}
inline std::string lower_case(std::string text) {
    for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return text;
}

inline std::vector<RigNames> known_rigs() {
    const auto number = [](int n) { return std::to_string(n); };
    const auto joined = [](std::vector<std::pair<std::string, std::string>> a,
                           const std::vector<std::pair<std::string, std::string>>& b) {
        a.insert(a.end(), b.begin(), b.end());
        return a;
    };
    std::vector<RigNames> rigs;
    const std::vector<std::pair<std::string, std::string>> mixamo =
        joined({{"pelvis", "Hips"},
                {"spine1", "Spine"},
                {"spine2", "Spine1"},
                {"spine3", "Spine2"},
                {"neck", "Neck"},
                {"head", "Head"},
                {"hip", "@UpLeg"},
                {"knee", "@Leg"},
                {"ankle", "@Foot"},
                {"foot", "@ToeBase"},
                {"collar", "@Shoulder"},
                {"shoulder", "@Arm"},
                {"elbow", "@ForeArm"},
                {"wrist", "@Hand"}},
               fingers(usual_fingers("Middle"), [&](const auto& f, int n) { return "@Hand" + f + number(n); }));
    int count = 0;
    const auto renamed = [&](const std::string& program, const std::function<std::string(const std::string&)>& name) {
        RigNames rig{program, "Left", "Right", mixamo, {}};
        for (auto& [part, own] : rig.names) own = name(own);
        rig.others.push_back({name("@HandThumb4"), "thumb3", ""});
        rigs.push_back(rig);
    };
    renamed("Mixamo", [](const auto& n) { return "mixamorig:" + n; });
    renamed("Decentraland", [](const auto& n) { return "Avatar_" + n; });
    renamed("Blender's copies", [](const auto& n) { return n + ".001"; });
    renamed("Blender's copies, without the point", [](const auto& n) { return n + "001"; });
    renamed("Armature|", [](const auto& n) { return "Armature|" + n; });
    renamed("a path", [](const auto& n) { return "Geo|Root|" + n; });
    renamed("two namespaces", [](const auto& n) { return "scene:actor:" + n; });
    renamed("_jnt", [](const auto& n) { return n + "_jnt"; });
    renamed("QuickRig", [](const auto& n) { return "QuickRigCharacter_" + n; });
    // A number for each node: the left side's are even, the right side's odd (below).
    renamed("Sketchfab", [&](const auto& n) { return "mixamorig:" + n + "_0" + number(2 * ++count) + "#"; });
    renamed("Sketchfab, twice", [&](const auto& n) { return n + "_0" + number(2 * ++count) + "#_00"; });
    rigs.push_back({"SMPL's FBX",
                    "L",
                    "R",
                    {{"pelvis", "m_avg_Pelvis"},
                     {"spine1", "m_avg_Spine1"},
                     {"spine2", "m_avg_Spine2"},
                     {"spine3", "m_avg_Spine3"},
                     {"neck", "m_avg_Neck"},
                     {"head", "m_avg_Head"},
                     {"hip", "m_avg_@_Hip"},
                     {"knee", "m_avg_@_Knee"},
                     {"ankle", "m_avg_@_Ankle"},
                     {"foot", "m_avg_@_Foot"},
                     {"collar", "m_avg_@_Collar"},
                     {"shoulder", "m_avg_@_Shoulder"},
                     {"elbow", "m_avg_@_Elbow"},
                     {"wrist", "m_avg_@_Wrist"}},
                    {{"m_avg_root", "", "pelvis"}, {"m_avg_@_Hand", "wrist", ""}}});
    rigs.push_back(rigs.back());
    rigs.back().program += " of a woman";
    for (auto& [part, name] : rigs.back().names) name[0] = 'f';
    for (auto& other : rigs.back().others) other.name[0] = 'f';
    rigs.push_back(
        {"Character Creator",
         "L",
         "R",
         joined({{"pelvis", "CC_Base_Hip"},
                 {"spine1", "CC_Base_Waist"},
                 {"spine2", "CC_Base_Spine01"},
                 {"spine3", "CC_Base_Spine02"},
                 {"neck", "CC_Base_NeckTwist01"},
                 {"head", "CC_Base_Head"},
                 {"jaw", "CC_Base_JawRoot"},
                 {"eye", "CC_Base_@_Eye"},
                 {"hip", "CC_Base_@_Thigh"},
                 {"knee", "CC_Base_@_Calf"},
                 {"ankle", "CC_Base_@_Foot"},
                 {"foot", "CC_Base_@_ToeBase"},
                 {"collar", "CC_Base_@_Clavicle"},
                 {"shoulder", "CC_Base_@_Upperarm"},
                 {"elbow", "CC_Base_@_Forearm"},
                 {"wrist", "CC_Base_@_Hand"}},
                fingers(usual_fingers(), [&](const auto& f, int n) { return "CC_Base_@_" + f + number(n); })),
         {{"RL_BoneRoot", "", "pelvis"},
          {"CC_Base_Pelvis", "pelvis", "hip"},
          {"CC_Base_NeckTwist02", "neck", "head"},
          {"CC_Base_@_ThighTwist01", "hip", ""},
          {"CC_Base_@_KneeShareBone", "knee", ""},
          {"CC_Base_@_ToeBaseShareBone", "ankle", ""},
          {"CC_Base_@_UpperarmTwist01", "shoulder", ""}}});
    rigs.push_back({"MocapNET",
                    "l",
                    "r",
                    {{"pelvis", "hip"},    {"spine1", "abdomen"}, {"spine2", "chest"},       {"neck", "neck"},
                     {"head", "head"},     {"jaw", "jaw"},        {"hip", "@hip"},           {"knee", "@knee"},
                     {"ankle", "@foot"},   {"collar", "@collar"}, {"shoulder", "@shoulder"}, {"elbow", "@elbow"},
                     {"wrist", "@hand"},   {"index1", "@index1"}, {"index2", "@index2"},     {"middle1", "@mid1"},
                     {"middle2", "@mid2"}, {"ring1", "@ring1"},   {"pinky1", "@pinky1"},     {"thumb1", "@thumb1"}},
                    {{"neck1", "neck", "head"}, {"special04", "jaw", ""}, {"@buttock", "pelvis", "hip"}}});
    rigs.push_back({"CMU's ASF",
                    "l",
                    "r",
                    {{"pelvis", "root"},
                     {"spine1", "lowerback"},
                     {"spine2", "upperback"},
                     {"spine3", "thorax"},
                     {"neck", "lowerneck"},
                     {"head", "head"},
                     {"hip", "@femur"},
                     {"knee", "@tibia"},
                     {"ankle", "@foot"},
                     {"foot", "@toes"},
                     {"collar", "@clavicle"},
                     {"shoulder", "@humerus"},
                     {"elbow", "@radius"},
                     {"wrist", "@wrist"},
                     {"thumb1", "@thumb"}},
                    {{"upperneck", "neck", "head"}, {"@hipjoint", "pelvis", "hip"}, {"@hand", "wrist", "thumb1"}}});
    rigs.push_back({"Kinect 1",
                    "Left",
                    "Right",
                    {{"pelvis", "HipCenter"},
                     {"spine1", "Spine"},
                     {"spine2", "ShoulderCenter"},
                     {"head", "Head"},
                     {"hip", "Hip@"},
                     {"knee", "Knee@"},
                     {"ankle", "Ankle@"},
                     {"foot", "Foot@"},
                     {"shoulder", "Shoulder@"},
                     {"elbow", "Elbow@"},
                     {"wrist", "Wrist@"}},
                    {{"Hand@", "wrist", ""}}});
    rigs.push_back({"Kinect 2",
                    "Left",
                    "Right",
                    {{"pelvis", "SpineBase"},
                     {"spine1", "SpineMid"},
                     {"spine2", "SpineShoulder"},
                     {"neck", "Neck"},
                     {"head", "Head"},
                     {"hip", "Hip@"},
                     {"knee", "Knee@"},
                     {"ankle", "Ankle@"},
                     {"foot", "Foot@"},
                     {"shoulder", "Shoulder@"},
                     {"elbow", "Elbow@"},
                     {"wrist", "Wrist@"},
                     {"thumb1", "Thumb@"}},
                    {{"Hand@", "wrist", "thumb1"}, {"HandTip@", "wrist", ""}}});
    rigs.push_back({"Azure Kinect",
                    "LEFT",
                    "RIGHT",
                    {{"pelvis", "PELVIS"},
                     {"spine1", "SPINE_NAVEL"},
                     {"spine2", "SPINE_CHEST"},
                     {"neck", "NECK"},
                     {"head", "HEAD"},
                     {"eye", "EYE_@"},
                     {"hip", "HIP_@"},
                     {"knee", "KNEE_@"},
                     {"ankle", "ANKLE_@"},
                     {"foot", "FOOT_@"},
                     {"collar", "CLAVICLE_@"},
                     {"shoulder", "SHOULDER_@"},
                     {"elbow", "ELBOW_@"},
                     {"wrist", "WRIST_@"},
                     {"thumb1", "THUMB_@"}},
                    {{"NOSE", "head", ""}, {"EAR_@", "head", ""}, {"HANDTIP_@", "wrist", ""}}});
    rigs.push_back({"Roblox R15",
                    "Left",
                    "Right",
                    {{"pelvis", "LowerTorso"},
                     {"spine1", "UpperTorso"},
                     {"head", "Head"},
                     {"hip", "@UpperLeg"},
                     {"knee", "@LowerLeg"},
                     {"ankle", "@Foot"},
                     {"shoulder", "@UpperArm"},
                     {"elbow", "@LowerArm"},
                     {"wrist", "@Hand"}},
                    {{"HumanoidRootPart", "", "pelvis"}}});
    rigs.push_back(
        {"Second Life",
         "Left",
         "Right",
         joined({{"pelvis", "mPelvis"},
                 {"spine1", "mSpine1"},
                 {"spine2", "mTorso"},
                 {"spine3", "mChest"},
                 {"neck", "mNeck"},
                 {"head", "mHead"},
                 {"jaw", "mFaceJaw"},
                 {"eye", "mEye@"},
                 {"hip", "mHip@"},
                 {"knee", "mKnee@"},
                 {"ankle", "mAnkle@"},
                 {"foot", "mToe@"},
                 {"collar", "mCollar@"},
                 {"shoulder", "mShoulder@"},
                 {"elbow", "mElbow@"},
                 {"wrist", "mWrist@"}},
                fingers(usual_fingers("Middle"), [&](const auto& f, int n) { return "mHand" + f + number(n) + "@"; })),
         {{"mSpine2", "spine1", "spine2"},
          {"mSpine3", "spine2", "spine3"},
          {"mFoot@", "ankle", "foot"},
          {"mSkull", "head", ""},
          {"mGroin", "pelvis", ""},
          {"mHindLimb1@", "pelvis", ""},
          {"mTail1", "pelvis", ""},
          {"PELVIS", "pelvis", ""},
          {"BELLY", "spine2", ""}}});
    rigs.push_back({"DAZ Genesis 2",
                    "l",
                    "r",
                    {{"pelvis", "hip"},
                     {"spine1", "abdomen"},
                     {"spine2", "abdomen2"},
                     {"spine3", "chest"},
                     {"neck", "neck"},
                     {"head", "head"},
                     {"hip", "@Thigh"},
                     {"knee", "@Shin"},
                     {"ankle", "@Foot"},
                     {"foot", "@Toe"},
                     {"collar", "@Collar"},
                     {"shoulder", "@Shldr"},
                     {"elbow", "@ForeArm"},
                     {"wrist", "@Hand"}},
                    {{"pelvis", "pelvis", "hip"}}});
    rigs.push_back({"DAZ Genesis 8",
                    "l",
                    "r",
                    joined({{"pelvis", "hip"},
                            {"spine1", "abdomenLower"},
                            {"spine2", "abdomenUpper"},
                            {"spine3", "chestUpper"},
                            {"neck", "neckLower"},
                            {"head", "head"},
                            {"jaw", "lowerJaw"},
                            {"eye", "@Eye"},
                            {"hip", "@ThighBend"},
                            {"knee", "@Shin"},
                            {"ankle", "@Foot"},
                            {"foot", "@Toe"},
                            {"collar", "@Collar"},
                            {"shoulder", "@ShldrBend"},
                            {"elbow", "@ForearmBend"},
                            {"wrist", "@Hand"}},
                           fingers(usual_fingers(), [&](const auto& f, int n) { return "@" + f + number(n); })),
                    {{"pelvis", "pelvis", "hip"},
                     {"chestLower", "spine2", "spine3"},
                     {"neckUpper", "neck", "head"},
                     {"@ThighTwist", "hip", "knee"},
                     {"@ShldrTwist", "shoulder", "elbow"},
                     {"@ForearmTwist", "elbow", "wrist"},
                     {"@Metatarsals", "ankle", "foot"},
                     {"@Carpal1", "wrist", "index1"},
                     {"@BigToe", "foot", ""}}});
    rigs.push_back(
        {"DAZ Genesis 9",
         "l",
         "r",
         joined({{"pelvis", "hip"},
                 {"spine1", "spine1"},
                 {"spine2", "spine2"},
                 {"spine3", "spine4"},
                 {"neck", "neck1"},
                 {"head", "head"},
                 {"jaw", "lowerjaw"},
                 {"eye", "@_eye"},
                 {"hip", "@_thigh"},
                 {"knee", "@_shin"},
                 {"ankle", "@_foot"},
                 {"foot", "@_toes"},
                 {"collar", "@_shoulder"},
                 {"shoulder", "@_upperarm"},
                 {"elbow", "@_forearm"},
                 {"wrist", "@_hand"}},
                fingers(usual_fingers(), [&](const auto& f, int n) { return "@_" + lower_case(f) + number(n); })),
         {{"pelvis", "pelvis", "hip"},
          {"spine3", "spine2", "spine3"},
          {"neck2", "neck", "head"},
          {"@_thightwist1", "hip", ""},
          {"@_upperarmtwist1", "shoulder", ""},
          {"@_forearmtwist1", "elbow", ""},
          {"@_metatarsals", "ankle", "foot"},
          {"@_indexmetacarpal", "wrist", "index1"}}});
    for (const std::string prefix : {"", "DEF-", "ORG-"}) {
        rigs.push_back({"Rigify " + prefix,
                        "L",
                        "R",
                        joined({{"pelvis", "spine"},
                                {"spine1", "spine.001"},
                                {"spine2", "spine.002"},
                                {"spine3", "spine.003"},
                                {"neck", "spine.004"},
                                {"head", "spine.006"},
                                {"jaw", "jaw"},
                                {"eye", "eye.@"},
                                {"hip", "thigh.@"},
                                {"knee", "shin.@"},
                                {"ankle", "foot.@"},
                                {"foot", "toe.@"},
                                {"collar", "shoulder.@"},
                                {"shoulder", "upper_arm.@"},
                                {"elbow", "forearm.@"},
                                {"wrist", "hand.@"}},
                               fingers(usual_fingers("Middle"),
                                       [&](const auto& f, int n) {
                                           return (f == "Thumb" ? "" : "f_") + lower_case(f) + ".0" + number(n) + ".@";
                                       })),
                        {{"spine.005", "neck", "head"},
                         {"pelvis.@", "pelvis", ""},
                         {"palm.01.@", "wrist", "index1"},
                         {"heel.02.@", "ankle", ""},
                         {"breast.@", "spine3", ""}}});
        for (auto& [part, name] : rigs.back().names) name = prefix + name;
        for (auto& other : rigs.back().others) other.name = prefix + other.name;
    }
    // A whole rig of Rigify, whose other layers hold each limb again, and whose controls are called hips and head.
    rigs.push_back(rigs[rigs.size() - 2]);
    rigs.back().program = "Rigify, whole";
    rigs.back().others.push_back({"root", "", "pelvis"});
    for (const std::string layer : {"ORG-", "MCH-", ""})
        for (const std::string name : {"thigh.@", "shin.@", "foot.@", "upper_arm.@", "forearm.@", "hand.@", "spine"})
            rigs.back().others.push_back({layer + name, "", ""});
    for (const std::string name : {"hips", "chest", "torso", "head", "thigh_fk.@", "hand_ik.@", "MCH-foot_ik.@"})
        rigs.back().others.push_back({name, "", ""});
    rigs.push_back(
        {"ARKit",
         "left",
         "right",
         joined(
             {{"pelvis", "hips_joint"},
              {"spine1", "spine_1_joint"},
              {"spine2", "spine_2_joint"},
              {"spine3", "spine_7_joint"},
              {"neck", "neck_1_joint"},
              {"head", "head_joint"},
              {"jaw", "jaw_joint"},
              {"eye", "@_eye_joint"},
              {"hip", "@_upLeg_joint"},
              {"knee", "@_leg_joint"},
              {"ankle", "@_foot_joint"},
              {"foot", "@_toes_joint"},
              {"collar", "@_shoulder_1_joint"},
              {"shoulder", "@_arm_joint"},
              {"elbow", "@_forearm_joint"},
              {"wrist", "@_hand_joint"}},
             fingers(usual_fingers(), [&](const auto& f, int n) { return "@_hand" + f + "_" + number(n) + "_joint"; })),
         {{"root", "", "pelvis"}, {"neck_2_joint", "neck", "head"}, {"@_handIndexStart_joint", "wrist", "index1"}}});
    rigs.push_back({"3ds Max Biped",
                    "L",
                    "R",
                    {{"pelvis", "Bip01 Pelvis"},     {"spine1", "Bip01 Spine"},        {"spine2", "Bip01 Spine1"},
                     {"neck", "Bip01 Neck"},         {"head", "Bip01 Head"},           {"hip", "Bip01 @ Thigh"},
                     {"knee", "Bip01 @ Calf"},       {"ankle", "Bip01 @ Foot"},        {"foot", "Bip01 @ Toe0"},
                     {"collar", "Bip01 @ Clavicle"}, {"shoulder", "Bip01 @ UpperArm"}, {"elbow", "Bip01 @ Forearm"},
                     {"wrist", "Bip01 @ Hand"},      {"thumb1", "Bip01 @ Finger0"},    {"thumb2", "Bip01 @ Finger01"},
                     {"thumb3", "Bip01 @ Finger02"}, {"index1", "Bip01 @ Finger1"},    {"index2", "Bip01 @ Finger11"},
                     {"index3", "Bip01 @ Finger12"}, {"pinky1", "Bip01 @ Finger4"},    {"pinky2", "Bip01 @ Finger41"},
                     {"pinky3", "Bip01 @ Finger42"}},
                    {{"Bip01", "", "pelvis"}, {"Bip01 HeadNub", "head", ""}, {"Bip01 @ Toe0Nub", "foot", ""}}});
    rigs.push_back(rigs.back());
    rigs.back().program = "ValveBiped";
    for (auto& [part, name] : rigs.back().names) {
        name = "ValveBiped." + name + (part == "neck" || part == "head" ? "1" : "");
        for (char& c : name) c = c == ' ' ? '_' : c;
    }
    rigs.push_back({"MakeHuman",
                    "L",
                    "R",
                    {{"pelvis", "root"},
                     {"spine1", "spine05"},
                     {"spine2", "spine04"},
                     {"spine3", "spine01"},
                     {"neck", "neck01"},
                     {"head", "head"},
                     {"jaw", "jaw"},
                     {"eye", "eye.@"},
                     {"hip", "upperleg01.@"},
                     {"knee", "lowerleg01.@"},
                     {"ankle", "foot.@"},
                     {"collar", "clavicle.@"},
                     {"shoulder", "upperarm01.@"},
                     {"elbow", "lowerarm01.@"},
                     {"wrist", "wrist.@"},
                     {"thumb1", "finger1-1.@"},
                     {"thumb2", "finger1-2.@"},
                     {"thumb3", "finger1-3.@"},
                     {"index1", "finger2-1.@"},
                     {"index2", "finger2-2.@"},
                     {"pinky3", "finger5-3.@"}},
                    {{"spine03", "spine2", "spine3"},
                     {"pelvis.@", "pelvis", "hip"},
                     {"upperleg02.@", "hip", "knee"},
                     {"lowerleg02.@", "knee", "ankle"},
                     {"shoulder01.@", "collar", "shoulder"},
                     {"upperarm02.@", "shoulder", "elbow"},
                     {"toe1-1.@", "ankle", ""}}});
    rigs.push_back({"Advanced Skeleton",
                    "L",
                    "R",
                    joined({{"pelvis", "Root_M"},
                            {"spine1", "Spine1_M"},
                            {"spine2", "Spine2_M"},
                            {"spine3", "Chest_M"},
                            {"neck", "Neck_M"},
                            {"head", "Head_M"},
                            {"jaw", "Jaw_M"},
                            {"eye", "Eye_@"},
                            {"hip", "Hip_@"},
                            {"knee", "Knee_@"},
                            {"ankle", "Ankle_@"},
                            {"foot", "Toes_@"},
                            {"collar", "Scapula_@"},
                            {"shoulder", "Shoulder_@"},
                            {"elbow", "Elbow_@"},
                            {"wrist", "Wrist_@"}},
                           fingers(usual_fingers("Middle"),
                                   [&](const auto& f, int n) { return f + "Finger" + number(n) + "_@"; })),
                    {}});
    rigs.push_back({"OptiTrack",
                    "L",
                    "R",
                    {{"pelvis", "Hip"},
                     {"spine1", "Ab"},
                     {"spine2", "Chest"},
                     {"neck", "Neck"},
                     {"head", "Head"},
                     {"hip", "@Thigh"},
                     {"knee", "@Shin"},
                     {"ankle", "@Foot"},
                     {"foot", "@Toe"},
                     {"collar", "@Shoulder"},
                     {"shoulder", "@UArm"},
                     {"elbow", "@FArm"},
                     {"wrist", "@Hand"}},
                    {}});
    rigs.push_back({"CATS",
                    "Left",
                    "Right",
                    {{"pelvis", "Hips"},
                     {"spine1", "Spine"},
                     {"spine2", "Chest"},
                     {"neck", "Neck"},
                     {"head", "Head"},
                     {"eye", "@Eye"},
                     {"hip", "@ leg"},
                     {"knee", "@ knee"},
                     {"ankle", "@ ankle"},
                     {"foot", "@ toe"},
                     {"collar", "@ shoulder"},
                     {"shoulder", "@ arm"},
                     {"elbow", "@ elbow"},
                     {"wrist", "@ wrist"}},
                    {}});
    rigs.push_back({"Auto-Rig Pro",
                    "l",
                    "r",
                    {{"pelvis", "root.x"},
                     {"spine1", "spine_01.x"},
                     {"spine2", "spine_02.x"},
                     {"spine3", "spine_03.x"},
                     {"neck", "neck.x"},
                     {"head", "head.x"},
                     {"hip", "thigh_stretch.@"},
                     {"knee", "leg_stretch.@"},
                     {"ankle", "foot.@"},
                     {"foot", "toes_01.@"},
                     {"collar", "shoulder.@"},
                     {"shoulder", "arm_stretch.@"},
                     {"elbow", "forearm_stretch.@"},
                     {"wrist", "hand.@"},
                     {"index1", "c_index1.@"},
                     {"index2", "c_index2.@"},
                     {"thumb1", "thumb1.@"}},
                    {{"thigh_twist.@", "hip", ""}, {"arm_twist.@", "shoulder", ""}, {"c_traj", "", "pelvis"}}});
    // Helpers that are called like joints, beside the limbs.
    rigs.push_back(
        {"helpers",
         "L",
         "R",
         {{"pelvis", "Pelvis"},
          {"spine1", "Spine"},
          {"neck", "Neck"},
          {"head", "Head"},
          {"hip", "@_Thigh"},
          {"knee", "@_Calf"},
          {"ankle", "@_Foot"},
          {"foot", "@_Toe0"},
          {"collar", "@_Clavicle"},
          {"shoulder", "@_UpperArm"},
          {"elbow", "@_Forearm"},
          {"wrist", "@_Hand"}},
         {{"@_Knee", "hip", ""}, {"@_Hip", "pelvis", ""}, {"@_Elbow", "elbow", ""}, {"@_UPPER_LEG", "hip", ""}}});
    return rigs;
}

/// The rig of a list, and the part of each joint, or "".
struct NamedRig {
    RigMotion rig;
    std::vector<std::string> parts;
};
inline NamedRig named_rig(const RigNames& list) {
    static const std::map<std::string, std::vector<std::string>> above = {
        {"spine1", {"pelvis"}},
        {"spine2", {"spine1", "pelvis"}},
        {"spine3", {"spine2", "spine1", "pelvis"}},
        {"neck", {"spine3", "spine2", "spine1"}},
        {"head", {"neck", "spine3", "spine2", "spine1"}},
        {"jaw", {"head"}},
        {"eye", {"head"}},
        {"hip", {"pelvis"}},
        {"knee", {"hip"}},
        {"ankle", {"knee"}},
        {"foot", {"ankle"}},
        {"collar", {"spine3", "spine2", "spine1"}},
        {"shoulder", {"collar", "spine3", "spine2", "spine1"}},
        {"elbow", {"shoulder"}},
        {"wrist", {"elbow"}}};
    struct Node {
        std::string name, part, parent; // parent: a part, or "=" and a name
        char side;
    };
    std::vector<Node> nodes;
    const auto is_sided = [](const std::string& name) { return name.find('@') != std::string::npos; };
    const auto has = [&](const std::string& part) {
        for (const auto& [own, name] : list.names)
            if (own == part) return true;
        return false;
    };
    const auto parent_of = [&](const std::string& part) -> std::string {
        if (part == "pelvis") return "";
        if (above.count(part) == 0) { // a finger
            const std::string before = part.substr(0, part.size() - 1) + static_cast<char>(part.back() - 1);
            return part.back() > '1' && has(before) ? before : "wrist";
        }
        for (const std::string& other : above.at(part))
            if (has(other)) return other;
        return "";
    };
    for (const char side : {'l', 'r'}) {
        for (const auto& [part, name] : list.names) {
            if (!is_sided(name) && side == 'r') continue;
            Node node{name, part, parent_of(part), is_sided(name) ? side : '\0'};
            for (const auto& other : list.others)
                if (other.below == part) node.parent = "=" + other.name;
            nodes.push_back(node);
        }
        for (const auto& other : list.others)
            if (is_sided(other.name) || side == 'l')
                nodes.push_back({other.name, "", other.above, is_sided(other.name) ? side : '\0'});
    }
    NamedRig result;
    std::vector<int> number(nodes.size(), -1);
    const auto find_parent = [&](const Node& node) { // -1: not there yet; -2: none
        if (node.parent.empty()) return -2;
        for (std::size_t i = 0; i < nodes.size(); ++i)
            if ((node.parent[0] == '=' ? nodes[i].part.empty() && "=" + nodes[i].name == node.parent
                                       : nodes[i].part == node.parent) &&
                (nodes[i].side == 0 || node.side == 0 || nodes[i].side == node.side))
                return number[i];
        return -2;
    };
    for (std::size_t placed = 0; placed < nodes.size();) {
        const std::size_t before = placed;
        for (std::size_t i = 0; i < nodes.size(); ++i) {
            const int parent = number[i] < 0 ? find_parent(nodes[i]) : -1;
            if (parent == -1) continue;
            std::string name = nodes[i].name;
            if (const auto at = name.find('@'); at != std::string::npos)
                name.replace(at, 1, nodes[i].side == 'l' ? list.left : list.right);
            if (const auto at = name.find('#'); at != std::string::npos) // even and odd numbers for the sides
                name.replace(at, 1, ""), name[at - 1] = static_cast<char>(name[at - 1] + (nodes[i].side == 'r'));
            number[i] = static_cast<int>(placed++);
            result.rig.names.push_back(name);
            result.rig.parents.push_back(std::max(parent, -1));
            const std::string side = nodes[i].side == 'l' ? "left_" : nodes[i].side == 'r' ? "right_" : "";
            result.parts.push_back(nodes[i].part.empty() ? "" : side + nodes[i].part);
        }
        if (placed == before) break;
    }
    return result;
}

} // namespace gsh::test
