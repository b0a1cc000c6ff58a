// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-motion: from every layout to every other, and what it refuses.

#include "io/bvh_files.hpp"
#include "io/gltf_files.hpp"
#include "programs/process.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;

namespace {

/// Body and motion in files.
struct Inputs {
    test::Temporary folder;
    const BodyModel& body = test::skeleton_body();
    fs::path body_file = folder / "body.npz", motion_file = folder / "stride.npz";
    Motion motion = actor_motion(ActorMotion::stride, 5);

    Inputs() {
        BodyModel stored = body; // files have triangles
        stored.faces = {{0, 1, 2}};
        save_body_model(body_file, stored);
        motion.expression_count = 0, motion.expression.clear(), motion.betas = {0.0};
        save_motion(motion_file, motion);
    }
    [[nodiscard]] test::Outcome convert(const fs::path& from, const fs::path& to,
                                        const std::vector<std::string>& more = {}) const {
        std::vector<std::string> words{"gsh-motion", from.string(), "--out", to.string(), "--body", body_file.string()};
        words.insert(words.end(), more.begin(), more.end());
        return run(words);
    }
};

/// Converted, perhaps with warnings: the unit of BVH is always a guess.
void check_converted(const test::Outcome& outcome) {
    INFO(outcome.err);
    CHECK(outcome.code == 0);
}

double largest_angle(const Motion& a, const Motion& b) {
    double angle = 0;
    REQUIRE(a.pose.size() == b.pose.size());
    for (std::size_t i = 0; i < a.pose.size(); ++i)
        angle = std::max(angle, length(axis_angle_from_rotation(transpose(rotation_from_axis_angle(a.pose[i])) *
                                                                rotation_from_axis_angle(b.pose[i]))));
    return angle;
}

} // namespace

TEST_CASE("our motion to BVH and GLB and back, within 1e-4 rad") {
    const Inputs s;
    for (const char* name : {"a.bvh", "a.glb"}) {
        const auto outcome = s.convert(s.motion_file, s.folder / name);
        check_converted(outcome);
        CHECK(outcome.out == test::contains("5 frames, 0.40 s, of 55 joints in "));
        check_converted(s.convert(s.folder / name, s.folder / "back.npz"));
        const Motion back = load_motion(s.folder / "back.npz", s.body);
        CHECK(largest_angle(s.motion, back) < 1e-4);
        for (std::size_t t = 0; t < 5; ++t) {
            CHECK(length(back.transl[t] - s.motion.transl[t]) < 1e-5);
            CHECK(back.timestamps[t] == doctest::Approx(s.motion.timestamps[t]));
        }
    }
    check_converted(run({"gsh-motion", (s.folder / "a.bvh").string(), "--out", (s.folder / "actor.npz").string()}));
    CHECK(load_motion(s.folder / "actor.npz", s.body).frame_count() == 5); // the built-in actor
    check_converted(s.convert(s.folder / "a.bvh", s.folder / "fast.npz", {"--fps", "40"}));
    CHECK(load_motion(s.folder / "fast.npz", s.body).frame_count() == 17);
}

TEST_CASE("the rate of the input: 30 with a warning where the file states none, or that of --input-fps") {
    const Inputs s;
    const std::size_t T = s.motion.frame_count(), J = s.motion.joint_count;
    NpzWriter file(s.folder / "bare.npz"); // in AMASS' layout, without a rate
    file.add("poses", std::vector<double>(3 * T * J), {T, 3 * J});
    file.add("trans", std::vector<double>(3 * T), {T, 3});
    file.add("betas", std::vector<double>(1));
    file.commit();
    const auto check_last = [&](const std::string& from, const std::vector<std::string>& options, double seconds,
                                bool warned) {
        const auto outcome = s.convert(s.folder / from, s.folder / "result.npz", options);
        check_converted(outcome);
        CHECK((outcome.err.find("frames per second") != std::string::npos) == warned);
        CHECK(load_motion(s.folder / "result.npz", s.body).timestamps.back() == doctest::Approx(seconds));
    };
    const double frames = static_cast<double>(T - 1);
    check_last("bare.npz", {}, frames / 30, true);
    check_last("bare.npz", {"--input-fps", "120"}, frames / 120, false);
    check_last("bare.npz", {"--input-fps", "0"}, frames / 30, true);
    for (const char* name : {"a.bvh", "a.glb", "a.npz"}) { // 10 frames a second
        check_converted(s.convert(s.motion_file, s.folder / name));
        check_last(name, {}, frames / 10, false);
        check_last(name, {"--input-fps", "20"}, frames / 20, true);
        check_last(name, {"--input-fps", "10"}, frames / 10, false);
    }
}

TEST_CASE("another program's BVH drives the body; warnings say what was guessed") {
    const Inputs s;
    const test::SampleOptions o{.names = test::Names::cmu, .rest = test::Rest::down};
    auto sample = test::sample_rig({.names = test::Names::cmu, .rest = test::Rest::down, .units = 100});
    write_file(s.folder / "walk.bvh", test::bvh_text(sample, "ZYX"));
    const auto outcome = s.convert(s.folder / "walk.bvh", s.folder / "walk.npz");
    check_converted(outcome);
    CHECK(outcome.err == test::contains("warning: "));
    CHECK(outcome.err == test::contains("taken as centimetres"));
    CHECK(outcome.err == test::contains("no joint was found for jaw"));
    const Motion motion = load_motion(s.folder / "walk.npz", s.body);
    sample = test::sample_rig(o);
    CHECK(test::compare(sample, "ZYX", o, motion, s.body, joint_names_of(s.body)).limbs < 1e-4);
}

TEST_CASE("every refusal is one line and code 2, and writes nothing") {
    const Inputs s;
    const auto files = s.folder.file_count();
    const fs::path bad = s.folder / "bad.bvh", out = s.folder / "out.npz";
    const auto refuse = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        write_file(bad, text);
        check_refused(s.convert(bad, out), "gsh-motion", words);
        CHECK(!fs::exists(out));
    };
    const auto sample = test::sample_rig({.units = 100});
    const std::string good = test::bvh_text(sample);
    const auto changed = [&](const std::string& from, const std::string& to) {
        std::string text = good;
        text.replace(text.find(from), from.size(), to);
        return text;
    };
    refuse(changed("Frames: 4", "Frames: 400"), {"bad.bvh", "states 400 frames", "4 lines"});
    refuse(changed("CHANNELS 3", "CHANNELS 2"), {"bad.bvh", "3 channels", "'2'"});
    refuse(changed("mixamorig:RightUpLeg", "mixamorig:LeftUpLeg"),
           {"bad.bvh", "no joint was found for right_hip", "mixamorig:LeftUpLeg#2"});
    refuse(changed("mixamorig:LeftUpLeg", "Bone"), {"bad.bvh", "no joint was found for left_hip", "mixamorig:LeftLeg"});
    refuse(changed("mixamorig:Hips", "Bone"), {"pelvis"});
    refuse(good + "nan\n", {"bad.bvh:", "'nan'", "finite number"}); // a fifth line is read, too
    refuse("", {"bad.bvh"});
    fs::remove(bad);
    check_refused(s.convert(s.folder / "none.glb", out), "gsh-motion", {"none.glb", "No such file"});
    check_refused(s.convert(s.motion_file, s.folder / "out.fbx"), "gsh-motion", {"out.fbx", ".npz, .bvh or .glb"});
    check_refused(s.convert(s.motion_file, s.folder / "none/out.glb"), "gsh-motion", {"none/out.glb"});
    check_refused(s.convert(s.motion_file, out, {"--joint-map", (s.folder / "map.json").string()}), "gsh-motion",
                  {"map.json", "No such file"});
    check_refused(run({"gsh-motion", s.motion_file.string()}), "gsh-motion", {"--out"});
    check_refused(s.convert(s.motion_file, out, {"--fps", "0"}), "gsh-motion", {"--fps", "above 0"});
    for (const char* rate : {"-1", "many", "1e9"})
        check_refused(s.convert(s.motion_file, out, {"--input-fps", rate}), "gsh-motion", {"--input-fps", rate});
    check_refused(s.convert(s.motion_file, out, {"--input-fps", "30,60"}), "gsh-motion", {"2 rates for 1 motion"});
    CHECK(s.folder.file_count() == files);

    // A joint map helps.
    write_file(bad, changed("mixamorig:LeftUpLeg", "Bone"));
    write_file(s.folder / "map.json", R"({"Bone": "left_hip"})");
    check_converted(s.convert(bad, out, {"--joint-map", (s.folder / "map.json").string()}));
}
