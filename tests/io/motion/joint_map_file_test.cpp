// SPDX-License-Identifier: Apache-2.0
/// @file  Joint maps in JSON files.

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/motion/joint_map_file.hpp>

#include <string>

using namespace gsh;

TEST_CASE("names of joints are read as they are; null leaves a joint out") {
    const test::Temporary folder;
    write_file(folder / "map.json", R"({"Bip: Arm 01": "left_shoulder", "Prop": null})");
    const JointMap map = read_joint_map(folder / "map.json");
    REQUIRE(map.named.size() == 2);
    CHECK(map.named.at("Bip: Arm 01") == "left_shoulder");
    CHECK(map.named.at("Prop").empty());
    write_file(folder / "none.json", "{}");
    CHECK(read_joint_map(folder / "none.json").named.empty());
}

TEST_CASE("anything else is refused with the entry") {
    const test::Temporary folder;
    const auto refuse = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        write_file(folder / "bad.json", text);
        test::check_throws<IoError>([&] { (void)read_joint_map(folder / "bad.json"); }, {"bad.json"});
        test::check_throws<IoError>([&] { (void)read_joint_map(folder / "bad.json"); }, words);
    };
    refuse("", {"not JSON"});
    refuse("[1]", {"array", "expected an object"});
    refuse(R"({"Arm": "left_arm"})", {"Arm is \"left_arm\"", "left_shoulder"});
    refuse(R"({"Arm": 3})", {"Arm is 3"});
    refuse(R"({"Arm": ["left_shoulder"]})", {"Arm is [\"left_shoulder\"]"});
    test::check_throws<IoError>([&] { (void)read_joint_map(folder / "none.json"); }, {"none.json", "No such file"});
}
