// SPDX-License-Identifier: Apache-2.0
/// @file  SAM 3D Body: predictions in the camera's axes, with the rig's rest pose.

#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/sam3d_motion.hpp>

#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

struct Arrays {
    std::vector<std::string> names;
    std::vector<std::int64_t> parents;
    std::map<std::string, std::pair<std::vector<double>, Shape>> numbers;

    void save(const std::filesystem::path& path) const {
        NpzWriter file(path);
        if (!names.empty()) file.add_texts("names", names);
        file.add("parents", parents);
        for (const auto& [key, array] : numbers) file.add(key, array.first, array.second);
        file.commit();
    }
};

/// The sample as SAM 3D Body stores it: positions with y and z negated, relative to pred_cam_t; rotations with y up.
Arrays arrays_of(const test::SampleRig& sample, bool camera_axes = true) {
    const std::size_t J = sample.names.size(), T = sample.root.size();
    Arrays arrays{sample.names, std::vector<std::int64_t>(sample.parents.begin(), sample.parents.end()), {}};
    test::Rng rng(8);
    std::vector<double> joints, rotations, camera, rest, axes;
    const auto three = [](std::vector<double>& to, const vec3<double>& v) { to.insert(to.end(), {v.x, v.y, v.z}); };
    const auto rows = [](std::vector<double>& to, const mat3<double>& m) {
        for (int r = 0; r < 3; ++r) to.insert(to.end(), {m[0][r], m[1][r], m[2][r]});
    };
    std::vector<mat3<double>> own;
    for (std::size_t j = 0; j < J; ++j) {
        own.push_back(rotation_from_axis_angle(rng.vec(-2, 2)));
        three(rest, sample.rest[j] * 1.3); // another size than in the frames
        rows(axes, own[j]);
    }
    const double sign = camera_axes ? -1 : 1;
    for (std::size_t t = 0; t < T; ++t) {
        const auto pose = test::pose_of(sample, t, "ZXY");
        for (std::size_t j = 0; j < J; ++j) {
            const vec3<double> x = pose.joints[j] - sample.root[t];
            three(joints, {x.x, sign * x.y, sign * x.z});
            rows(rotations, pose.rotations[j] * own[j]);
        }
        three(camera, {sample.root[t].x, -sample.root[t].y, -sample.root[t].z});
    }
    arrays.numbers = {{"rest_joints", {rest, {J, 3}}},
                      {"rest_rotations", {axes, {J, 3, 3}}},
                      {"pred_joint_coords", {joints, {T, J, 3}}},
                      {"pred_global_rots", {rotations, {T, J, 3, 3}}},
                      {"pred_cam_t", {camera, {T, 3}}},
                      {"fps", {{25}, {}}}};
    return arrays;
}

} // namespace

TEST_CASE("the body follows the predictions, in the camera's axes or upright") {
    const test::Temporary folder;
    const test::SampleOptions o{.names = test::Names::mhr, .rest = test::Rest::A, .spine = 4, .fingers = true};
    const auto sample = test::sample_rig(o);
    for (const bool camera_axes : {true, false}) {
        arrays_of(sample, camera_axes).save(folder / "a.npz");
        CHECK(recognise_motion(folder / "a.npz") == MotionLayout::sam3d);
        MotionFileOptions options;
        options.world = MotionFileOptions::World::upright;
        const Motion motion = load_any_motion(folder / "a.npz", test::skeleton_body(), options);
        const auto errors =
            test::compare(sample, "ZXY", o, motion, test::skeleton_body(), joint_names_of(test::skeleton_body()));
        CHECK(errors.limbs < 1e-4);
        CHECK(errors.trunk < 1e-4);
        CHECK(errors.hips < 1e-6);
        CHECK(errors.left > 0.99);
        CHECK(motion.timestamps[1] == doctest::Approx(0.04));
        // As stored: the axes of the camera, y down
        const Motion stored = load_any_motion(folder / "a.npz", test::skeleton_body());
        const auto upright = test::pose_of(test::skeleton_body(), motion, 2),
                   camera = test::pose_of(test::skeleton_body(), stored, 2);
        for (std::size_t j = 0; j < 55; ++j) {
            const vec3<double> x = upright.joints[j];
            CHECK(length(camera.joints[j] - vec3<double>(x.x, -x.y, -x.z)) < 1e-9);
        }
    }
}

TEST_CASE("refined hands with the rotations from before: fingers point where the positions are, with a warning") {
    const test::Temporary folder;
    const test::SampleOptions o{.names = test::Names::mhr, .spine = 4, .fingers = true};
    auto sample = test::sample_rig(o), before = sample;
    for (std::size_t t = 0; t < sample.angles.size(); ++t)
        for (std::size_t j = 0; j < sample.parts.size(); ++j) {
            const bool finger = sample.parts[j].find('_') != std::string::npos &&
                                (sample.parts[j].back() >= '1' && sample.parts[j].back() <= '3');
            if (finger) before.angles[t][j] = vec3<double>(0); // straight
            if (sample.parts[j].ends_with("wrist")) before.angles[t][j] += vec3<double>(0.3, -0.2, 0.25);
        }
    Arrays arrays = arrays_of(sample);
    arrays.numbers["pred_global_rots"] = arrays_of(before).numbers["pred_global_rots"];
    arrays.save(folder / "stale.npz");
    MotionFileOptions options;
    options.world = MotionFileOptions::World::upright;
    std::vector<std::string> warnings;
    const Motion motion = load_any_motion(folder / "stale.npz", test::skeleton_body(), options, &warnings);
    const auto errors =
        test::compare(sample, "ZXY", o, motion, test::skeleton_body(), joint_names_of(test::skeleton_body()));
    CHECK(errors.limbs < 1e-4); // with hands and fingers
    REQUIRE(!warnings.empty());
    CHECK(warnings[0] == test::contains("fingers point"));
    CHECK(warnings[0] == test::contains("the positions of pred_joint_coords are taken"));

    warnings.clear();
    arrays_of(sample).save(folder / "agreeing.npz");
    (void)load_sam3d_motion(folder / "agreeing.npz", {}, &warnings);
    for (const auto& warning : warnings) FAIL_CHECK(warning);
}

TEST_CASE("missing arrays, other shapes and rest poses of another rig are refused") {
    const test::Temporary folder;
    const auto sample = test::sample_rig({.names = test::Names::mhr, .spine = 4});
    const auto refuse = [&](const std::function<void(Arrays&)>& damage, std::initializer_list<std::string_view> words) {
        Arrays arrays = arrays_of(sample);
        damage(arrays);
        arrays.save(folder / "bad.npz");
        test::check_throws<Error>([&] { (void)load_sam3d_motion(folder / "bad.npz"); }, {"bad.npz"});
        test::check_throws<Error>([&] { (void)load_sam3d_motion(folder / "bad.npz"); }, words);
    };
    for (const std::string key : {"rest_joints", "rest_rotations", "pred_joint_coords", "pred_global_rots"}) {
        refuse([&](Arrays& a) { a.numbers.erase(key); }, {key, "is missing"});
        if (key != "pred_global_rots")
            refuse([&](Arrays& a) { a.numbers[key] = {std::vector<double>(6), {2, 3}}; }, {key, "shape"});
    }
    refuse([](Arrays& a) { a.names.clear(); }, {"names is missing"});
    refuse([](Arrays& a) { a.names.pop_back(); }, {"names"});
    refuse([](Arrays& a) { a.parents.pop_back(); }, {"parents"});
    refuse([](Arrays& a) { a.parents[1] = 3; }, {"a joint before it"});
    refuse([](Arrays& a) { a.numbers["fps"].first[0] = 0; }, {"fps", "above 0"});
    refuse([](Arrays& a) { a.numbers["pred_global_rots"].first[0] = 7; }, {"rotations", "not a rotation"});
    refuse([](Arrays& a) { a.numbers["pred_global_rots"] = {{}, {0, 0, 3, 3}}; }, {"no frames"});
    refuse([](Arrays& a) { a.numbers["pred_global_rots"] = {std::vector<double>(5000 * 9), {1, 5000, 3, 3}}; },
           {"5000 joints"});
    refuse(
        [](Arrays& a) { // positions that are not of these rotations
            test::Rng rng(4);
            for (double& x : a.numbers["pred_joint_coords"].first) x = rng.uniform(-1, 1);
        },
        {"degrees away", "rest_rotations"});
    Arrays without = arrays_of(sample);
    without.numbers.erase("fps"), without.numbers.erase("pred_cam_t");
    without.save(folder / "a.npz");
    std::vector<std::string> warnings;
    CHECK(load_sam3d_motion(folder / "a.npz", {}, &warnings).timestamps[1] == doctest::Approx(1 / 30.0));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("states no frame rate, 30"));
}
