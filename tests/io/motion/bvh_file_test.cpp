// SPDX-License-Identifier: Apache-2.0
/// @file  BVH files: channel orders, units, axes and names of other programs; every kind of damage is refused.

#include "io/bvh_files.hpp"
#include "io/damage.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/sample_rig.hpp"
#include "support/skeleton_body.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>
#include <gsh/io/motion/bvh_file.hpp>

#include <algorithm>
#include <chrono>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The text with all occurrences of `from` replaced.
std::string replaced(const std::string& text, const std::string& from, const std::string& to) {
    std::string result;
    for (std::size_t i = 0; i < text.size();) {
        const bool found = text.compare(i, from.size(), from) == 0;
        for (const char c : found ? to : text.substr(i, 1)) result.push_back(c);
        i += found ? from.size() : 1;
    }
    return result;
}

/// A hand-written file of two joints; texts of it are replaced.
std::string small_file(const std::vector<std::pair<std::string, std::string>>& changes = {}) {
    std::string text = "HIERARCHY\nROOT Hip: the first\n{\n  OFFSET 1 2 3\n"
                       "  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
                       "  JOINT Knee\n  {\n    OFFSET 0 -1 0\n    CHANNELS 3 Yrotation Xrotation Zrotation\n"
                       "    End Site\n    {\n      OFFSET 0 -2 0\n    }\n  }\n}\n"
                       "MOTION\nFrames: 2\nFrame Time: 0.04\n0 0 0 0 0 0 0 0 0\n4 5 6 90 0 0 0 90 0\n";
    for (const auto& [from, to] : changes) {
        const auto at = text.find(from);
        REQUIRE(at != std::string::npos);
        text.replace(at, from.size(), to);
    }
    return text;
}

} // namespace

TEST_CASE("a small file is read as written by hand") {
    const test::Temporary folder;
    write_file(folder / "a.bvh", small_file());
    std::vector<std::string> warnings;
    const RigMotion rig = load_bvh(folder / "a.bvh", {}, &warnings);
    CHECK(rig.names == std::vector<std::string>{"Hip: the first", "Knee", "Knee_end"});
    CHECK(rig.parents == std::vector<int>{-1, 0, 1});
    CHECK(rig.rest_joints[2] == vec3<double>(1, -1, 3));
    CHECK(rig.timestamps == std::vector<double>{0, 0.04});
    CHECK(rig.joint(1, 0) == vec3<double>(4, 5, 6));                // the position takes the place of the OFFSET
    CHECK(length(rig.joint(1, 1) - vec3<double>(5, 5, 6)) < 1e-12); // -y turned by 90 degrees about z
    CHECK(length(rig.joint(1, 2) - vec3<double>(5, 5, 4)) < 1e-12); // then about the turned x, which is y
    CHECK(warnings.empty());                                        // no legs, so no guess of a unit

    // Other programs' habits: line ends, case, a byte order mark, tabs, braces on the line of the name
    std::string other =
        "\xef\xbb\xbf" + small_file({{"Knee\n  {", "Knee {"}, {"Xposition", "xposition"}, {"ROOT", "Root"}});
    other = replaced(replaced(other, "\n", "\r\n"), "  ", "\t");
    write_file(folder / "b.bvh", other);
    CHECK(load_bvh(folder / "b.bvh").joints == rig.joints);
}

TEST_CASE("all six orders of rotations, units and axes: the body follows the source") {
    const test::Temporary folder;
    const auto check = [&](const test::SampleOptions& o, const std::string& order, const std::string& unit) {
        CAPTURE(order);
        CAPTURE(unit);
        const auto sample = test::sample_rig(o);
        write_file(folder / "a.bvh", test::bvh_text(sample, order));
        std::vector<std::string> warnings;
        const RigMotion rig = load_bvh(folder / "a.bvh", {}, &warnings);
        std::string all;
        for (const auto& warning : warnings) all += warning + "\n";
        CHECK(all == test::contains("taken as " + unit));
        CHECK((all.find("turned to y up") != std::string::npos) == o.z_up);
        const Motion motion = retarget(rig, test::skeleton_body());
        auto metres = sample;
        for (auto* points : {&metres.rest, &metres.root})
            for (auto& x : *points) x = x * (1 / o.units);
        auto in_metres = o;
        in_metres.units = 1;
        const auto errors = test::compare(metres, order, in_metres, motion, test::skeleton_body(),
                                          joint_names_of(test::skeleton_body()));
        CHECK(errors.limbs < 1e-4);
        CHECK(errors.trunk < 1e-4);
        CHECK(errors.hips < 1e-8);
        CHECK(errors.ankles < 0.02);
        CHECK(errors.left > 0.99);
    };
    for (const char* order : {"XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"})
        check({.names = test::Names::cmu, .rest = test::Rest::A, .units = 100}, order, "centimetres");
    check({.units = 1 / 0.0254}, "ZXY", "inches");
    check({.names = test::Names::cmu, .rest = test::Rest::down, .units = 0.45 / 0.0254}, "ZYX", "units of CMU");
    check({.units = 1}, "ZXY", "metres");
    check({.units = 1000}, "ZXY", "millimetres");
    check({.units = 5}, "ZXY", "multiples of 0.19"); // no unit that is known
    check({.names = test::Names::bvh, .units = 100, .z_up = true}, "ZXY", "centimetres");
    check({.names = test::Names::bvh, .rest = test::Rest::down, .units = 1 / 0.0254, .z_up = true}, "XYZ", "inches");
}

TEST_CASE("a world with z up is turned, also where only the frames or only the rest pose stand along z") {
    const test::Temporary folder;
    const auto load = [&](const test::SampleRig& sample) {
        write_file(folder / "a.bvh", test::bvh_text(sample, "XYZ"));
        std::vector<std::string> warnings;
        std::pair<RigMotion, std::string> result{load_bvh(folder / "a.bvh", {}, &warnings), ""};
        for (const auto& warning : warnings) result.second += warning + "\n";
        return result;
    };
    // As pybvh's bvh_test3: zero angles stand along y, the root's channels turn the figure, the ground is at z = 0.
    auto walk = test::walking_rig({.units = 100});
    for (std::size_t t = 0; t < walk.root.size(); ++t) {
        walk.root[t] = {walk.root[t].x, -walk.root[t].z, walk.root[t].y};
        walk.angles[t][0] = {1.5707963267948966, walk.angles[t][0].y, 0}; // in the order XYZ
    }
    const auto [rig, warnings] = load(walk);
    CHECK(warnings == test::contains("z is up, so the world is turned to y up\n"));
    const auto head = std::find(rig.names.begin(), rig.names.end(), "mixamorig:Head") - rig.names.begin();
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        CHECK(rig.joint(t, static_cast<int>(head)).y - rig.joint(t, 0).y > 0.5);
    // As a dive of BVHFiles.jl's example: zero angles stand along z, and so does the world; somersaults have no axis.
    auto dive = test::walking_rig({.units = 100, .z_up = true});
    for (std::size_t t = 0; t < dive.root.size(); ++t) {
        dive.root[t].z += 200;
        dive.angles[t][0] = {0.21 * static_cast<double>(t), 0, 0};
    }
    const auto [dives, doubt] = load(dive);
    CHECK(doubt == test::contains("z is up, so the world is turned to y up; that is uncertain"));
    CHECK(dives.joint(0, 0).y > 2.5);
}

TEST_CASE("who lies on the ground is not taken for standing along z") {
    const test::Temporary folder;
    auto sample = test::sample_rig({.units = 100, .frames = 3});
    for (auto& angles : sample.angles) angles[0] = {1.5707963267948966, 0, 0}; // face down, the head towards +z
    write_file(folder / "a.bvh", test::bvh_text(sample));
    const RigMotion rig = load_bvh(folder / "a.bvh");
    const auto ankle = std::find(rig.names.begin(), rig.names.end(), "mixamorig:LeftFoot") - rig.names.begin();
    CHECK(rig.joint(0, static_cast<int>(ankle)).z < rig.joint(0, 0).z - 0.5);
}

TEST_CASE("the rate that the caller states, a frame time of 0, and names that are repeated") {
    const test::Temporary folder;
    const auto load = [&](const std::string& text, const FrameRates& rates, std::vector<std::string>& warnings) {
        write_file(folder / "a.bvh", text);
        return load_bvh(folder / "a.bvh", {}, &warnings, rates);
    };
    std::vector<std::string> warnings;
    CHECK(load(small_file(), {50, 0}, warnings).timestamps == std::vector<double>{0, 0.02});
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("25 frames per second, but --input-fps states 50"));
    warnings.clear();
    CHECK(load(small_file(), {25, 10}, warnings).timestamps == std::vector<double>{0, 0.04});
    CHECK(load(small_file({{"0.04", "40"}}), {25, 0}, warnings).timestamps[1] == doctest::Approx(0.04));
    CHECK(warnings.size() == 1); // the rates differ
    warnings.clear();
    CHECK(load(small_file({{"0.04", "0"}}), {}, warnings).timestamps[1] == doctest::Approx(1 / 30.0));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("states no frame rate"));
    const RigMotion twice = load(small_file({{"JOINT Knee", "JOINT Hip: the first"}}), {}, warnings);
    CHECK(twice.names[1] == "Hip: the first#2");
}

TEST_CASE("damaged files are refused with the line and what was found") {
    const test::Temporary folder;
    const auto refuse = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        write_file(folder / "bad.bvh", text);
        test::check_throws<Error>([&] { (void)load_bvh(folder / "bad.bvh"); }, {"bad.bvh"});
        test::check_throws<Error>([&] { (void)load_bvh(folder / "bad.bvh"); }, words);
    };
    refuse("", {"is empty, expected a BVH file"});
    refuse("\n", {"ends too early", "HIERARCHY"});
    refuse("something else\n", {":1:", "HIERARCHY"});
    refuse(small_file({{"CHANNELS 6", "CHANNELS 5"}}), {":5:", "6 channels", "'5'"});
    refuse(small_file({{"Yrotation\n  JOINT", "Wrotation\n  JOINT"}}), {":5:", "Wrotation"});
    refuse(small_file({{"Yrotation\n  JOINT", "Xrotation\n  JOINT"}}), {":5:", "Xrotation", "twice"});
    refuse(small_file({{"90 0 0 0 90 0", "90 0 0 0 90"}}), {":20:", "8 numbers", "expected 9"});
    refuse(small_file({{"90 0 0 0 90 0", "90 0 0 0 90 0 1"}}), {":20:", "10 numbers", "expected 9"});
    refuse(small_file({{"Frames: 2", "Frames: 3"}}), {"states 3 frames", "2 lines"});
    refuse(small_file({{"Frames: 2", "Frames: 1e18"}}), {"states 1e+18 frames"});
    refuse(small_file({{"Frames: 2", "Frames: 1.5"}}), {"1.5 frames", "whole number"});
    refuse(small_file({{"Frames: 2", "Frames: -2"}}), {"-2 frames"});
    refuse(small_file({{"Frames: 2", "Frames: two"}}), {":17:", "'two'"});
    refuse(small_file({{"0.04", "-0.04"}}), {"frame time of -0.04", "more than 0"});
    refuse(small_file({{"0.04", "40"}}), {"'Frame Time:' states 40 s", "--input-fps"});
    refuse(small_file({{"4 5 6", "4 nan 6"}}), {":20:", "'nan'", "finite"});
    refuse(small_file({{"4 5 6", "4 1e999 6"}}), {":20:", "'1e999'"});
    refuse(small_file({{"4 5 6", "4 5,0 6"}}), {":20:", "'5,0'"});
    refuse(small_file({{"JOINT Knee", "JOINT"}}), {":6:", "without a name"});
    refuse(small_file({{"JOINT Knee", "JOINT " + std::string(300, 'k')}}), {":6:", "300 bytes, expected at most 256"});
    refuse(small_file({{"OFFSET 0 -1 0", "OFFSET 0 -1"}}), {":8:", "2 numbers", "expected 3"});
    refuse(small_file({{"  }\n}\nMOTION", "  }\nMOTION"}}), {"brace"});
    refuse(small_file({{"MOTION\n", "ROOT Second\n{\nOFFSET 0 0 0\n}\nMOTION\n"}}), {"second ROOT", "Hip: the first"});
    refuse(small_file({{"MOTION\n", ""}}), {"Frames: 2"});
    refuse(small_file().substr(0, 200), {"MOTION"});
    refuse(small_file({{"CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n", "CHANNELS 0\n"},
                       {"CHANNELS 3 Yrotation Xrotation Zrotation\n", "\n"}}),
           {"without any channels"});
    std::string deep = "HIERARCHY\nROOT j\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n";
    for (int level = 0; level < 300; ++level) deep += "JOINT j" + std::to_string(level) + "\n{\nOFFSET 0 0 0\n";
    refuse(deep, {"deeper than 256 levels"});
    std::string wide = "HIERARCHY\nROOT j\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"; // little text, much memory
    for (int joint = 0; joint < 4000; ++joint) wide += "JOINT j" + std::to_string(joint) + "\n{\n}\n";
    wide += "}\nMOTION\nFrames: 8000\nFrame Time: 1\n";
    for (int frame = 0; frame < 8000; ++frame) wide += "0\n";
    refuse(wide, {"8000 frames of 4001 joints", "at most"});
    test::check_throws<IoError>([&] { (void)load_bvh(folder / "none.bvh"); }, {"none.bvh", "No such file"});
}

TEST_CASE("thousands of joints with the names of a leg are refused within a moment") {
    const test::Temporary folder;
    std::string text = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n";
    for (const char* name : {"LeftUpLeg", "LeftLeg"}) { // ladders of 200 joints, each with nine beside it
        for (int level = 0; level < 200; ++level) {
            for (int k = 0; k < 9; ++k) text += std::string("JOINT ") + name + "\n{\nOFFSET 0 1 0\n}\n";
            text += std::string("JOINT ") + name + "\n{\nOFFSET 0 1 0\n";
        }
        for (int level = 0; level < 200; ++level) text += "}\n";
    }
    write_file(folder / "a.bvh", text + "}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0\n");
    const auto begin = std::chrono::steady_clock::now();
    test::check_throws<ValueError>([&] { (void)load_bvh(folder / "a.bvh"); }, {"a.bvh", "several joints"});
    CHECK(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < 5);
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    const std::string text = small_file();
    const std::size_t refused =
        test::read_damaged(text, folder / "fuzz.bvh", 1, 2000, [](const auto& path) { (void)load_bvh(path); });
    CHECK(refused > text.size() * 9 / 10);
    const auto sample = test::sample_rig({.units = 100, .frames = 2});
    test::read_damaged(test::bvh_text(sample), folder / "rig.bvh", 61, 600, [](const auto& path) {
        RetargetParams options;
        options.where = path.string();
        (void)retarget(load_bvh(path), test::skeleton_body(), {}, options);
    });
}

TEST_CASE("more lines than 'Frames:' states are frames, too, with a warning") {
    const test::Temporary folder;
    const auto read = [&](const std::string& from, const std::string& to, std::vector<std::string>& warnings) {
        write_file(folder / "a.bvh", small_file({{from, to}}));
        return load_bvh(folder / "a.bvh", {}, &warnings);
    };
    std::vector<std::string> none;
    const RigMotion exact = read("Frames: 2", "Frames: 2", none);
    CHECK(none.empty());
    CHECK(read("Frames: 2", "Frames:2", none).frame_count() == 2);
    CHECK(read("Frame Time: 0.04\n", "Frame Time:0.04\n\n \t\n", none).timestamps[1] == 0.04); // lines without numbers
    CHECK(none.empty());
    for (const std::string stated : {"1", "0"}) {
        std::vector<std::string> warnings;
        const RigMotion rig = read("Frames: 2", "Frames: " + stated, warnings);
        CHECK(rig.joints == exact.joints);
        CHECK(rig.timestamps == exact.timestamps);
        REQUIRE(warnings.size() == 1);
        CHECK(warnings[0] == test::contains("states " + stated + " frames, but 2 lines follow; all of them are read"));
    }
    write_file(folder / "a.bvh", small_file().substr(0, small_file().find("0 0 0 0 0 0 0 0 0")));
    test::check_throws<IoError>([&] { (void)load_bvh(folder / "a.bvh"); }, {"states 2 frames, but 0 lines follow"});
    write_file(folder / "a.bvh",
               small_file({{"Frames: 2", "Frames: 0"}}).substr(0, small_file().find("0 0 0 0 0 0 0 0 0")));
    test::check_throws<IoError>([&] { (void)load_bvh(folder / "a.bvh"); }, {"holds no frames"});
}

TEST_CASE("a frame time of zero is 1/30 s, one above a second is warned about") {
    const test::Temporary folder;
    for (const auto& [stated, step, word] : {std::tuple{"0", 1.0 / 30, "states no frame rate"},
                                             {"0.0", 1.0 / 30, "states no frame rate"},
                                             {"3.5", 3.5, "is it in milliseconds"}}) {
        write_file(folder / "a.bvh", small_file({{"Frame Time: 0.04", std::string("Frame Time: ") + stated}}));
        std::vector<std::string> warnings;
        CHECK(load_bvh(folder / "a.bvh", {}, &warnings).timestamps[1] == step);
        REQUIRE(warnings.size() == 1);
        CHECK(warnings[0] == test::contains(word));
    }
}

namespace {

/// The sample as a BVH in which every joint has position channels. `place` gives a joint's position in its parent's
/// frame; without `offsets`, the OFFSETs of all joints but the root are zero.
template <class Place>
std::string with_positions(const test::SampleRig& rig, bool offsets, const Place& place) {
    std::ostringstream out;
    out.precision(12);
    std::vector<std::size_t> written;
    const auto write = [&](const auto& self, std::size_t j) -> void {
        const int p = rig.parents[j];
        const vec3<double> o = p < 0 ? rig.rest[j] : rig.rest[j] - rig.rest[static_cast<std::size_t>(p)];
        const double shown = p < 0 || offsets ? 1 : 0;
        out << (p < 0 ? "ROOT " : "JOINT ") << rig.names[j] << "\n{\nOFFSET " << shown * o.x << " " << shown * o.y
            << " " << shown * o.z << "\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n";
        written.push_back(j);
        for (std::size_t k = 0; k < rig.names.size(); ++k)
            if (rig.parents[k] == static_cast<int>(j)) self(self, k);
        out << "}\n";
    };
    out << "HIERARCHY\n";
    write(write, 0);
    out << "MOTION\nFrames: " << rig.root.size() << "\nFrame Time: 0.04\n";
    for (std::size_t t = 0; t < rig.root.size(); ++t) {
        for (const std::size_t j : written) {
            const vec3<double> at = rig.parents[j] < 0 ? rig.root[t] : place(t, j);
            const vec3<double>& a = rig.angles[t][j];
            for (const double x :
                 {at.x, at.y, at.z, a.z * 57.295779513082323, a.x * 57.295779513082323, a.y * 57.295779513082323})
                out << x << " ";
        }
        out << "\n";
    }
    return out.str();
}

} // namespace

TEST_CASE("position channels turn limbs: they point where the source's joints are") {
    const test::Temporary folder;
    const test::SampleOptions o{.fingers = true, .frames = 5};
    const auto sample = test::sample_rig(o);
    const auto offset = [&](std::size_t j) {
        return sample.rest[j] - sample.rest[static_cast<std::size_t>(sample.parents[j])];
    };
    for (const bool offsets : {true, false})
        for (const bool moved : {true, false}) {
            test::Rng rng(5);
            std::vector<vec3<double>> shifts;
            for (std::size_t i = 0; i < 5 * sample.names.size(); ++i)
                shifts.push_back(rng.vec(-0.08, 0.08)); // metres, of shins of 0.41
            const auto place = [&](std::size_t t, std::size_t j) {
                const std::string& part = sample.parts[j];
                const bool limb = part.ends_with("knee") || part.ends_with("ankle") || part.ends_with("elbow") ||
                                  part.ends_with("wrist");
                return offset(j) + (moved && limb ? shifts[t * sample.names.size() + j] : vec3<double>(0));
            };
            write_file(folder / "a.bvh", with_positions(sample, offsets, place));
            const Motion motion = retarget(load_bvh(folder / "a.bvh"), test::skeleton_body());
            double worst = 0;
            for (std::size_t t = 0; t < 5; ++t) {
                const auto turned = test::pose_of(sample, t, "ZXY"); // its rotations are the file's
                const auto pose = test::pose_of(test::skeleton_body(), motion, t);
                for (const std::string side : {"left_", "right_"})
                    for (const auto& [from, to] :
                         {std::pair{"hip", "knee"}, {"knee", "ankle"}, {"shoulder", "elbow"}, {"elbow", "wrist"}}) {
                        const auto a = static_cast<std::size_t>(sample.joint(side + from)),
                                   b = static_cast<std::size_t>(sample.joint(side + to));
                        const vec3<double> expected = turned.rotations[a] * place(t, b);
                        const vec3<double> found = pose.joints[static_cast<std::size_t>(smplx_joint(side + to))] -
                                                   pose.joints[static_cast<std::size_t>(smplx_joint(side + from))];
                        worst = std::max(worst, test::degrees_between(expected, found));
                    }
            }
            CHECK(worst < 1e-4);
        }
}
