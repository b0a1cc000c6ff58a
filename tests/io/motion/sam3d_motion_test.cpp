// SPDX-License-Identifier: Apache-2.0
/// @file  SAM 3D Body: predictions in the camera's axes, with the rig's rest pose.

#include "io/sam3d_files.hpp"
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

TEST_CASE("the body follows the predictions, in the camera's axes or upright") {
    const test::Temporary folder;
    const test::SampleOptions o{.names = test::Names::mhr, .rest = test::Rest::A, .spine = 4, .fingers = true};
    const auto sample = test::sample_rig(o);
    for (const bool camera_axes : {true, false}) {
        test::sam3d_arrays(sample, camera_axes).save(folder / "a.npz");
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
    test::Sam3dArrays arrays = test::sam3d_arrays(sample);
    arrays.numbers["pred_global_rots"] = test::sam3d_arrays(before).numbers["pred_global_rots"];
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
    test::sam3d_arrays(sample).save(folder / "agreeing.npz");
    (void)load_sam3d_motion(folder / "agreeing.npz", {}, &warnings);
    for (const auto& warning : warnings) FAIL_CHECK(warning);
}

TEST_CASE("missing arrays, other shapes and rest poses of another rig are refused") {
    const test::Temporary folder;
    const auto sample = test::sample_rig({.names = test::Names::mhr, .spine = 4});
    const auto refuse = [&](const std::function<void(test::Sam3dArrays&)>& damage,
                            std::initializer_list<std::string_view> words) {
        test::Sam3dArrays arrays = test::sam3d_arrays(sample);
        damage(arrays);
        arrays.save(folder / "bad.npz");
        test::check_throws<Error>([&] { (void)load_sam3d_motion(folder / "bad.npz"); }, {"bad.npz"});
        test::check_throws<Error>([&] { (void)load_sam3d_motion(folder / "bad.npz"); }, words);
    };
    for (const std::string key : {"rest_joints", "rest_rotations", "pred_joint_coords", "pred_global_rots"}) {
        refuse([&](test::Sam3dArrays& a) { a.numbers.erase(key); }, {key, "is missing"});
        if (key != "pred_global_rots")
            refuse([&](test::Sam3dArrays& a) { a.numbers[key] = {std::vector<double>(6), {2, 3}}; }, {key, "shape"});
    }
    refuse([](test::Sam3dArrays& a) { a.names.clear(); }, {"names is missing"});
    refuse([](test::Sam3dArrays& a) { a.names.pop_back(); }, {"names"});
    refuse([](test::Sam3dArrays& a) { a.parents.pop_back(); }, {"parents"});
    refuse([](test::Sam3dArrays& a) { a.parents[1] = 3; }, {"a joint before it"});
    refuse([](test::Sam3dArrays& a) { a.numbers["fps"].first[0] = 0; }, {"fps", "above 0"});
    refuse([](test::Sam3dArrays& a) { a.numbers["pred_global_rots"].first[0] = 7; }, {"rotations", "not a rotation"});
    refuse([](test::Sam3dArrays& a) { a.numbers["pred_global_rots"] = {{}, {0, 0, 3, 3}}; }, {"no frames"});
    refuse(
        [](test::Sam3dArrays& a) {
            a.numbers["pred_global_rots"] = {std::vector<double>(5000 * 9), {1, 5000, 3, 3}};
        },
        {"5000 joints"});
    refuse(
        [](test::Sam3dArrays& a) { // positions that are not of these rotations
            test::Rng rng(4);
            for (double& x : a.numbers["pred_joint_coords"].first) x = rng.uniform(-1, 1);
        },
        {"degrees away", "rest_rotations"});
    refuse([](test::Sam3dArrays& a) { a.names[3] = std::string(300, 'n'); },
           {"names", "300 bytes, expected at most 256"});
    test::Sam3dArrays without = test::sam3d_arrays(sample);
    without.numbers.erase("fps"), without.numbers.erase("pred_cam_t");
    without.save(folder / "a.npz");
    std::vector<std::string> warnings;
    CHECK(load_sam3d_motion(folder / "a.npz", {}, &warnings).timestamps[1] == doctest::Approx(1 / 30.0));
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("states no frame rate, 30"));
}
