// SPDX-License-Identifier: Apache-2.0
/// @file  Motions of bodies that are turned to y up are warned about, and so are those that are left.
#include <gsh/io/motion/up_warning.hpp>

#include "support/retarget_check.hpp"
#include "support/skeleton_body.hpp"
#include "support/walking_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>

#include <string>
#include <vector>

using namespace gsh;

namespace {

Motion walk() {
    return retarget(test::rig_motion_of(test::walking_rig()), test::skeleton_body());
}

void move(Motion& motion, const mat3<double>& R) {
    for (std::size_t t = 0; t < motion.frame_count(); ++t)
        move_frame(test::skeleton_body(), motion, t, {R, vec3<double>(0)});
}
std::string turned(Motion& motion, MotionFileOptions::World world = MotionFileOptions::World::upright) {
    std::vector<std::string> warnings;
    MotionFileOptions options;
    options.world = world;
    detail::turn_upright(test::skeleton_body(), motion, options, "a.npz", &warnings);
    REQUIRE(warnings.size() <= 1);
    return warnings.empty() ? "" : warnings[0];
}
double largest_way(const Motion& a, const Motion& b) {
    double most = 0;
    for (std::size_t t = 0; t < a.frame_count(); ++t) {
        const auto x = test::pose_of(test::skeleton_body(), a, t), y = test::pose_of(test::skeleton_body(), b, t);
        for (std::size_t j = 0; j < x.joints.size(); ++j) most = std::max(most, length(x.joints[j] - y.joints[j]));
    }
    return most;
}

} // namespace

TEST_CASE("each axis that was up is named, y needs no word") {
    for (int index = 0; index < 3; ++index)
        for (const int sign : {1, -1}) {
            Motion motion = walk();
            const SignedAxis axis{index, sign};
            move(motion, transpose(turn_to_y(axis)));
            const Motion stored = motion;
            CHECK(turned(motion, MotionFileOptions::World::as_stored).empty());
            CHECK(motion.pose == stored.pose);
            CHECK(turned(motion) ==
                  (axis == SignedAxis{} ? "" : "a.npz: " + axis.name() + " is up, so the world is turned to y up"));
            CHECK(largest_way(motion, walk()) < 1e-9);
        }
}

TEST_CASE("a motion without an axis is turned where it touches a ground, and else left, with a warning") {
    // A wheel about the axis to the front, on the ground.
    Motion wheel = walk();
    for (std::size_t t = 0; t < wheel.frame_count(); ++t) {
        move_frame(test::skeleton_body(), wheel, t,
                   {test::turn_about(2, 0.314 * static_cast<double>(t)), vec3<double>(0)});
        double lowest = 1e9;
        for (const auto& x : test::pose_of(test::skeleton_body(), wheel, t).joints) lowest = std::min(lowest, x.y);
        wheel.transl[t].y += 0.02 - lowest;
        wheel.transl[t].z = -1.2; // behind z = 0
    }
    Motion other = wheel;
    CHECK(turned(other) ==
          "a.npz: y is taken as up; that is uncertain: the body stands along no axis, so the world is left as it is");
    CHECK(other.pose == wheel.pose);
    Motion z_up = wheel;
    move(z_up, test::turn_about(0, 1.5707963267948966));
    CHECK(turned(z_up) == "a.npz: z is up, so the world is turned to y up");
    CHECK(largest_way(z_up, wheel) < 1e-9);
}
