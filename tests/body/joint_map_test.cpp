// SPDX-License-Identifier: Apache-2.0
/// @file  Joint names of many programs are found, by name and by place in the tree.

#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/rig_names.hpp"
#include "support/sample_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/joint_map.hpp>

#include <string>
#include <vector>

using namespace gsh;

namespace {

/// A rig of joints "name parent"; a parent is the number of an earlier joint.
RigMotion rig_of(const std::vector<std::pair<std::string, int>>& joints) {
    RigMotion rig;
    for (const auto& [name, parent] : joints) rig.names.push_back(name), rig.parents.push_back(parent);
    return rig;
}

/// The name of the rig's joint that is matched to a joint of SMPL-X, or "".
std::string matched(const RigMotion& rig, std::string_view joint, const JointMap& map = {}) {
    const int j = map.match(rig, "a rig")[static_cast<std::size_t>(smplx_joint(joint))];
    return j < 0 ? "" : rig.names[static_cast<std::size_t>(j)];
}

} // namespace

TEST_CASE("every joint of a sample rig is found, in all conventions") {
    for (const auto names : {test::Names::smplx, test::Names::mixamo, test::Names::vrm, test::Names::cmu,
                             test::Names::bvh, test::Names::mhr, test::Names::unreal}) {
        const auto sample = test::sample_rig({.names = names, .twist = true, .fingers = true});
        RigMotion rig;
        rig.names = sample.names, rig.parents = sample.parents;
        for (std::size_t j = 0; j < sample.names.size(); ++j) {
            CAPTURE(sample.names[j]);
            if (!sample.parts[j].empty()) CHECK(matched(rig, sample.parts[j]) == sample.names[j]);
        }
        std::size_t count = 0;
        for (const int joint : JointMap{}.match(rig, "a rig")) count += joint >= 0;
        std::size_t parts = 0;
        for (const auto& part : sample.parts) parts += !part.empty();
        CHECK(count == parts); // twist bones are nothing
    }
}

TEST_CASE("every joint of a rig is found by the names of many programs, and no other") {
    for (const test::RigNames& list : test::known_rigs()) {
        CAPTURE(list.program);
        const auto [rig, parts] = test::named_rig(list);
        std::vector<std::string> warnings;
        const MatchedJoints found = JointMap{}.match(rig, "a rig", &warnings);
        std::size_t joints = 0, count = 0;
        for (std::size_t j = 0; j < parts.size(); ++j) {
            if (parts[j].empty()) continue;
            CAPTURE(rig.names[j]);
            CAPTURE(parts[j]);
            const int match = found[static_cast<std::size_t>(smplx_joint(parts[j]))];
            REQUIRE(match >= 0);
            CHECK(rig.names[static_cast<std::size_t>(match)] == rig.names[j]);
            ++joints;
        }
        for (const int joint : found) count += joint >= 0;
        CHECK(count == joints);
        CHECK(warnings.empty());
        CHECK_NOTHROW(check_limbs(rig, found, "a rig"));
    }
}

TEST_CASE("of two candidates for a joint that moves no limb one is taken, with one warning for all of them") {
    test::RigNames list = test::known_rigs().front();
    for (auto& [part, name] : list.names) name = name.substr(10); // without mixamorig:
    list.others = {{"Eye@", "head", ""},
                   {"@Eye", "head", ""},
                   {"__Jaw", "head", ""},
                   {"Jaw", "head", ""},
                   {"__@HandThumb1", "wrist", "thumb1"},
                   {"@_Toe_Base", "ankle", ""}};
    const RigMotion rig = test::named_rig(list).rig;
    std::vector<std::string> warnings;
    const MatchedJoints found = JointMap{}.match(rig, "a.glb", &warnings);
    const auto name = [&](std::string_view joint) {
        return rig.names[static_cast<std::size_t>(found[static_cast<std::size_t>(smplx_joint(joint))])];
    };
    CHECK(name("left_eye") == "LeftEye"); // the side is in front
    CHECK(name("right_eye") == "RightEye");
    CHECK(name("jaw") == "Jaw"); // without further signs
    CHECK(name("left_thumb1") == "LeftHandThumb1");
    CHECK(name("right_foot") == "RightToeBase");
    REQUIRE(warnings.size() == 1);
    for (const char* text : {"a.glb: several", "left_eye is 'LeftEye', not 'EyeLeft'", "jaw is 'Jaw', not '__Jaw'",
                             "right_foot is 'RightToeBase', not 'Right_Toe_Base'", "joint map"})
        CHECK(warnings[0] == test::contains(text));
}

TEST_CASE("a node that is called like a joint elsewhere in the file, such as a mesh, is not one") {
    test::RigNames list = test::known_rigs().front();
    list.others = {{"Head", "", ""},           {"Neck", "", ""},     {"Jaw", "", ""},
                   {"LeftEye", "", ""},        {"@ToeBase", "", ""}, {"@HandIndex1", "", ""},
                   {"@Shoulder", "pelvis", ""}};
    const RigMotion rig = test::named_rig(list).rig;
    std::vector<std::string> warnings;
    (void)JointMap{}.match(rig, "a.glb", &warnings);
    CHECK(warnings.empty());
    CHECK(matched(rig, "head") == "mixamorig:Head");
    CHECK(matched(rig, "neck") == "mixamorig:Neck");
    CHECK(matched(rig, "left_foot") == "mixamorig:LeftToeBase");
    CHECK(matched(rig, "right_index1") == "mixamorig:RightHandIndex1");
    CHECK(matched(rig, "left_collar") == "mixamorig:LeftShoulder");
    CHECK(matched(rig, "jaw") == "Jaw"); // there is no other
}

TEST_CASE("of two candidates for a limb the one with further signs is a helper, and others are told all at once") {
    test::RigNames list = test::known_rigs().front();
    for (auto& [part, name] : list.names) name = name.substr(10);
    list.others = {{"__@Arm", "collar", "shoulder"}, {"__@Leg", "hip", "knee"}};
    std::vector<std::string> warnings;
    const RigMotion helped = test::named_rig(list).rig;
    CHECK(matched(helped, "left_shoulder") == "LeftArm");
    CHECK(matched(helped, "right_knee") == "RightLeg");
    (void)JointMap{}.match(helped, "a.bvh", &warnings);
    CHECK(warnings.size() == 1);
    // Two people in one file
    RigMotion two = test::named_rig(test::known_rigs().front()).rig;
    const std::size_t J = two.joint_count();
    for (std::size_t j = 0; j < J; ++j) {
        two.names.push_back("other:" + two.names[j].substr(10));
        two.parents.push_back(two.parents[j] < 0 ? -1 : two.parents[j] + static_cast<int>(J));
    }
    test::check_throws<ValueError>([&] { (void)JointMap{}.match(two, "two.glb"); },
                                   {"two.glb", "left_hip ('mixamorig:LeftUpLeg', 'other:LeftUpLeg')", "right_hip ('",
                                    "left_shoulder ('", "right_shoulder ('", "--joint-map"});
}

TEST_CASE("the hips are where the legs begin, unless that is far from them") {
    const std::vector<std::pair<std::string, int>> legs = {{"root", -1},    {"LeftUpLeg", 0},  {"LeftLeg", 1},
                                                           {"LeftFoot", 2}, {"RightUpLeg", 0}, {"RightLeg", 4},
                                                           {"RightFoot", 5}};
    RigMotion rig = rig_of(legs);
    rig.rest_joints = {{0, 1, 0},      {0.1, 0.9, 0},  {0.1, 0.5, 0}, {0.1, 0.1, 0},
                       {-0.1, 0.9, 0}, {-0.1, 0.5, 0}, {-0.1, 0.1, 0}};
    CHECK(matched(rig, "pelvis") == "root");
    rig.rest_joints[0] = {0, 0, 0}; // on the ground
    CHECK(matched(rig, "pelvis").empty());
    // A control that is called hips, and does not carry the legs
    CHECK(matched(rig_of({{"hips", -1}, {"spine", -1}, {"LeftUpLeg", 1}, {"RightUpLeg", 1}}), "pelvis") == "spine");
    // An object and a joint with the same name
    CHECK(matched(rig_of({{"Hips", -1}, {"rig:Hips", 0}, {"LeftUpLeg", 1}, {"RightUpLeg", 1}}), "pelvis") ==
          "rig:Hips");
}

TEST_CASE("spines of one to five bones: the first, the middle and the last") {
    const auto spine = [](int bones) {
        std::vector<std::pair<std::string, int>> joints = {{"Hips", -1}};
        for (int b = 0; b < bones; ++b) joints.emplace_back(std::string(1, 'S').append(std::to_string(b)), b);
        joints.insert(joints.end(), {{"LeftArm", bones}, {"RightArm", bones}});
        const RigMotion rig = rig_of(joints);
        return matched(rig, "spine1") + " " + matched(rig, "spine2") + " " + matched(rig, "spine3");
    };
    CHECK(spine(0) == "  ");
    CHECK(spine(1) == "S0  ");
    CHECK(spine(2) == "S0 S1 ");
    CHECK(spine(3) == "S0 S1 S2");
    CHECK(spine(4) == "S0 S1 S3"); // as MHR's four
    CHECK(spine(5) == "S0 S2 S4"); // as Unreal's five
}

TEST_CASE("shoulder, foot, hand and hip mean what the other names leave") {
    const RigMotion mixamo =
        rig_of({{"Hips", -1}, {"LeftShoulder", 0}, {"LeftArm", 1}, {"LeftHand", 2}, {"LeftFoot", 0}});
    CHECK(matched(mixamo, "left_collar") == "LeftShoulder");
    CHECK(matched(mixamo, "left_shoulder") == "LeftArm");
    CHECK(matched(mixamo, "left_wrist") == "LeftHand");
    CHECK(matched(mixamo, "left_ankle") == "LeftFoot");
    CHECK(matched(mixamo, "left_foot").empty());
    const RigMotion smpl = rig_of({{"Pelvis", -1},
                                   {"L_Collar", 0},
                                   {"L_Shoulder", 1},
                                   {"L_Wrist", 2},
                                   {"L_Hand", 3},
                                   {"L_Ankle", 0},
                                   {"L_Foot", 5},
                                   {"L_Hip", 0}});
    CHECK(matched(smpl, "left_collar") == "L_Collar");
    CHECK(matched(smpl, "left_shoulder") == "L_Shoulder");
    CHECK(matched(smpl, "left_wrist") == "L_Wrist");
    CHECK(matched(smpl, "left_foot") == "L_Foot");
    CHECK(matched(smpl, "left_hip") == "L_Hip");
    const RigMotion fingers =
        rig_of({{"LeftHand", -1}, {"LeftHandRing", 0}, {"LeftHandIndex", 0}, {"LeftHandIndex1", 2}});
    CHECK(matched(fingers, "left_ring1") == "LeftHandRing"); // of one joint
    CHECK(matched(fingers, "left_index1") == "LeftHandIndex1");
    CHECK(matched(rig_of({{"hip", -1}, {"pelvis", 0}}), "pelvis") == "hip");
    CHECK(matched(rig_of({{"root", -1}, {"pelvis", 0}}), "pelvis") == "pelvis");
    CHECK(
        matched(rig_of({{"hips", -1}, {"leftThumbProximal", 0}, {"leftThumbIntermediate", 1}, {"leftThumbDistal", 2}}),
                "left_thumb1") == "leftThumbProximal"); // VRM 0.x
    CHECK(matched(rig_of({{"hips", -1}, {"leftThumbMetacarpal", 0}, {"leftThumbProximal", 1}, {"leftThumbDistal", 2}}),
                  "left_thumb2") == "leftThumbProximal"); // VRM 1.0
}

TEST_CASE("a joint map takes precedence, leaves joints out, and must fit the rig") {
    const RigMotion rig = rig_of({{"Hips", -1}, {"Wing", 0}, {"LeftArm", 0}});
    JointMap map;
    map.named = {{"Wing", "left_shoulder"}};
    CHECK(matched(rig, "left_shoulder", map) == "Wing");
    map.named = {{"LeftArm", ""}};
    CHECK(matched(rig, "left_shoulder", map).empty());
    map.named = {{"Tail", "spine1"}};
    test::check_throws<ValueError>([&] { (void)map.match(rig, "a.bvh"); }, {"a.bvh", "'Tail'", "Hips, Wing, LeftArm"});
    map.named = {{"Wing", "left_wing"}};
    test::check_throws<ValueError>([&] { (void)map.match(rig, "a.bvh"); }, {"'left_wing'", "joint of SMPL-X"});
    map.named = {{"Wing", "left_shoulder"}, {"LeftArm", "left_shoulder"}};
    test::check_throws<ValueError>([&] { (void)map.match(rig, "a.bvh"); }, {"'left_shoulder' twice"});
    const RigMotion two = rig_of({{"a:Hips", -1}, {"b:Hips", -1}});
    test::check_throws<ValueError>([&] { (void)JointMap{}.match(two, "two.glb"); },
                                   {"two.glb", "'a:Hips'", "'b:Hips'", "pelvis"});
    map.named = {{"b:Hips", ""}};
    CHECK(matched(two, "pelvis", map) == "a:Hips");
}

TEST_CASE("long lists of names are cut") {
    CHECK(list_of_names({}) == "");
    CHECK(list_of_names({"a", "b"}) == "a, b");
    CHECK(list_of_names({"a", "b", "c"}, 1) == "a and 2 more");
}
