// SPDX-License-Identifier: Apache-2.0
/// @file  Axes bend the body as anatomy does, and both sides alike.
#include <gsh/fit/pose_axes.hpp>

#include "fit/filmed_person.hpp"

#include <gsh/fit/frame_kinematics.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;

namespace {

struct Axes {
    const BodyModel& model = test::fitted_actor();
    FittedBody body{model, 0};

    /// The joint `seen` after `joint` alone is turned by its k-th axis.
    [[nodiscard]] vec3<double> turned(const char* joint, std::size_t k, double angle, const char* seen) const {
        FrameNumbers frame{.angles = std::vector<double>(body.axes.size(), 0.0)};
        std::size_t found = 0;
        for (std::size_t a = 0; a < body.axes.size(); ++a)
            if (body.axes[a].joint == smplx_joint(joint) && found++ == k) frame.angles[a] = angle;
        REQUIRE(found > k);
        return FrameKinematics(body, frame, {}).joint(static_cast<std::size_t>(smplx_joint(seen)));
    }
    [[nodiscard]] vec3<double> moved(const char* joint, std::size_t k, double angle, const char* seen) const {
        return turned(joint, k, angle, seen) - turned(joint, k, 0, seen);
    }
};

} // namespace

TEST_CASE_FIXTURE(Axes, "there are 63 numbers of trunk and limbs, then 20 of each hand") {
    CHECK(body.axes.size() == 103);
    CHECK(body.limb_axes == 63);
    for (std::size_t a = 0; a < body.axes.size(); ++a) {
        const PoseAxis& axis = body.axes[a];
        CHECK(axis.finger == (a >= 63));
        CHECK(length(axis.axis) == doctest::Approx(1));
        CHECK((axis.low < axis.mean && axis.mean < axis.high && axis.spread > 0));
    }
    CHECK(body.follows_finger(smplx_joint("left_index2")));
    CHECK(!body.follows_finger(smplx_joint("left_index1"))); // the knuckle moves with the wrist
    CHECK(!body.follows_finger(smplx_joint("left_wrist")));
}

TEST_CASE_FIXTURE(Axes, "knees bend back, hips lift the thigh to the front, elbows bring the hands to the front") {
    for (const std::string side : {"left_", "right_"}) {
        CHECK(moved((side + "knee").c_str(), 0, 0.5, (side + "ankle").c_str()).z < -0.1);
        CHECK(moved((side + "hip").c_str(), 0, -0.5, (side + "knee").c_str()).z > 0.1);
        const double bend = side == "left_" ? -0.5 : 0.5;
        CHECK(moved((side + "elbow").c_str(), 1, bend, (side + "wrist").c_str()).z > 0.05);
        CHECK(moved((side + "shoulder").c_str(), 2, bend, (side + "wrist").c_str()).y < -0.1); // arms hang
    }
}

TEST_CASE_FIXTURE(Axes, "flexed fingers go to the palm, which faces down, and limits allow it") {
    for (const std::string side : {"left_", "right_"})
        for (const char* finger : {"index", "middle", "ring", "pinky"}) {
            const std::string first = side + finger + "1", last = side + finger + "3";
            CHECK(moved(first.c_str(), 0, 0.5, last.c_str()).y < -0.01);
        }
}

TEST_CASE_FIXTURE(Axes, "the right side mirrors the left: ranges and motions") {
    for (std::size_t a = 0; a < 63; ++a) {
        const PoseAxis& left = body.axes[a];
        const int partner = mirrored_smplx_joint(left.joint);
        if (partner == left.joint) continue;
        for (const PoseAxis& right : body.axes) {
            if (right.joint != partner || right.axis != left.axis) continue;
            const double sign = left.axis.x == 1 ? 1 : -1;
            CHECK(right.mean == sign * left.mean);
            CHECK(right.low == (sign > 0 ? left.low : -left.high));
        }
    }
    for (const char* finger : {"index1", "thumb1", "thumb2"}) {
        const std::string left = std::string("left_") + finger, right = std::string("right_") + finger;
        const std::string tip = std::string(finger).substr(0, 5) + "3";
        const vec3<double> a = moved(left.c_str(), 0, 0.4, ("left_" + tip).c_str()),
                           b = moved(right.c_str(), 0, 0.4, ("right_" + tip).c_str());
        CHECK(length(a - vec3<double>(-b.x, b.y, b.z)) < 0.004);
    }
}

TEST_CASE("a body without limbs' names is refused, one without fingers has none") {
    BodyModel nameless = test::fitted_actor();
    nameless.parents.resize(7), nameless.J_regressor.resize(7);
    nameless.joint_names = {"a", "b", "c", "d", "e", "f", "g"};
    CHECK_THROWS_WITH_AS((void)pose_axes(nameless, std::vector<vec3<double>>(7)),
                         "pose_axes: the body has no joint 'left_hip', expected the joints of SMPL-X by name",
                         ValueError);
    BodyModel smpl = test::fitted_actor();
    smpl.parents.resize(24);
    CHECK(pose_axes(smpl, std::vector<vec3<double>>(24)).size() == 63);
}
