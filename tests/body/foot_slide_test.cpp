// SPDX-License-Identifier: Apache-2.0
/// @file  Feet that slide: counted only while the source's foot stands, along the ground, against the source's own way.
#include <gsh/body/foot_slide.hpp>

#include "support/skeleton_body.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// A rig and a body with the same skeleton. The rig stands in its rest pose, moved by `rig_place` in each frame, and so
/// does the body by `body_place`, with the world rotations of `turn`.
struct SlideCase {
    std::size_t frames = 5;
    double seconds = 0.1; ///< from one frame to the next
    double rig_size = 1;  ///< of the rig, compared with the body
    std::function<vec3<double>(double)> rig_place = [](double) { return vec3<double>(0); };
    std::function<vec3<double>(double)> body_place = [](double) { return vec3<double>(0); };
    std::function<mat3<double>(std::size_t joint, double frame)> turn = [](std::size_t, double) {
        return mat3<double>(1.0);
    };
    std::vector<std::string_view> unmatched = {}; ///< joints that were not found in the rig

    [[nodiscard]] static std::size_t joint(std::string_view name) {
        return static_cast<std::size_t>(smplx_joint(name));
    }
    [[nodiscard]] static vec3<double> bone(std::string_view from, std::string_view to) {
        const auto& joints = test::skeleton_body().v_template; // each joint is at a vertex
        return joints[joint(to)] - joints[joint(from)];
    }
    /// The height of the hips, in which the limits of speed and height are measured.
    [[nodiscard]] static double leg() {
        return length(bone("left_hip", "left_knee")) + length(bone("left_knee", "left_ankle")) +
               bone("left_hip", "pelvis").y;
    }

    [[nodiscard]] double longest() const {
        const BodyModel& body = test::skeleton_body();
        RigMotion rig;
        rig.names = joint_names_of(body), rig.parents = body.parents;
        for (const auto& x : body.v_template) rig.rest_joints.push_back(x * rig_size);
        for (std::size_t t = 0; t < frames; ++t) {
            for (const auto& x : rig.rest_joints)
                rig.joints.push_back(x + rig_place(static_cast<double>(t)) * rig_size);
            rig.timestamps.push_back(static_cast<double>(t) * seconds);
        }
        const MatchedJoints target = JointMap{}.match(rig, "the body");
        MatchedJoints source = target;
        for (const std::string_view name : unmatched) source[joint(name)] = -1;
        FootSlide slide(rig, body, source, target, body.v_template, leg(), 1 / rig_size);
        CHECK(slide.longest() == 0);
        for (std::size_t t = 0; t < frames; ++t) {
            std::vector<mat3<double>> world;
            for (std::size_t j = 0; j < body.joint_count(); ++j) world.push_back(turn(j, static_cast<double>(t)));
            slide.add(t, world, body.v_template[0] + body_place(static_cast<double>(t)));
        }
        return slide.longest();
    }
};

/// Along x, at a speed in leg lengths a second, of frames of a tenth of a second.
auto slide_at(double speed) {
    return [speed](double t) { return vec3<double>(0.1 * speed * SlideCase::leg() * t, 0, 0); };
}

} // namespace

TEST_CASE("a foot stands from the second frame on, and what the body moves from there is its slide") {
    CHECK(SlideCase{}.longest() == 0);
    const auto body = [](double t) { return vec3<double>(0.03 * t, 0.2 * t, 0.04 * t); }; // up is no slide
    CHECK(SlideCase{.body_place = body}.longest() == doctest::Approx(0.05 * 3));
    CHECK(SlideCase{.frames = 2, .body_place = body}.longest() == doctest::Approx(0)); // begins to stand
    CHECK(SlideCase{.frames = 1, .body_place = body}.longest() == 0);
    CHECK(SlideCase{.frames = 0, .body_place = body}.longest() == 0);
    CHECK(SlideCase{.seconds = 0, .body_place = body}.longest() == 0); // no speed is known
    CHECK(SlideCase{.body_place = body, .unmatched = {"left_ankle", "right_ankle"}}.longest() == 0);
    const auto there_and_back = [](double t) { return vec3<double>(t == 2 ? 0.1 : 0, 0, 0); };
    CHECK(SlideCase{.body_place = there_and_back}.longest() == doctest::Approx(0.1)); // the longest, not the last
}

TEST_CASE("the rig's own way is subtracted, in the body's size") {
    const double way = 3 * 0.1 * 0.1 * SlideCase::leg(); // a tenth of a leg a second, in three frames
    for (const double size : {1.0, 2.5}) {
        CAPTURE(size);
        CHECK(SlideCase{.rig_size = size, .rig_place = slide_at(0.1), .body_place = slide_at(0.1)}.longest() < 1e-12);
        CHECK(SlideCase{.rig_size = size, .rig_place = slide_at(0.1)}.longest() == doctest::Approx(way));
        CHECK(SlideCase{.rig_size = size, .rig_place = slide_at(0.1), .body_place = slide_at(-0.1)}.longest() ==
              doctest::Approx(2 * way));
    }
}

TEST_CASE("a foot of the rig that is fast, or above the ground, does not stand") {
    for (const double size : {1.0, 2.5}) {
        CAPTURE(size);
        CHECK(SlideCase{.rig_size = size, .rig_place = slide_at(0.149)}.longest() > 0);
        CHECK(SlideCase{.rig_size = size, .rig_place = slide_at(0.151)}.longest() == 0);
        const auto raised = [](double height) { // for all but the first frame
            return [height](double t) { return vec3<double>(0, t > 0 ? height * SlideCase::leg() : 0, 0); };
        };
        CHECK(SlideCase{.rig_size = size, .rig_place = raised(0.059), .body_place = slide_at(1)}.longest() > 0);
        CHECK(SlideCase{.rig_size = size, .rig_place = raised(0.061), .body_place = slide_at(1)}.longest() == 0);
    }
}

TEST_CASE("a foot that was lifted stands anew") {
    const auto hop = [](double t) { return vec3<double>(0, t == 4 ? 0.5 : 0, 0); };
    const auto body = [](double t) { return vec3<double>(0.01 * t, 0, 0); };
    // It stands in frames 1 to 3 and, after the hop, which is fast up and down, in frames 6 to 10.
    CHECK(SlideCase{.frames = 11, .rig_place = hop, .body_place = body}.longest() == doctest::Approx(0.01 * 4));
}

TEST_CASE("the body's foot is where its bones lead: each turns by the rotation of the joint that it hangs on") {
    const mat3<double> R = rotation_from_axis_angle(vec3<double>(0.4, 0.5, 0));
    const vec3<double> step(0.02, 0, 0.05);
    for (const std::string side : {"left_", "right_"})
        for (const auto& [joint, next] : {std::pair{"hip", "knee"}, std::pair{"knee", "ankle"}}) {
            const std::string from = side + joint, to = side + next;
            CAPTURE(from);
            SlideCase turned{
                .body_place = [&](double t) { return t > 1 ? step : vec3<double>(0); },
                .turn = [&](std::size_t j,
                            double t) { return j == SlideCase::joint(from) && t > 1 ? R : mat3<double>(1.0); }};
            const vec3<double> bone = SlideCase::bone(from, to), way = R * bone - bone + step;
            CHECK(turned.longest() == doctest::Approx(std::max(length(step), std::hypot(way.x, way.z))));
            turned.unmatched = {side == "left_" ? "left_ankle" : "right_ankle"}; // the other foot moves by the step
            CHECK(turned.longest() == doctest::Approx(length(step)));
        }
    // The bones of both feet begin at the pelvis. A foot that turns about itself stays.
    const auto turned_at = [&](std::string_view joint) {
        return SlideCase{.turn = [&R, j = SlideCase::joint(joint)](std::size_t k, double t) {
            return k == j && t > 1 ? R : mat3<double>(1.0);
        }};
    };
    double longest = 0;
    for (const char* hip : {"left_hip", "right_hip"}) {
        const vec3<double> bone = SlideCase::bone("pelvis", hip), way = R * bone - bone;
        longest = std::max(longest, std::hypot(way.x, way.z));
    }
    CHECK(turned_at("pelvis").longest() == doctest::Approx(longest));
    CHECK(turned_at("left_ankle").longest() == 0);
}
