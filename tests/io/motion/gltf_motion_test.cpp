// SPDX-License-Identifier: Apache-2.0
/// @file  Animations of glTF, GLB, VRM: rest poses, armatures, interpolation; every kind of damage is refused.

#include "io/damage.hpp"
#include "io/gltf_files.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/sample_rig.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>
#include <gsh/io/motion/gltf_motion.hpp>

#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

void check_follows(const test::SampleOptions& o, const test::GltfOptions& g, const std::string& ending = ".glb") {
    const test::Temporary folder;
    const auto sample = test::sample_rig(o);
    const auto files = test::gltf_of(sample, g);
    write_file(folder / ("a" + ending), ending == ".glb" ? files.glb() : files.gltf());
    std::vector<std::string> warnings;
    const RigMotion rig = load_gltf_motion(folder / ("a" + ending), {}, &warnings);
    for (const auto& warning : warnings) FAIL_CHECK(warning);
    REQUIRE(rig.frame_count() == o.frames);
    CHECK(rig.timestamps.back() == doctest::Approx(0.5 + g.step * static_cast<double>(o.frames - 1)));
    const Motion motion = retarget(rig, test::skeleton_body());
    const auto errors =
        test::compare(sample, "ZXY", o, motion, test::skeleton_body(), joint_names_of(test::skeleton_body()));
    CHECK(errors.limbs < 0.001); // degrees; the file's numbers are floats
    CHECK(errors.trunk < 0.001);
    CHECK(errors.hips < 1e-5);
    CHECK(errors.ankles < 0.02);
    CHECK(errors.left > 0.99);
}

/// A small file, changed.
std::string changed(const std::function<void(test::Json&)>& change) {
    auto files = test::gltf_of(test::sample_rig({.spine = 1, .toes = false, .frames = 2}));
    change(files.json);
    return files.glb();
}

} // namespace

TEST_CASE("the body follows a file's animation, for every rest pose and name") {
    for (const auto rest : {test::Rest::T, test::Rest::A, test::Rest::down})
        for (const auto names : {test::Names::smplx, test::Names::mixamo, test::Names::unreal})
            check_follows({.names = names, .rest = rest}, {.axes = 3});
    check_follows({}, {}, ".gltf"); // the bytes in base64
    check_follows({.frames = 1}, {.step = 1}, ".gltf");
}

TEST_CASE("an armature scaled by 0.01 and turned; rest poses from skins") {
    check_follows({.rest = test::Rest::A}, {.axes = 2, .armature = true});
    check_follows({.rest = test::Rest::A}, {.axes = 2, .armature = true, .skin = true});
    check_follows({.rest = test::Rest::down}, {.axes = 2, .armature = true, .skin = true, .posed_nodes = true});
    check_follows({.rest = test::Rest::A}, {.skin = true, .posed_nodes = true});
}

TEST_CASE("VRM: bones by the extension, whatever the nodes are called") {
    check_follows({.names = test::Names::vrm, .rest = test::Rest::A, .fingers = true}, {.axes = 4, .vrm = true});
    // VRM 0.x lists bones, and faces -z
    const test::Temporary folder;
    const test::SampleOptions o{.names = test::Names::vrm, .turn = 3.14159265358979324};
    auto files = test::gltf_of(test::sample_rig(o), {.vrm = true});
    auto bones = test::Json::array();
    for (const auto& [name, bone] : files.json["extensions"]["VRMC_vrm_animation"]["humanoid"]["humanBones"].items())
        bones.push_back({{"bone", name}, {"node", bone["node"]}});
    files.json["extensions"] = {{"VRM", {{"humanoid", {{"humanBones", bones}}}}}};
    write_file(folder / "a.vrm", files.glb());
    const Motion motion = retarget(load_gltf_motion(folder / "a.vrm"), test::skeleton_body());
    CHECK(test::compare(test::sample_rig(o), "ZXY", o, motion, test::skeleton_body(),
                        joint_names_of(test::skeleton_body()))
              .limbs < 0.001);
}

TEST_CASE("nodes may have the same name, as ends of chains do") {
    const test::Temporary folder;
    auto files = test::gltf_of(test::sample_rig());
    const std::size_t before = files.json["nodes"].size();
    for (std::size_t n = 0; n < 4; ++n) {
        files.json["nodes"][n]["children"].push_back(files.json["nodes"].size());
        files.json["nodes"].push_back({{"name", "ENDSITE"}});
    }
    write_file(folder / "a.glb", files.glb());
    const RigMotion rig = load_gltf_motion(folder / "a.glb");
    REQUIRE(rig.joint_count() == before + 4);
    std::set<std::string> names(rig.names.begin(), rig.names.end());
    for (const char* name : {"ENDSITE", "ENDSITE#2", "ENDSITE#3", "ENDSITE#4"}) CHECK(names.contains(name));
    const test::SampleOptions o;
    const Motion motion = retarget(rig, test::skeleton_body());
    CHECK(test::compare(test::sample_rig(o), "ZXY", o, motion, test::skeleton_body(),
                        joint_names_of(test::skeleton_body()))
              .limbs < 0.001);
    // One of two joints for the left thigh is left out by the joint map.
    files.json["nodes"].back()["name"] = "mixamorig:LeftUpLeg";
    files.json["nodes"].back()["children"] = {before};
    files.json["nodes"][0]["children"].erase(files.json["nodes"][0]["children"].size() - 1);
    write_file(folder / "b.glb", files.glb());
    const RigMotion two = load_gltf_motion(folder / "b.glb", {{{"mixamorig:LeftUpLeg#2", ""}}});
    CHECK(JointMap{{{"mixamorig:LeftUpLeg#2", ""}}}.match(two, "b.glb")[1] >= 0);
}

TEST_CASE("an animation of the upper body alone: legs keep the pose of their nodes") {
    const test::Temporary folder;
    const auto sample = test::sample_rig();
    auto files = test::gltf_of(sample);
    auto& animation = files.json["animations"][0];
    auto kept = test::Json::array();
    const auto is_upper = [&](std::size_t node) {
        const std::string& part = sample.parts[node]; // nodes are joints
        for (const char* word : {"spine", "neck", "head", "collar", "shoulder", "elbow", "wrist"})
            if (part.find(word) != std::string::npos) return true;
        return false;
    };
    for (const auto& channel : animation["channels"])
        if (is_upper(channel["target"]["node"].get<std::size_t>())) kept.push_back(channel);
    animation["channels"] = kept;
    write_file(folder / "a.glb", files.glb());
    const RigMotion rig = load_gltf_motion(folder / "a.glb");
    CHECK(rig.joint_count() == sample.names.size());
    const Motion motion = retarget(rig, test::skeleton_body());
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        for (const char* joint : {"left_hip", "right_hip", "left_knee", "right_knee"})
            CHECK(length(motion.pose_at(t)[static_cast<std::size_t>(smplx_joint(joint))] -
                         motion.pose_at(0)[static_cast<std::size_t>(smplx_joint(joint))]) < 1e-5);
    // The source's arms, as it is posed with the hips at rest
    const auto pose = test::pose_of(test::skeleton_body(), motion, 2);
    auto still = sample;
    for (auto& angles : still.angles)
        for (std::size_t j = 0; j < angles.size(); ++j)
            if (!is_upper(j)) angles[j] = vec3<double>(0);
    const auto truth = test::pose_of(still, 2, "ZXY");
    const auto own = [&](const char* joint) { return pose.joints[static_cast<std::size_t>(smplx_joint(joint))]; };
    const auto source = [&](const char* joint) { return truth.joints[static_cast<std::size_t>(sample.joint(joint))]; };
    for (const auto& [from, to] : {std::pair{"left_shoulder", "left_elbow"}, {"right_elbow", "right_wrist"}})
        CHECK(test::degrees_between(own(to) - own(from), source(to) - source(from)) < 0.01);
}

TEST_CASE("the rate that the caller states changes key frames that are even, and no others") {
    const test::Temporary folder;
    std::vector<std::string> warnings;
    write_file(folder / "a.glb", test::gltf_of(test::sample_rig()).glb());
    const RigMotion even = load_gltf_motion(folder / "a.glb", {}, &warnings, {}, {60, 0});
    CHECK(even.timestamps[3] == doctest::Approx(3 / 60.0));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("30 frames per second, but --input-fps states 60"));
    warnings.clear();
    write_file(folder / "b.glb", test::gltf_of(test::sample_rig({.frames = 3}), {.step = 1}).glb());
    CHECK(load_gltf_motion(folder / "b.glb", {}, &warnings, {}, {60, 0}).timestamps.back() == doctest::Approx(2.5));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("not applied"));
}

TEST_CASE("interpolation: sparse keys give 30 frames a second; steps stay, splines are smooth") {
    const test::Temporary folder;
    const auto sample = test::sample_rig({.frames = 3});
    for (const std::string kind : {"LINEAR", "STEP", "CUBICSPLINE"}) {
        write_file(folder / "a.glb", test::gltf_of(sample, {.step = 1, .interpolation = kind}).glb());
        const RigMotion rig = load_gltf_motion(folder / "a.glb");
        REQUIRE(rig.frame_count() == 61);
        CHECK(rig.timestamps[60] == doctest::Approx(2.5));
        const auto hips = [&](std::size_t t) { return rig.joint(t, 0); };
        CHECK(length(hips(30) - sample.root[1]) < 1e-6);                                       // keys are met
        const double u = kind == "STEP" ? 0 : kind == "LINEAR" ? 1.0 / 3 : 3.0 / 9 - 2.0 / 27; // a third of the way
        CHECK(length(hips(40) - (sample.root[1] * (1 - u) + sample.root[2] * u)) < 1e-6);
        // A rotation about a fixed axis, at a third of the way.
        const auto from = test::pose_of(sample, 1, "ZXY").rotations[0],
                   to = test::pose_of(sample, 2, "ZXY").rotations[0];
        const vec3<double> turn = axis_angle_from_rotation(transpose(from) * to);
        if (kind == "LINEAR")
            CHECK(length(axis_angle_from_rotation(transpose(from * rotation_from_axis_angle(turn * u)) *
                                                  rig.rotation(40, 0))) < 1e-6);
        if (kind == "STEP") CHECK(length(axis_angle_from_rotation(transpose(from) * rig.rotation(40, 0))) < 1e-6);
    }
}

TEST_CASE("translations of a limb's joint turn the limb: it points where the source's joint is") {
    const test::Temporary folder;
    const test::SampleOptions o;
    const auto sample = test::sample_rig(o);
    auto files = test::gltf_of(sample);
    auto& animation = files.json["animations"][0];
    const auto knee = static_cast<std::size_t>(sample.joint("left_knee")),
               ankle = static_cast<std::size_t>(sample.joint("left_ankle"));
    test::Rng rng(4);
    std::vector<vec3<double>> places;
    std::vector<double> numbers;
    for (std::size_t t = 0; t < o.frames; ++t) {
        places.push_back(sample.rest[ankle] - sample.rest[knee] + rng.vec(-0.1, 0.1));
        numbers.insert(numbers.end(), {places[t].x, places[t].y, places[t].z});
    }
    animation["channels"].push_back(
        {{"sampler", animation["samplers"].size()}, {"target", {{"node", ankle}, {"path", "translation"}}}});
    animation["samplers"].push_back({{"input", animation["samplers"][0]["input"]},
                                     {"output", files.add(numbers, "VEC3", 3)},
                                     {"interpolation", "LINEAR"}});
    write_file(folder / "a.glb", files.glb());
    const Motion motion = retarget(load_gltf_motion(folder / "a.glb"), test::skeleton_body());
    for (std::size_t t = 0; t < o.frames; ++t) {
        const auto pose = test::pose_of(test::skeleton_body(), motion, t);
        const auto at = [&](const char* joint) { return pose.joints[static_cast<std::size_t>(smplx_joint(joint))]; };
        CHECK(test::degrees_between(test::pose_of(sample, t, "ZXY").rotations[knee] * places[t],
                                    at("left_ankle") - at("left_knee")) < 0.001);
    }
}

TEST_CASE("normalised integers, several animations, other units") {
    const test::Temporary folder;
    auto files = test::gltf_of(test::sample_rig());
    // The head's rotations as normalised 16-bit integers: half a right angle about y.
    auto& accessor = files.json["accessors"][files.json["animations"][0]["samplers"][6]["output"].get<std::size_t>()];
    const auto offset = files.bytes.size();
    for (int t = 0; t < 4; ++t)
        for (const int x : {0, 12539, 0, 30273}) files.bytes.append(reinterpret_cast<const char*>(&x), 2);
    accessor = {{"bufferView", files.json["bufferViews"].size()},
                {"componentType", 5122},
                {"count", 4},
                {"type", "VEC4"},
                {"normalized", true}};
    files.json["bufferViews"].push_back({{"buffer", 0}, {"byteOffset", offset}, {"byteLength", 32}});
    files.json["buffers"][0]["byteLength"] = files.bytes.size();
    auto second = files.json["animations"][0];
    second["name"] = "run";
    second["channels"] = test::Json::array({second["channels"][0]});
    files.json["animations"].push_back(second);
    write_file(folder / "a.glb", files.glb());
    std::vector<std::string> warnings;
    const RigMotion rig = load_gltf_motion(folder / "a.glb", {}, &warnings);
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("2 animations (walk, run); 'walk' is read"));
    int head = 0; // the sample's joint 5 has sampler 6, because the root has two
    while (rig.names[static_cast<std::size_t>(head)] != "mixamorig:Head") ++head;
    const auto local = transpose(rig.rotation(2, rig.parents[static_cast<std::size_t>(head)])) * rig.rotation(2, head);
    CHECK(length(axis_angle_from_rotation(local) - vec3<double>(0, 0.785398, 0)) < 1e-4);
    const RigMotion other = load_gltf_motion(folder / "a.glb", {}, nullptr, "run");
    CHECK(length(axis_angle_from_rotation(transpose(other.rotation(2, 0)) * other.rotation(2, head))) < 1e-6);
    test::check_throws<IoError>([&] { (void)load_gltf_motion(folder / "a.glb", {}, nullptr, "fly"); },
                                {"no animation 'fly'", "walk, run"});

    auto& third = files.json["animations"].emplace_back(files.json["animations"][0]);
    third["name"] = "smile";
    third["channels"] = test::Json::array({third["channels"][0]});
    third["channels"][0]["target"]["path"] = "weights";
    write_file(folder / "a.glb", files.glb());
    test::check_throws<IoError>([&] { (void)load_gltf_motion(folder / "a.glb", {}, nullptr, "smile"); },
                                {"animation 'smile' moves no node"});

    const test::SampleOptions centimetres{.units = 100};
    write_file(folder / "b.glb", test::gltf_of(test::sample_rig(centimetres)).glb());
    warnings.clear();
    CHECK(load_gltf_motion(folder / "b.glb", {}, &warnings).rest_joints[0].y == doctest::Approx(0.96));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("centimetres"));
}

TEST_CASE("damaged files are refused with the place and what was found") {
    const test::Temporary folder;
    const auto refuse = [&](const std::string& bytes, std::initializer_list<std::string_view> words) {
        write_file(folder / "bad.glb", bytes);
        test::check_throws<Error>([&] { (void)load_gltf_motion(folder / "bad.glb"); }, {"bad.glb"});
        test::check_throws<Error>([&] { (void)load_gltf_motion(folder / "bad.glb"); }, words);
    };
    using J = test::Json;
    refuse("", {"is empty, expected glTF"});
    refuse("\x80\x04}.", {"is a pickle of Python (protocol 4), expected glTF"});
    refuse(changed([](J& j) { j["nodes"][2]["children"].push_back(99); }), {"node 2: child is 99"});
    refuse(changed([](J& j) { j["nodes"][2]["children"].push_back(-1); }), {"node 2: child is -1"});
    refuse(changed([](J& j) { j["nodes"][3]["children"] = {0}; }), {"cycle"});
    refuse(changed([](J& j) { j["nodes"][2]["children"].push_back(1); }), {"node 1 is a child of nodes 0 and 2"});
    refuse(changed([](J& j) {
               for (int n = 0; n < 300; ++n) {
                   j["nodes"].push_back({{"children", {j["nodes"].size() + 1}}});
               }
               j["nodes"].push_back({{"name", "last"}});
           }),
           {"deeper than 256 levels"});
    refuse(changed([](J& j) { j["nodes"][2]["name"] = std::string(800, 'n'); }), {"name of 800 bytes", "at most 768"});
    refuse(changed([](J& j) { j["nodes"][2]["rotation"] = {0, 0, 1}; }), {"rotation has 3 numbers, expected 4"});
    refuse(changed([](J& j) { j["nodes"][2]["translation"] = {{"x", 1}, {"y", 2}, {"z", 3}}; }),
           {"translation of a node is not a list"});
    refuse(changed([](J& j) { j["nodes"][2]["scale"] = {-1, 1, 1}; }), {"mirrored"});
    refuse(changed([](J& j) { // two left legs
               for (auto& node : j["nodes"])
                   for (const std::string bone : {"UpLeg", "Leg"})
                       if (node["name"] == "mixamorig:Right" + bone) node["name"] = "mixamorig:Left" + bone;
           }),
           {"left_hip ('mixamorig:LeftUpLeg', 'mixamorig:LeftUpLeg#2')", "joint map"});
    { // two keys an hour apart, of joints that have no bytes for each frame between them
        auto files = test::gltf_of(test::sample_rig({.frames = 2}), {.step = 4000});
        refuse(files.glb(), {"frames of", "made to exhaust memory"});
    }
    refuse(changed([](J& j) { j["animations"] = J::array(); }), {"no animations"});
    refuse(changed([](J& j) { j.erase("animations"); }), {"no animations"});
    refuse(changed([](J& j) { j["animations"][0]["channels"][0]["target"]["node"] = 4000; }),
           {"channel 0: node is 4000"});
    refuse(changed([](J& j) { j["animations"][0]["channels"][0]["sampler"] = 4000; }), {"channel 0: sampler is 4000"});
    refuse(changed([](J& j) { j["animations"][0]["channels"][1] = j["animations"][0]["channels"][0]; }),
           {"same property"});
    refuse(changed([](J& j) { j["animations"][0]["samplers"][0]["input"] = 4000; }), {"accessor is 4000"});
    refuse(changed([](J& j) { j["animations"][0]["samplers"][0]["output"] = 0; }), {"4 numbers for each element"});
    refuse(changed([](J& j) { j["animations"][0]["samplers"][0]["interpolation"] = "SPHERE"; }), {"'SPHERE'"});
    refuse(changed([](J& j) { j["accessors"][1]["count"] = 1; }), {"2 times, but 4 numbers"});
    refuse(changed([](J& j) { j["accessors"][1]["count"] = 4000000000u; }),
           {"4000000000 elements", "beyond its buffer"});
    refuse(changed([](J& j) { j["accessors"][1]["bufferView"] = 900; }), {"bufferView is 900"});
    refuse(changed([](J& j) { j["accessors"][1]["byteOffset"] = 1u << 30; }), {"beyond its buffer"});
    refuse(changed([](J& j) { j["bufferViews"][1]["byteLength"] = 1u << 30; }), {"beyond its buffer"});
    refuse(changed([](J& j) { j["bufferViews"][1]["buffer"] = 5; }), {"buffer is 5"});
    refuse(changed([](J& j) { j["bufferViews"][0]["byteOffset"] = 24; }), {"do not ascend"});
    refuse(changed([](J& j) { j["buffers"][0]["byteLength"] = 1u << 29; }), {"byteLength is 536870912"});
    refuse(changed([](J& j) { j["buffers"][0]["byteLength"] = 0; }), {"byteLength above 0"});
    refuse(changed([](J& j) { j["buffers"].push_back(j["buffers"][0]); }), {"buffer 1 has no uri"});
    refuse(changed([](J& j) { j["extensionsRequired"] = {"EXT_meshopt_compression"}; }), {"EXT_meshopt_compression"});
    refuse(changed([](J& j) { j["asset"]["version"] = "1.0"; }), {"not glTF 2"});
    refuse(changed([](J& j) {
               j["extensions"] = {{"VRMC_vrm", {{"humanoid", {{"humanBones", {{"hips", {{"node", 77}}}}}}}}}};
           }),
           {"the node of hips is 77"});
    auto files = test::gltf_of(test::sample_rig());
    const float none = std::nanf("");
    std::memcpy(files.bytes.data() + 40, &none, 4);
    refuse(files.glb(), {"NaN"});
    files = test::gltf_of(test::sample_rig({.frames = 2}), {.step = 1e7}); // years: no memory for 30 frames a second
    refuse(files.glb(), {"lasts"});
    refuse("{\"asset\":{\"version\":\"2.0\"},\"extras\":" + std::string(100000, '['), {"nested deeper than 256"});
    std::string many = "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{}";
    for (int n = 0; n < 70000; ++n) many += ",{}";
    refuse(many + "]}", {"nodes has 70001 elements"});
}

TEST_CASE("buffers in other files: only those in the folder, of the size that is stated") {
    const test::Temporary folder;
    std::filesystem::create_directory(folder / "inside");
    const auto files = test::gltf_of(test::sample_rig());
    const auto at = folder / "inside/a.gltf";
    write_file(folder / "inside/my data.bin", files.bytes);
    write_file(folder / "outside.bin", files.bytes);
    write_file(at, files.gltf("my%20data.bin"));
    CHECK(load_gltf_motion(at).frame_count() == 4);
    write_file(folder / "inside/a+b.bin", files.bytes);
    for (const std::string uri : {"a+b.bin", "a%2Bb.bin"}) {
        write_file(at, files.gltf(uri));
        CHECK(load_gltf_motion(at).frame_count() == 4);
    }
    const auto refuse = [&](const std::string& uri, std::initializer_list<std::string_view> words) {
        write_file(at, files.gltf(uri));
        test::check_throws<IoError>([&] { (void)load_gltf_motion(at); }, words);
    };
    for (const std::string uri : {"../outside.bin", "%2e%2e/outside.bin", "x/../../outside.bin", "file:///etc/passwd",
                                  "http://127.0.0.1/a.bin"})
        refuse(uri, {"buffer 0", "leads out of the file's folder"});
    refuse((folder / "outside.bin").string(), {"leads out of the file's folder"});
    std::filesystem::create_symlink(folder / "outside.bin", folder / "inside/link.bin");
    refuse("link.bin", {"leads out of the file's folder"});
    refuse("none.bin", {"none.bin", "cannot be read"});
    refuse(".", {"buffer 0"});
    write_file(folder / "inside/short.bin", files.bytes.substr(1));
    refuse("short.bin", {"is short", std::to_string(files.bytes.size() - 1)});
    refuse("data:application/octet-stream;base64,AAAA", {"buffer 0 is short"});
    // Images are never opened: this one would not be found.
    auto with_image = files;
    with_image.json["images"] = test::Json::array({{{"uri", "../../secret.png"}}});
    write_file(at, with_image.gltf("my%20data.bin"));
    CHECK(load_gltf_motion(at).frame_count() == 4);
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    const auto files = test::gltf_of(test::sample_rig({.spine = 1, .toes = false, .frames = 2}), {.skin = true});
    const auto read = [](const auto& path) {
        RetargetParams options;
        options.where = path.string();
        (void)retarget(load_gltf_motion(path), test::skeleton_body(), {}, options);
    };
    test::read_damaged(files.glb(), folder / "fuzz.glb", 97, 3000, read);
    test::read_damaged(files.gltf(), folder / "fuzz.gltf", 197, 1000, read);
}
