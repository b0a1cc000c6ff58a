// SPDX-License-Identifier: Apache-2.0
/// @file  Motions written as BVH come back as they were.

#include "io/comma_locale.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"
#include "support/sample_rig.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/bvh_file.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <algorithm>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Random turns of all joints, up to half a turn.
Motion wild_motion(std::size_t frames) {
    test::Rng rng(11);
    Motion motion;
    motion.joint_count = 55, motion.betas = {0.4};
    motion.pose = rng.vecs(55 * frames, -1.8, 1.8);
    motion.pose[5] = {1.5707963267948966, 0, 0}; // where two of the three axes coincide
    for (std::size_t t = 0; t < frames; ++t) {
        motion.transl.push_back(rng.vec(-2, 2));
        motion.timestamps.push_back(static_cast<double>(t) / 24);
    }
    return motion;
}

} // namespace

TEST_CASE("a body's motion comes back within 1e-4 rad") {
    const test::Temporary folder;
    const Motion motion = wild_motion(6);
    std::vector<std::string> warnings;
    save_bvh(folder / "a.bvh", rig_of_motion(test::skeleton_body(), motion), &warnings);
    CHECK(warnings.empty());
    CHECK(folder.file_count() == 1);
    const RigMotion rig = load_bvh(folder / "a.bvh");
    const Motion back = retarget(rig, test::skeleton_body(), {}, {motion.betas, "a", nullptr});
    double angle = 0, place = 0;
    for (std::size_t i = 0; i < motion.pose.size(); ++i)
        angle = std::max(angle, length(axis_angle_from_rotation(transpose(rotation_from_axis_angle(motion.pose[i])) *
                                                                rotation_from_axis_angle(back.pose[i]))));
    for (std::size_t t = 0; t < 6; ++t) {
        place = std::max(place, length(motion.transl[t] - back.transl[t]));
        CHECK(back.timestamps[t] == doctest::Approx(motion.timestamps[t]));
    }
    CHECK(angle < 1e-6);
    CHECK(place < 1e-6);
    const std::string text = read_file(folder / "a.bvh");
    CHECK(text.starts_with("HIERARCHY\nROOT pelvis\n{\n\tOFFSET 0.0000000 0.0000000 0.0000000\n"));
    CHECK(text != test::contains("-nan"));
}

TEST_CASE("nothing is guessed about files that gsh wrote") {
    const test::Temporary folder;
    std::vector<std::string> warnings;
    // Lying, and also as small as a doll, whose legs of 8 cm would else be in units of CMU.
    for (const double size : {1.0, 0.1}) {
        RigMotion rig = rig_of_motion(test::skeleton_body(), wild_motion(4));
        move_rig(rig, mat3<double>(1), size);
        save_bvh(folder / "a.bvh", rig);
        const RigMotion back = load_bvh(folder / "a.bvh", {}, &warnings);
        const auto hip = std::find(back.names.begin(), back.names.end(), "left_hip") - back.names.begin();
        CHECK(length(back.rest_joints[static_cast<std::size_t>(hip)] - back.rest_joints[0]) ==
              doctest::Approx(length(rig.rest_joints[1] - rig.rest_joints[0])));
        CHECK(length(back.joints[0] - rig.joints[0]) < 1e-6);
    }
    // On the belly in every frame, the hips a metre from the origin: z seems to be up, and nothing contradicts it.
    Motion lying = wild_motion(2);
    for (std::size_t t = 0; t < 2; ++t) {
        for (std::size_t j = 0; j < 55; ++j) lying.pose[55 * t + j] = {j == 0 ? 1.5707963267948966 : 0, 0, 0};
        lying.transl[t] = {0, 0, 1};
    }
    const RigMotion rig = rig_of_motion(test::skeleton_body(), lying);
    save_bvh(folder / "c.bvh", rig);
    CHECK(length(load_bvh(folder / "c.bvh", {}, &warnings).joints[0] - rig.joints[0]) < 1e-6);
    CHECK(warnings.empty());
    const std::string text = read_file(folder / "a.bvh");
    CHECK(is_saved_bvh(text));
    std::string other = text; // as another program would write the same
    other.replace(other.find("0.0000000"), 9, "0.000000");
    CHECK(!is_saved_bvh(other));
    write_file(folder / "b.bvh", other);
    (void)load_bvh(folder / "b.bvh", {}, &warnings);
    CHECK(!warnings.empty());
    for (const char* part : {"", "HIERARCHY", "HIERARCHY\nROOT a", "HIERARCHY\nROOT a\n{\n"})
        CHECK(!is_saved_bvh(part));
}

TEST_CASE("a file is the same in every locale, and holds large numbers") {
    const test::Temporary folder;
    RigMotion rig = rig_of_motion(test::skeleton_body(), wild_motion(3));
    for (auto& time : rig.timestamps) time *= 0.7;
    save_bvh(folder / "a.bvh", rig);
    {
        const test::CommaLocale comma; // in which 1.5 is written 1,5
        save_bvh(folder / "b.bvh", rig);
    }
    CHECK(read_file(folder / "a.bvh") == read_file(folder / "b.bvh"));
    CHECK(read_file(folder / "a.bvh") == test::contains("Frame Time: 0.0291666667\n"));
    rig.joints[0].x = 1e29;
    save_bvh(folder / "c.bvh", rig);
    const std::string text = read_file(folder / "c.bvh"), motion = text.substr(text.find("Frame Time"));
    CHECK(std::stod(motion.substr(motion.find('\n'))) == doctest::Approx(1e31));
}

TEST_CASE("names that a line of BVH cannot hold are changed, and stay different") {
    const test::Temporary folder;
    RigMotion rig = rig_of_motion(test::skeleton_body(), wild_motion(2));
    const std::vector<std::string> given{"a\nb", "a_b", " ear", "tail {", "mane\t", "", "_", "two words:x", "}"},
        expected{"a_b_", "a_b", "_ear", "tail _", "mane_", "__", "_", "two words:x", "}"};
    std::copy(given.begin(), given.end(), rig.names.begin());
    save_bvh(folder / "a.bvh", rig);
    std::vector<std::string> found = load_bvh(folder / "a.bvh").names;
    std::erase_if(found, [](const std::string& name) { return name.ends_with("_end"); });
    REQUIRE(found.size() == rig.names.size());
    for (const std::string& name : expected) {
        INFO(name);
        CHECK(std::count(found.begin(), found.end(), name) == 1);
    }
}

TEST_CASE("angles give back every rotation, and continue those of the frame before") {
    test::Rng rng(2);
    const auto check = [&](const mat3<double>& R, const vec3<double>& before) {
        const vec3<double> a = zxy_angles(R, before);
        const mat3<double> D = test::turn_about(2, a.x) * test::turn_about(0, a.y) * test::turn_about(1, a.z) - R;
        for (int c = 0; c < 3; ++c) CHECK(length(D[c]) < 1e-9);
        return a;
    };
    for (int n = 0; n < 200; ++n) {
        const vec3<double> angles = rng.vec(-9, 9);
        const auto R = test::turn_about(2, angles.x) * test::turn_about(0, angles.y) * test::turn_about(1, angles.z);
        (void)check(R, vec3<double>(0));
        CHECK(length(check(R, angles + rng.vec(-0.1, 0.1)) - angles) < 1e-6);
    }
    for (const double b : {1.5707963267948966, -1.5707963267948966, 1.5707963})
        (void)check(test::turn_about(2, 0.3) * test::turn_about(0, b) * test::turn_about(1, 0.9), vec3<double>(0));
}

TEST_CASE("what BVH cannot hold is warned of or refused; nothing is half-written") {
    const test::Temporary folder;
    Motion motion = wild_motion(3);
    motion.timestamps = {0, 0.1, 0.5};
    std::vector<std::string> warnings;
    save_bvh(folder / "a.bvh", rig_of_motion(test::skeleton_body(), motion), &warnings);
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == test::contains("times between frames differ"));
    CHECK(load_bvh(folder / "a.bvh").timestamps[1] == doctest::Approx(0.25));
    RigMotion two = rig_of_motion(test::skeleton_body(), motion);
    two.parents[2] = -1;
    test::check_throws<ValueError>([&] { save_bvh(folder / "b.bvh", two); }, {"right_hip", "second root"});
    test::check_throws<IoError>([&] { save_bvh(folder / "none/b.bvh", rig_of_motion(test::skeleton_body(), motion)); },
                                {"none/b.bvh"});
    CHECK(folder.file_count() == 1);
}
