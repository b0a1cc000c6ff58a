// SPDX-License-Identifier: Apache-2.0
/// @file  Names of joints: their numbers in SMPL-X, those of a body, and the words of a rig's own names.
#include <gsh/body/joint_names.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// A body that has nothing but a chain of joints.
BodyModel joint_chain(std::size_t joints, std::vector<std::string> names = {}) {
    BodyModel body;
    for (std::size_t j = 0; j < joints; ++j) body.parents.push_back(static_cast<int>(j) - 1);
    body.joint_names = std::move(names);
    return body;
}

} // namespace

TEST_CASE("the joints of SMPL-X have the numbers that its files give them, and no others are found") {
    int found = 0;
    const auto check_number = [&](const std::string& name, int number) {
        CAPTURE(name);
        CHECK(smplx_joint(name) == number);
        ++found;
    };
    const auto check_numbers = [&](const char* name, int left, int right) {
        check_number("left_" + std::string(name), left), check_number("right_" + std::string(name), right);
    };
    check_number("pelvis", 0), check_number("neck", 12), check_number("head", 15), check_number("jaw", 22);
    check_number("spine1", 3), check_number("spine2", 6), check_number("spine3", 9);
    check_numbers("hip", 1, 2), check_numbers("knee", 4, 5), check_numbers("ankle", 7, 8),
        check_numbers("foot", 10, 11);
    check_numbers("collar", 13, 14), check_numbers("shoulder", 16, 17), check_numbers("elbow", 18, 19);
    check_numbers("wrist", 20, 21), check_numbers("eye", 23, 24);
    int next = 25;
    for (const std::string side : {"left_", "right_"})
        for (const char* finger : {"index", "middle", "pinky", "ring", "thumb"})
            for (const char* number : {"1", "2", "3"}) check_number(side + finger + number, next++);
    CHECK(found == 55);
    for (const char* name : {"", "tail", "pelvis ", "left_"}) CHECK(smplx_joint(name) == -1);
}

TEST_CASE("the names of a body's joints follow from their number, or are the model's own") {
    const auto names = [](std::size_t joints) { return joint_names_of(joint_chain(joints)); };
    const std::vector<std::string> smplx = names(55), smplh = names(52), smpl = names(24), trunk = names(22);
    REQUIRE((smplx.size() == 55 && smplh.size() == 52 && smpl.size() == 24 && trunk.size() == 22));
    for (std::size_t j = 0; j < 55; ++j) {
        CHECK(smplx[j] == smplx_joint_names[j]);
        if (j < 22) CHECK((smplh[j] == smplx[j] && smpl[j] == smplx[j] && trunk[j] == smplx[j]));
        if (j >= 25) CHECK(smplh[j - 3] == smplx[j]); // SMPL-H has neither jaw nor eyes
    }
    CHECK(smpl[22] == "left_hand");
    CHECK(smpl[23] == "right_hand");

    CHECK(names(0).empty());
    CHECK(names(1) == std::vector<std::string>{"joint_0"});
    CHECK(names(23).back() == "joint_22");
    const std::vector<std::string> own{"hips", "chest", "head"};
    CHECK(joint_names_of(joint_chain(3, own)) == own);
    CHECK(joint_names_of(joint_chain(2, own)).front() == "joint_0"); // not one per joint
    CHECK(joint_names_of(joint_chain(22, std::vector<std::string>(22, "own"))).back() == "right_wrist");
}

TEST_CASE("prefixes and ways to write a side") {
    for (const char* name :
         {"LeftForeArm", "mixamorig:LeftForeArm", "mixamorig1:LeftForeArm", "mixamorigLeftForeArm",
          "mixamorig_LeftForeArm", "character:rig:LeftForeArm", "left_forearm", "leftforearm", "mixamorigleftforearm",
          "Forearm_Left", "forearm.L", "forearm_l", "Bip01 L Forearm", "DEF-forearm.L", "ORG-forearm.L",
          "ValveBiped.Bip01_L_Forearm", "valvebiped.bip01_l_forearm", "lForeArm"}) {
        CAPTURE(name);
        CHECK(joint_words(name).side == 'l');
        CHECK(joint_words(name).part == "forearm");
    }
    for (const char* name : {"rightForearm", "rightforearm", "forearm_right", "R_Forearm"}) {
        CAPTURE(name);
        CHECK(joint_words(name).side == 'r');
        CHECK(joint_words(name).part == "forearm");
    }
    CHECK(joint_words("J_Bip_R_LowerArm").side == 'r');
    CHECK(joint_words("J_Bip_R_LowerArm").part == "lowerarm");
    CHECK(joint_words("LHipJoint").part == "hipjoint");
    CHECK(joint_words("LFOREARM").side == 'l'); // one word: a side if a known joint is left
    CHECK(joint_words("LFOREARM").part == "forearm");
    CHECK(joint_words("rfemur").side == 'r');
    CHECK(joint_words("rfemur").part == "femur");
    for (const char* name : {"ring1", "root", "leg", "lowback", "lip"}) CHECK(joint_words(name).side == 0);
    CHECK(joint_words("LowerBack").side == 0);
    CHECK(joint_words("LowerBack").part == "lowerback");
}

TEST_CASE("a name that is only a prefix or a side is a joint's own, and nothing has no words") {
    CHECK(joint_words("Root").part == "root");
    for (const char* name : {"L", "left", "C", "Bip01", "DEF"}) {
        CAPTURE(name);
        CHECK(joint_words(name).side == 0);
        CHECK(!joint_words(name).part.empty());
    }
    for (const char* name : {"", ":", "rig:", "_._", "\xc3\xa4"}) CHECK(joint_words(name).part.empty());
}

TEST_CASE("numbers have no leading zeros") {
    CHECK(joint_words("index_01_l").part == "index1");
    CHECK(joint_words("Spine10").part == "spine10");
    CHECK(joint_words("toe0").part == "toe0");
    CHECK(joint_words("bone20_100").part == "bone20100");
    CHECK(joint_words("spine.001").part == "spine1"); // of Blender
    CHECK(joint_words("spine.000").part == "spine0");
    CHECK(joint_words("thumb.00100.L").part == "thumb100");
}

TEST_CASE("what most names of a rig share is dropped, and nothing that tells joints apart") {
    const auto parts = [](const std::vector<std::string>& names) {
        std::string text;
        for (const JointWords& words : joint_words(names))
            text += (words.side ? std::string(1, words.side) + ":" : std::string()) + words.part + " ";
        return text;
    };
    const auto with = [](const std::string& before, const std::string& behind, bool count = false) {
        std::vector<std::string> names;
        for (const char* name : {"Hips", "Spine", "Spine1", "Head", "LeftArm", "LeftForeArm", "RightArm",
                                 "RightForeArm", "LeftUpLeg", "LeftLeg"})
            names.push_back(before + name + behind + (count ? std::to_string(names.size() + 11) : ""));
        return names;
    };
    const std::string plain = parts(with("", ""));
    CHECK(plain == "hips spine spine1 head l:arm l:forearm r:arm r:forearm l:upleg l:leg ");
    for (const char* before : {"Avatar_", "mixamorig:", "Armature|", "a:b:", "Hero Rig ", "heroRig", "root/hips/"})
        CHECK(parts(with(before, "")) == plain);
    for (const char* behind : {".001", "_001", "001", "_jnt", "_bone", "#2"}) CHECK(parts(with("", behind)) == plain);
    CHECK(parts(with("", "_", true)) == plain); // Hips_11, Spine_12, Spine1_13, …
    CHECK(parts(with("x:", "_end_00", false)) == plain);
    // Nodes that are no joints do not change that.
    std::vector<std::string> scene = with("Avatar_", "_", true);
    scene.insert(scene.end(), {"Sketchfab_model", "Object_7", "root.fbx"});
    CHECK(parts(scene).starts_with(plain));
    // A side is never dropped, nor is a word that is a joint.
    const std::vector<std::string> left(10, "left_arm");
    CHECK(parts(left).starts_with("l:arm "));
    std::vector<std::string> spine;
    for (int n = 0; n < 10; ++n) spine.push_back("spine_0" + std::to_string(n));
    CHECK(parts({"spine_01", "spine_02", "arm_l", "leg_l"}) == "spine1 spine2 l:arm l:leg ");
}

TEST_CASE("repeated names are told apart, and mean the same") {
    std::map<std::string, int> taken;
    CHECK(unique_joint_name("Arm", taken) == "Arm");
    CHECK(unique_joint_name("Arm", taken) == "Arm#2");
    CHECK(unique_joint_name("Arm#2", taken) == "Arm#2#2");
    CHECK(unique_joint_name("Arm", taken) == "Arm#3");
    for (int number = 2; number < 60000; ++number) (void)unique_joint_name("End", taken); // in a moment, not in minutes
    CHECK(unique_joint_name("End", taken) == "End#59999");
    CHECK(joint_words("LeftArm#12").part == "arm");
    CHECK(joint_words("C#").part == "c");
}
