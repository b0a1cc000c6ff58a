// SPDX-License-Identifier: Apache-2.0
/// @file  Measures of a rig's pose: turns, axes, heights and units.
#include <gsh/body/rest_pose.hpp>

#include "io/temporary.hpp"
#include "support/sample_rig.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// The sample rig at rest, with names of SMPL-X. It faces +z, and its frames are as its rest pose.
struct RestingRig {
    RigMotion rig;
    MatchedJoints matched{};

    explicit RestingRig(std::size_t frames = 2) {
        const test::SampleRig sample = test::sample_rig({.names = test::Names::smplx});
        rig.names = sample.names, rig.parents = sample.parents, rig.rest_joints = sample.rest;
        rig.rest_rotations.assign(rig.names.size(), mat3<double>(1.0));
        for (std::size_t t = 0; t < frames; ++t) {
            rig.joints.insert(rig.joints.end(), sample.rest.begin(), sample.rest.end());
            rig.timestamps.push_back(static_cast<double>(t));
        }
        rig.rotations.assign(rig.joints.size(), mat3<double>(1.0));
        matched = JointMap{}.match(rig, "the sample");
    }
    [[nodiscard]] int& match(std::string_view joint) { return matched[static_cast<std::size_t>(smplx_joint(joint))]; }
    [[nodiscard]] vec3<double>& rest(std::string_view joint) {
        return rig.rest_joints[static_cast<std::size_t>(match(joint))];
    }
    [[nodiscard]] double rest_length(std::string_view a, std::string_view b) { return length(rest(a) - rest(b)); }
    [[nodiscard]] double leg() { return rest_length("left_hip", "left_knee") + rest_length("left_knee", "left_ankle"); }
    void scale_rest(double factor) {
        for (auto& x : rig.rest_joints) x *= factor;
    }
};

/// The shoulders exactly above the hips. In the sample they are a centimetre behind.
void stand_upright(RestingRig& r) {
    for (const char* joint : {"left_shoulder", "right_shoulder"}) r.rest(joint).z = r.rest("left_hip").z;
}

/// Within rounding, and a rotation.
void check_axes(const mat3<double>& found, const mat3<double>& expected) {
    for (int c = 0; c < 3; ++c) CHECK(length(found[c] - expected[c]) < 1e-12);
    CHECK(is_rotation(found, 1e-12));
}

} // namespace

TEST_CASE("the shortest turn leads from one direction to the other and has no twist") {
    test::Rng rng(3);
    for (int n = 0; n < 50; ++n) {
        const vec3<double> a = normalize(rng.vec()), b = normalize(rng.vec());
        const mat3<double> R = shortest_turn(a, b);
        CHECK(length(R * a - b) < 1e-12);
        CHECK(length(R * cross(a, b) - cross(a, b)) < 1e-12);
        CHECK(shortest_turn(a, a) == mat3<double>(1.0));
    }
}

TEST_CASE("opposite directions are half a turn apart, also along an axis") {
    test::Rng rng(4);
    std::vector<vec3<double>> directions{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, -1, 0}};
    for (int n = 0; n < 20; ++n) directions.push_back(normalize(rng.vec()));
    for (const vec3<double>& a : directions) {
        const mat3<double> R = shortest_turn(a, a * -1.0);
        CHECK(length(R * a + a) < 1e-12);
        CHECK(is_rotation(R, 1e-12));
        CHECK(R[0][0] + R[1][1] + R[2][2] == doctest::Approx(-1));         // 1 + 2 cos(angle)
        const vec3<double> b = normalize(a * -1.0 + rng.vec(-1e-6, 1e-6)); // the axis has ten digits
        CHECK(length(shortest_turn(a, b) * a - b) < 1e-8);
    }
}

TEST_CASE("a rig's axes are left, up and forward") {
    RestingRig r;
    CHECK(facing(r.rig, r.matched, "a") == mat3<double>(1.0));
    for (const double angle : {0.5 * std::numbers::pi, std::numbers::pi, 0.8, -2.2}) {
        CAPTURE(angle);
        RestingRig turned;
        const mat3<double> R = test::turn_about(1, angle), up = test::turn_about(0, 0.5 * std::numbers::pi);
        move_rig(turned.rig, R);
        check_axes(facing(turned.rig, turned.matched, "a"), R);
        move_rig(turned.rig, up);
        check_axes(facing(turned.rig, turned.matched, "a"), up * R);
    }
}

TEST_CASE("axes within 25 degrees of a coordinate axis are rounded to it") {
    constexpr double degree = std::numbers::pi / 180;
    const auto leaning = [](int axis, double degrees) {
        RestingRig r;
        const mat3<double> R = test::turn_about(axis, degrees * degree);
        stand_upright(r);
        move_rig(r.rig, R);
        return std::pair(facing(r.rig, r.matched, "a"), R);
    };
    for (const int axis : {0, 1, 2})
        for (const double sign : {1.0, -1.0}) {
            CAPTURE(axis);
            check_axes(leaning(axis, sign * 24.9).first, mat3<double>(1.0));
            const auto [axes, exact] = leaning(axis, sign * 25.2);
            check_axes(axes, exact);
        }
    // A lean of 30 degrees to the front in a rig that looks 20 degrees aside: one axis is near, the others are not.
    const auto axes_after = [](const mat3<double>& R) {
        RestingRig r;
        stand_upright(r);
        move_rig(r.rig, R);
        return facing(r.rig, r.matched, "a");
    };
    const mat3<double> far = test::turn_about(1, 20 * degree) * test::turn_about(0, 30 * degree);
    check_axes(axes_after(far), far);
    // A lean of 10 degrees aside is rounded off, and the axes to the left and to the front are then level.
    const mat3<double> aside = test::turn_about(1, 45 * degree);
    check_axes(axes_after(aside * test::turn_about(2, 10 * degree)), aside);
}

TEST_CASE("hips and shoulders that span no plane have no axes") {
    const auto refuse = [](const auto& damage) {
        RestingRig r;
        damage(r);
        test::check_throws<ValueError>([&] { (void)facing(r.rig, r.matched, "walk.bvh"); },
                                       {"walk.bvh", "hips and shoulders of the rest pose do not span a plane"});
    };
    refuse([](RestingRig& r) { r.scale_rest(0); });
    refuse([](RestingRig& r) { // on one line
        for (auto& x : r.rig.rest_joints) x = {0, x.y, 0};
    });
    refuse([](RestingRig& r) { // in one place
        r.rest("left_shoulder") = r.rest("left_hip"), r.rest("right_shoulder") = r.rest("right_hip");
    });
    refuse([](RestingRig& r) { r.rest("left_hip").x = std::nan(""); });
}

TEST_CASE("the hips are as high as the legs are long, and as their joint is above those of the legs") {
    RestingRig r;
    CHECK(hip_height(r.rig, r.matched) == doctest::Approx(r.leg() + 0.03)); // 0.96 m and 0.93 m above the ground
    RigMotion flat = r.rig;
    for (auto& joint : flat.rest_joints) joint.x = 0;
    test::check_throws<ValueError>([&] { (void)hip_height(flat, r.matched, "walk.npz"); },
                                   {"walk.npz: hips and shoulders"});
    move_rig(r.rig, test::turn_about(0, 0.5 * std::numbers::pi) * test::turn_about(1, 0.8), 100);
    CHECK(hip_height(r.rig, r.matched) == doctest::Approx(100 * (RestingRig().leg() + 0.03)));

    RestingRig uneven; // the mean of both legs
    uneven.rest("left_ankle") +=
        (uneven.rest("left_ankle") - uneven.rest("left_knee")) * (0.2 / uneven.rest_length("left_knee", "left_ankle"));
    CHECK(hip_height(uneven.rig, uneven.matched) == doctest::Approx(RestingRig().leg() + 0.1 + 0.03));

    RestingRig bent; // height with stretched legs, whatever their pose
    bent.rest("left_ankle") = bent.rest("left_knee") + vec3<double>(0, 0, -bent.rest_length("left_knee", "left_ankle"));
    CHECK(hip_height(bent.rig, bent.matched) == doctest::Approx(r.leg() / 100 + 0.03));

    RestingRig footless; // a shin as long as the thigh
    footless.match("left_ankle") = footless.match("right_ankle") = -1;
    CHECK(hip_height(footless.rig, footless.matched) ==
          doctest::Approx(2 * r.rest_length("left_hip", "left_knee") / 100 + 0.03));
}

TEST_CASE("the unit follows from the length of the legs") {
    const double metre = RestingRig().leg();
    const auto unit_of = [&](double leg) { // of a rig with legs of that length
        RestingRig r;
        r.scale_rest(leg / metre);
        const LengthUnit unit = guess_length_unit(r.rig, r.matched);
        CHECK(unit.leg == doctest::Approx(leg));
        return unit;
    };
    struct Known {
        double from, to;
        std::string_view name;
        double metres;
    };
    for (const Known& known :
         {Known{0.3, 3, "metres", 1}, Known{8, 20, "units of CMU (inches / 0.45)", 0.0254 / 0.45},
          Known{20, 45, "inches", 0.0254}, Known{45, 200, "centimetres", 0.01}, Known{300, 3000, "millimetres", 0.001}})
        for (const double leg : {known.from * 1.001, std::sqrt(known.from * known.to), known.to * 0.999}) {
            CAPTURE(leg);
            CHECK(unit_of(leg).name == known.name);
            CHECK(unit_of(leg).metres == known.metres);
        }
    for (const double leg : {0.299, 5.0, 250.0, 3001.0, 1e-6}) { // the legs are then as long as a person's
        CAPTURE(leg);
        CHECK(unit_of(leg).name.empty());
        CHECK(unit_of(leg).metres * leg == doctest::Approx(0.82));
    }

    RestingRig one_leg;
    one_leg.rest("left_knee") += (one_leg.rest("left_knee") - one_leg.rest("left_hip")) * 100.0;
    one_leg.match("left_knee") = -1; // so its length does not count
    CHECK(guess_length_unit(one_leg.rig, one_leg.matched).leg == doctest::Approx(metre));
    one_leg.match("right_hip") = -1;
    CHECK(guess_length_unit(one_leg.rig, one_leg.matched).leg == 0);
    CHECK(guess_length_unit(one_leg.rig, one_leg.matched).name == "metres");
    CHECK(guess_length_unit(one_leg.rig, one_leg.matched).metres == 1);
    CHECK(guess_length_unit(RigMotion{}, JointMap{}.match(RigMotion{}, "a")).leg == 0);
}

TEST_CASE("a rest pose is scaled to the legs of the first frame") {
    const RestingRig original;
    RestingRig r;
    for (std::size_t j = r.rig.joint_count(); j < r.rig.joints.size(); ++j) r.rig.joints[j] *= 3.0; // another frame
    const auto fits = [&](double size = 1) { // compared with the original
        const bool fitted = fit_rest_to_frames(r.rig, r.matched);
        double largest = 0;
        for (std::size_t j = 0; j < r.rig.joint_count(); ++j)
            largest = std::max(largest, length(r.rig.rest_joints[j] - original.rig.rest_joints[j] * size));
        return fitted && largest < 1e-12;
    };
    r.scale_rest(7);
    CHECK(fits());

    // Rest pose and frames need not agree but in size: the frame may be anywhere and in any pose.
    const mat3<double> R = test::turn_about(0, 0.7) * test::turn_about(2, 1.2);
    for (std::size_t j = 0; j < r.rig.joint_count(); ++j) r.rig.joints[j] = R * r.rig.joints[j] + vec3<double>(1, 2, 3);
    r.scale_rest(0.01);
    CHECK(fits());

    // The lengths of both legs count together.
    auto& ankle = r.rig.joints[static_cast<std::size_t>(r.match("right_ankle"))];
    const vec3<double> shin = ankle - r.rig.joints[static_cast<std::size_t>(r.match("right_knee"))];
    const vec3<double> longer = shin * (2 * r.leg() / length(shin)); // the right leg is three times as long
    ankle += longer;
    CHECK(fits(2));
    ankle -= longer;

    // A leg without a knee does not count.
    r.rig.joints[static_cast<std::size_t>(r.match("left_ankle"))] += vec3<double>(0, 9, 0);
    r.match("left_knee") = -1;
    r.scale_rest(3);
    CHECK(fits());

    // Without a length, nothing changes.
    const auto refuses = [](auto damage, std::size_t frames = 2) {
        RestingRig other(frames);
        other.scale_rest(2);
        damage(other);
        const auto before = other.rig.rest_joints;
        return !fit_rest_to_frames(other.rig, other.matched) && other.rig.rest_joints == before;
    };
    CHECK(refuses([](RestingRig& o) { o.match("left_knee") = o.match("right_knee") = -1; }));
    CHECK(refuses([](RestingRig& o) { o.match("left_hip") = o.match("right_hip") = -1; }));
    CHECK(refuses([](RestingRig& o) { o.scale_rest(0); }));
    CHECK(refuses([](RestingRig& o) {
        for (auto& x : o.rig.joints) x = vec3<double>(0);
    }));
    CHECK(refuses([](RestingRig&) {}, 0));
}
