// SPDX-License-Identifier: Apache-2.0
/// @file  Limbs, hands and fingers turn to where the joints are; what agrees stays as it is, bit for bit.
#include <gsh/body/turned_limbs.hpp>

#include "support/retarget_check.hpp"
#include "support/sample_rig.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

const test::SampleOptions options{.names = test::Names::smplx, .fingers = true, .frames = 3};

RigMotion rig_of(const test::SampleRig& sample) {
    RigMotion rig;
    rig.names = sample.names, rig.parents = sample.parents, rig.rest_joints = sample.rest;
    rig.rest_rotations.assign(rig.names.size(), mat3<double>(1.0));
    for (std::size_t t = 0; t < sample.root.size(); ++t) {
        const auto pose = test::pose_of(sample, t, "ZXY");
        rig.joints.insert(rig.joints.end(), pose.joints.begin(), pose.joints.end());
        rig.rotations.insert(rig.rotations.end(), pose.rotations.begin(), pose.rotations.end());
        rig.timestamps.push_back(static_cast<double>(t));
    }
    return rig;
}

double angle_between(const mat3<double>& a, const mat3<double>& b) {
    return length(axis_angle_from_rotation(transpose(a) * b));
}

} // namespace

TEST_CASE("a rig whose positions follow from its rotations is unchanged") {
    const RigMotion rig = rig_of(test::sample_rig(options));
    RigMotion turned = rig;
    const LimbTurns turns = turn_limbs_to_joints(turned, JointMap{}.match(rig, "the sample"));
    CHECK(turns.limbs == 0);
    CHECK(turns.fingers == 0);
    CHECK(turned.rotations == rig.rotations);
    CHECK(turned.joints == rig.joints);
}

TEST_CASE("bones turn by the smallest angle, hands by their knuckles, last phalanges with the bone before") {
    const auto sample = test::sample_rig(options);
    const RigMotion rig = rig_of(sample);
    const MatchedJoints matched = JointMap{}.match(rig, "the sample");
    RigMotion stale = rig; // rotations of limbs, hands and fingers from another pose
    test::Rng rng(9);
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        for (std::size_t j = 0; j < rig.joint_count(); ++j) {
            const std::string& part = sample.parts[j];
            const bool limb = part.ends_with("knee") || part.ends_with("elbow");
            const bool finger = part.back() >= '1' && part.back() <= '3' && part.find('_') != std::string::npos;
            if (limb || finger || part.ends_with("wrist"))
                stale.rotations[t * rig.joint_count() + j] =
                    rotation_from_axis_angle(rng.vec(-0.5, 0.5)) * rig.rotation(t, static_cast<int>(j));
        }
    const RigMotion before = stale;
    const LimbTurns turns = turn_limbs_to_joints(stale, matched);
    CHECK(turns.limbs > 0.05);
    CHECK(turns.fingers > 0.2);
    const auto at = [&](const std::string& joint) { return detail::matched_joint(matched, joint); };
    for (std::size_t t = 0; t < rig.frame_count(); ++t)
        for (const std::string side : {"left_", "right_"}) {
            for (const auto& [from, to] : {std::pair{"hip", "knee"},
                                           {"knee", "ankle"},
                                           {"elbow", "wrist"},
                                           {"index1", "index2"},
                                           {"index2", "index3"},
                                           {"thumb1", "thumb2"}}) {
                const int a = at(side + from), b = at(side + to);
                const vec3<double> bone =
                    rig.rest_joints[static_cast<std::size_t>(b)] - rig.rest_joints[static_cast<std::size_t>(a)];
                CHECK(test::degrees_between(stale.rotation(t, a) * bone, rig.rotation(t, a) * bone) < 1e-6);
                const double turned = angle_between(before.rotation(t, a), stale.rotation(t, a)) * 57.295779513;
                CHECK(turned == doctest::Approx(
                                    test::degrees_between(before.rotation(t, a) * bone, stale.rotation(t, a) * bone)));
            }
            CHECK(angle_between(stale.rotation(t, at(side + "wrist")), rig.rotation(t, at(side + "wrist"))) < 1e-6);
            const int second = at(side + "index2"), last = at(side + "index3"); // no joint at its end
            CHECK(angle_between(stale.rotation(t, second) * transpose(before.rotation(t, second)),
                                stale.rotation(t, last) * transpose(before.rotation(t, last))) < 1e-9);
            for (const char* kept : {"hip", "ankle", "shoulder", "collar"})
                CHECK(stale.rotation(t, at(side + kept)) == before.rotation(t, at(side + kept)));
        }
}

TEST_CASE("bones without a length and joints that are missing are left as they are") {
    const auto sample = test::sample_rig({.names = test::Names::smplx, .toes = false, .frames = 2});
    RigMotion rig = rig_of(sample);
    const MatchedJoints matched = JointMap{}.match(rig, "the sample");
    const auto ankle = static_cast<std::size_t>(detail::matched_joint(matched, "left_ankle"));
    const int knee = detail::matched_joint(matched, "left_knee");
    for (std::size_t t = 0; t < 2; ++t)
        rig.joints[t * rig.joint_count() + ankle] = rig.joint(t, knee) + vec3<double>(1e-4, 0, 0);
    const RigMotion before = rig;
    (void)turn_limbs_to_joints(rig, matched);
    CHECK(rig.rotations == before.rotations);
    MatchedJoints nothing;
    nothing.fill(-1);
    (void)turn_limbs_to_joints(rig, nothing);
    CHECK(rig.rotations == before.rotations);
}
