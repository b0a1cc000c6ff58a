// SPDX-License-Identifier: Apache-2.0
/// @file  Animals on four legs are told from people who crawl, bend, or have long arms.
#include <gsh/body/four_legs.hpp>

#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <gsh/body/joint_map.hpp>
#include <gsh/body/retarget.hpp>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Lengths in metres, and directions in the plane x = 0, in degrees from +z (forward) to +y (up).
struct Figure {
    double trunk = 0.5, arm = 0.5, leg = 0.8;
    double trunk_at = 90, arm_at = -90, leg_at = -90;
};

vec3<double> at(double degrees, double length) {
    return vec3<double>(0, std::sin(degrees * 0.0174532925), std::cos(degrees * 0.0174532925)) * length;
}

std::vector<vec3<double>> places(const Figure& f) {
    std::vector<vec3<double>> joints = {{0, 1, 0}, vec3<double>(0, 1, 0) + at(f.trunk_at, f.trunk)}; // pelvis, spine
    for (const double x : {0.1, -0.1}) {
        const vec3<double> hip(x, 1, 0), shoulder = joints[1] + vec3<double>(2 * x, 0, 0);
        for (const double share : {0.0, 0.5, 1.0}) joints.push_back(hip + at(f.leg_at, share * f.leg));
        for (const double share : {0.0, 0.5, 1.0}) joints.push_back(shoulder + at(f.arm_at, share * f.arm));
    }
    joints.push_back({0, 1, -0.2}); // the tail
    return joints;
}

RigMotion rig_of(const Figure& rest, const std::vector<Figure>& frames, const std::string& last = "Tail1") {
    RigMotion rig;
    rig.names = {"Hips", "Spine"}, rig.parents = {-1, 0};
    for (const std::string side : {"Left", "Right"})
        for (const auto& [name, parent] :
             {std::pair{"UpLeg", 0}, {"Leg", -1}, {"Foot", -1}, {"Arm", 1}, {"ForeArm", -1}, {"Hand", -1}}) {
            rig.parents.push_back(parent >= 0 ? parent : static_cast<int>(rig.names.size()) - 1);
            rig.names.push_back(side + name);
        }
    rig.names.push_back(last), rig.parents.push_back(0);
    rig.rest_joints = places(rest);
    rig.rest_rotations.assign(rig.names.size(), mat3<double>(1.0));
    for (const Figure& frame : frames) {
        for (const auto& x : places(frame)) rig.joints.push_back(x), rig.rotations.emplace_back(1.0);
        rig.timestamps.push_back(static_cast<double>(rig.timestamps.size()));
    }
    return rig;
}
bool is_animal(const RigMotion& rig) {
    return stands_on_four_legs(rig, JointMap{}.match(rig, "a rig"));
}

constexpr Figure dog{.trunk = 0.6, .arm = 0.5, .leg = 0.5, .trunk_at = 0};

} // namespace

TEST_CASE("an animal is one by its rest pose; people who crawl or bend, and long arms, are not") {
    CHECK(is_animal(rig_of(dog, {dog})));
    CHECK(is_animal(rig_of({.trunk = 1.5, .arm = 1.4, .leg = 1.3, .trunk_at = 10, .arm_at = -100}, {dog}))); // elephant
    CHECK_FALSE(is_animal(rig_of({}, {{}})));
    CHECK_FALSE(is_animal(rig_of({.trunk_at = 0}, {{}})));                       // bends, in the rest pose
    CHECK_FALSE(is_animal(rig_of({.trunk_at = 0, .leg_at = -60}, {{}})));        // crawls
    CHECK_FALSE(is_animal(rig_of({.arm = 0.9, .leg = 0.5}, {{.trunk_at = 0}}))); // long arms, upright
    CHECK_FALSE(is_animal(rig_of({.arm = 0.9, .leg = 0.5, .arm_at = 0}, {{}}))); // in a T
    CHECK_FALSE(is_animal(rig_of({.trunk_at = -90}, {{}})));                     // a heap of bones
}

TEST_CASE("an animal whose rest pose is none is one by its tail and its frames") {
    const Figure heap{.trunk = 0.6, .arm = 0.5, .leg = 0.5, .trunk_at = -90};
    const std::vector<Figure> frames(10, dog);
    CHECK(is_animal(rig_of(heap, frames)));
    CHECK_FALSE(is_animal(rig_of(heap, frames, "Prop")));
    CHECK_FALSE(is_animal(rig_of(heap, {dog, {}, {}})));
    CHECK_FALSE(is_animal(rig_of({}, std::vector<Figure>(10, {.trunk_at = 0})))); // a costume with a tail
}

TEST_CASE("an animal is refused in words; with a joint map it is warned of") {
    const RigMotion rig = rig_of(dog, {dog});
    std::vector<std::string> warnings;
    test::check_throws<ValueError>([&] { (void)retarget(rig, test::skeleton_body(), {}, {{}, "dog.glb", &warnings}); },
                                   {"dog.glb", "four legs", "animal", "joint map"});
    const JointMap map{{{"Tail1", ""}}};
    CHECK_NOTHROW((void)retarget(rig, test::skeleton_body(), map, {{}, "dog.glb", &warnings}));
    REQUIRE(!warnings.empty());
    CHECK(warnings[0] == test::contains("dog.glb: stands on four legs"));
}
