// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_data.hpp>

#include "io/damage.hpp"
#include "io/makehuman_files.hpp"
#include "io/temporary.hpp"

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Loads the sample after a change.
MakeHumanData load_changed(const std::function<void(test::MakeHumanSample&)>& change) {
    test::MakeHumanSample sample;
    change(sample);
    const test::Temporary folder;
    sample.write_zip(folder / "sample.zip", "mpfb2/");
    return load_makehuman(folder / "sample.zip");
}

void check_data_refused(const std::function<void(test::MakeHumanSample&)>& change,
                        std::initializer_list<std::string_view> words) {
    test::check_throws<Error>([&] { (void)load_changed(change); }, words);
}

const std::string weights_of_sample = "rigs/standard/weights.default.json",
                  rig_of_sample = "rigs/standard/rig.default.json";

} // namespace

TEST_CASE("a sample of MakeHuman's data is loaded, joints and weights merged") {
    test::MakeHumanSample sample;
    const MakeHumanData data = load_changed([](test::MakeHumanSample&) {});
    CHECK(data.macros.size() == 336);
    CHECK(data.body_measures.size() == 3); // hip-trans is a pose
    CHECK(data.face_measures.size() == 2); // nose-trans moves sideways
    CHECK(data.targets.size() == 336 + 2 * 5);
    CHECK(data.expressions.size() == 10);
    CHECK(data.skeleton.parents.size() == 55);

    const auto joints = data.skeleton.joints_of(data.mesh.vertices);
    const auto at = [&](const char* name) { return joints[static_cast<std::size_t>(smplx_joint(name))]; };
    CHECK(length(at("left_elbow") - sample.bone("lowerarm01.L")) < 1e-6);
    CHECK(length(at("left_wrist") - sample.bone("wrist.L")) < 1e-6);
    CHECK(length(at("right_thumb2") - sample.bone("finger1-2.R")) < 1e-6);
    CHECK(length(at("left_index3") - sample.bone("finger2-3.L")) < 1e-6);
    vec3<double> toes(0);
    for (int k = 1; k <= 5; ++k) toes += sample.bone("toe" + std::to_string(k) + "-1.L") / 5.0;
    CHECK(length(at("left_foot") - toes) < 1e-6);

    const auto owner = [&](const std::string& bone) {
        const auto& weights = data.skeleton.weights[static_cast<std::size_t>(sample.cube(bone))];
        REQUIRE(weights.size() == 1);
        CHECK(weights[0].weight == 1);
        return std::string(smplx_joint_names[static_cast<std::size_t>(weights[0].joint)]);
    };
    CHECK(owner("root") == "pelvis");
    CHECK(owner("pelvis.R") == "pelvis");
    CHECK(owner("spine01") == "spine3");
    CHECK(owner("upperarm02.L") == "left_shoulder");
    CHECK(owner("toe4-1.R") == "right_foot");
    CHECK(owner("special06.L") == "head");
    CHECK(owner("helper-l-eye") == "left_eye");
}

TEST_CASE("a vertex keeps its six largest weights, which sum to 1") {
    const auto data = load_changed([](test::MakeHumanSample& sample) {
        int k = 0;
        for (const char* bone : {"head", "jaw", "neck01", "spine05", "spine04", "spine03", "spine02"})
            sample.replace(weights_of_sample, std::string("\"") + bone + "\": [",
                           std::string("\"") + bone + "\": [[" + std::to_string(sample.cube("root")) + ", 0." +
                               std::to_string(++k) + "], ");
    });
    const auto& weights = data.skeleton.weights[static_cast<std::size_t>(test::MakeHumanSample().cube("root"))];
    REQUIRE(weights.size() == 6);
    double sum = 0;
    for (const JointWeight& w : weights) sum += w.weight;
    CHECK(sum == doctest::Approx(1));
    CHECK(weights[0].joint == 0); // the pelvis' own, and a spine's
}

TEST_CASE("targets are made symmetric") {
    const auto data = load_changed([](test::MakeHumanSample& sample) {
        const int left = sample.cube("wrist.L"), right = sample.cube("wrist.R"); // corner 1 mirrors corner 0
        sample.files["targets/hip/hip-scale-vert-incr.target"] =
            std::to_string(left + 1) + " 1 2 3\n" + std::to_string(right) + " -1 2 5\n";
    });
    // files in a folder follow each other by name: hip is the second after arms
    const auto& target = data.targets[data.body_measures[1].more];
    REQUIRE(target.size() == 2);
    const bool left_first = target[0].offset.x > 0;
    const vec3<double> left = target[left_first ? 0 : 1].offset, right = target[left_first ? 1 : 0].offset;
    CHECK(length(left - vec3<double>(0.1, 0.2, 0.4)) < 1e-12);
    CHECK(length(right - vec3<double>(-0.1, 0.2, 0.4)) < 1e-12);
}

TEST_CASE("data that lack a part, or hold what does not fit, are refused with the file") {
    const auto without = [](const std::string& file) {
        return [=](test::MakeHumanSample& sample) { REQUIRE(sample.files.erase(file) == 1); };
    };
    check_data_refused(without("3dobjs/base.obj"), {"sample.zip", "3dobjs/base.obj"});
    for (const std::string& file :
         {rig_of_sample, weights_of_sample, std::string("textures/mpfb_face.jpg"),
          std::string("targets/macrodetails/asian-male-old.target"),
          std::string("targets/breast/female-old-maxmuscle-minweight-maxcup-minfirmness.target"),
          std::string("targets/expression/units/african/mouth-pursing.target")})
        check_data_refused(without(file), {"sample.zip: mpfb2/" + file + " is missing"});

    check_data_refused([](auto& s) { s.replace(rig_of_sample, "\"lowerarm01.R\": ", "\"lowerarm\": "); },
                       {"rig.default.json"});
    check_data_refused([](auto& s) { s.replace(rig_of_sample, "joint-l-hand", "joint-l-foot"); },
                       {"rig.default.json", "'wrist.L': head", "joint-l-foot"});
    check_data_refused([](auto& s) { s.replace(weights_of_sample, "\"neck01\": [[", "\"neck\": [["); },
                       {"weights.default.json", "'neck'", "no such bone"});
    check_data_refused(
        [](auto& s) { s.replace(weights_of_sample, "[" + std::to_string(s.cube("jaw")) + ", 1.0]", "[0, 0.0]"); },
        {"weights.default.json", "has no weight"});
    check_data_refused([](auto& s) { s.replace("3dobjs/base.obj", "g helper-tongue", "g tongue"); },
                       {"base.obj", "'helper-tongue' is missing"});
    check_data_refused([](auto& s) { s.replace("3dobjs/base.obj", "v 4", "v 5"); }, {"base.obj", "mirror image"});
    check_data_refused([](auto& s) { s.files["textures/mpfb_face.jpg"] = "no picture"; },
                       {"mpfb_face.jpg", "not a PNG or JPEG"});
    check_data_refused([](auto& s) { s.files["targets/hip/hip-scale-vert-incr.target"] = "1 2 3\n"; },
                       {"hip-scale-vert-incr.target:1", "3 numbers"});
    check_data_refused(
        [](auto& s) {
            for (int k = 0; k < 1000; ++k)
                for (const char* end : {"-incr", "-decr"})
                    s.files["targets/hip/hip-" + std::to_string(k) + end + ".target"] = "";
        },
        {"sample.zip", "targets", "1 GiB"});
}

TEST_CASE("bones without a length make no T-pose") {
    const auto data = load_changed([](test::MakeHumanSample& sample) {
        // the elbow's head is the shoulder's
        std::string& rig = sample.files.at(rig_of_sample);
        const auto head_of = [&](const std::string& bone) {
            const std::size_t begin = rig.find("{\"strategy\"", rig.find("\"" + bone + "\": "));
            return rig.substr(begin, rig.find('}', begin) - begin + 1);
        };
        const std::string shoulder = head_of("upperarm01.L"), elbow = head_of("lowerarm01.L");
        sample.replace(rig_of_sample, elbow, shoulder);
    });
    test::check_throws<ValueError>([&] { (void)t_pose_rotations(data.skeleton, data.mesh.vertices); },
                                   {"from shoulder to elbow", "no length"});
}

TEST_CASE("damaged archives of MakeHuman's data are read or refused with a short message") {
    const test::Temporary folder;
    test::MakeHumanSample().write_zip(folder / "sample.zip", "");
    for (std::size_t part = 1; part < 8; ++part) {
        std::filesystem::copy_file(folder / "sample.zip", folder / "cut.zip",
                                   std::filesystem::copy_options::overwrite_existing);
        test::truncate_file(folder / "cut.zip", std::filesystem::file_size(folder / "cut.zip") * part / 8);
        try {
            (void)load_makehuman(folder / "cut.zip");
            FAIL_CHECK("a truncated archive was read");
        } catch (const Error& error) {
            test::check_message(error.what(), folder / "cut.zip", "cut");
        }
    }
}
