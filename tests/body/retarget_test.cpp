// SPDX-License-Identifier: Apache-2.0
/// @file  Retargeting: limbs point where the source's do, for all rest poses, spines and names; sides and heights stay.

#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/retarget_check.hpp"
#include "support/sample_rig.hpp"

#include <doctest/doctest.h>

#include <gsh/body/retarget.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;

namespace {

const BodyModel& whole_actor() {
    static const BodyModel body = make_actor();
    return body;
}

/// The sample as a RigMotion, in metres and with y up; every joint's rest frame is turned by a rotation of its own.
RigMotion rig_of(const test::SampleRig& sample, const test::SampleOptions& o, unsigned seed = 0) {
    test::Rng rng(seed + 1);
    RigMotion rig;
    rig.names = sample.names, rig.parents = sample.parents;
    for (const auto& x : sample.rest) rig.rest_joints.push_back(x * (1 / o.units));
    for (std::size_t j = 0; j < sample.names.size(); ++j)
        rig.rest_rotations.push_back(seed ? rotation_from_axis_angle(rng.vec(-2, 2)) : mat3<double>(1.0));
    for (std::size_t t = 0; t < sample.root.size(); ++t) {
        const auto pose = test::pose_of(sample, t, "ZXY");
        for (std::size_t j = 0; j < sample.names.size(); ++j) {
            rig.joints.push_back(pose.joints[j] * (1 / o.units));
            rig.rotations.push_back(pose.rotations[j] * rig.rest_rotations[j]);
        }
        rig.timestamps.push_back(static_cast<double>(t) / 30);
    }
    return rig;
}

test::RetargetErrors errors_of(const test::SampleOptions& o, unsigned seed = 0) {
    const auto sample = test::sample_rig(o);
    const Motion motion = retarget(rig_of(sample, o, seed), whole_actor());
    CHECK(motion.frame_count() == o.frames);
    return test::compare(sample, "ZXY", o, motion, whole_actor(), joint_names_of(whole_actor()));
}

void check_follows(const test::SampleOptions& o, unsigned seed = 0) {
    const auto errors = errors_of(o, seed);
    CHECK(errors.limbs < 1e-4); // degrees
    CHECK(errors.trunk < 1e-4);
    CHECK(errors.hips < 1e-9);
    CHECK(errors.ankles < 0.02);
    CHECK(errors.left > 0.99);
}

} // namespace

TEST_CASE("limbs point where the source's do, for every rest pose, name and spine") {
    for (const auto names : {test::Names::smplx, test::Names::mixamo, test::Names::vrm, test::Names::cmu,
                             test::Names::bvh, test::Names::mhr, test::Names::unreal})
        for (const auto rest : {test::Rest::T, test::Rest::A, test::Rest::down})
            for (int spine = 1; spine <= 4; ++spine) {
                CAPTURE(static_cast<int>(names));
                CAPTURE(static_cast<int>(rest));
                CAPTURE(spine);
                check_follows({.names = names, .rest = rest, .spine = spine});
            }
}

TEST_CASE("missing toes, twist bones, fingers, size and facing do not change that") {
    check_follows({.rest = test::Rest::A, .toes = false});
    check_follows({.rest = test::Rest::A, .twist = true});
    for (const auto names : {test::Names::mixamo, test::Names::vrm, test::Names::mhr, test::Names::unreal})
        for (const auto rest : {test::Rest::T, test::Rest::A, test::Rest::down})
            check_follows({.names = names, .rest = rest, .fingers = true});
    check_follows({.rest = test::Rest::down, .size = 0.55});
    check_follows({.rest = test::Rest::A, .turn = 3.14159265358979324}); // VRM 0.x faces -z
    check_follows({.rest = test::Rest::A, .turn = 0.8});                 // no axis
    check_follows({.rest = test::Rest::A, .fingers = true}, 5);          // rest frames with axes of their own
}

TEST_CASE("a motion of the body itself comes back as it was") {
    Motion motion = actor_motion(ActorMotion::stride, 12);
    motion.betas.assign(static_cast<std::size_t>(whole_actor().shape_count), 0.0);
    motion.betas[0] = 0.7;
    std::vector<std::string> warnings;
    const Motion back =
        retarget(rig_of_motion(whole_actor(), motion), whole_actor(), {}, {motion.betas, "own", &warnings});
    for (std::size_t i = 0; i < motion.pose.size(); ++i)
        CHECK(length(axis_angle_from_rotation(transpose(rotation_from_axis_angle(motion.pose[i])) *
                                              rotation_from_axis_angle(back.pose[i]))) < 1e-9);
    for (std::size_t t = 0; t < motion.frame_count(); ++t) CHECK(length(motion.transl[t] - back.transl[t]) < 1e-9);
    CHECK(back.timestamps == motion.timestamps);
    CHECK(back.betas == motion.betas);
    CHECK(warnings.empty());
}

TEST_CASE("bodies of 22, 24 and 52 joints take the joints that they have") {
    const Motion motion = actor_motion(ActorMotion::reach, 3);
    for (const std::size_t joints : {std::size_t(22), std::size_t(24), std::size_t(52)}) {
        BodyModel body = whole_actor(); // its first joints, and those of the hands
        const auto from = [&](std::size_t j) { return joints == 52 && j >= 22 ? j + 3 : j; };
        body.parents.clear(), body.J_regressor.clear();
        for (std::size_t j = 0; j < joints; ++j) {
            int parent = joints == 24 && j >= 22 ? static_cast<int>(j) - 2 : whole_actor().parents[from(j)];
            if (joints == 52 && parent >= 25) parent -= 3;
            body.parents.push_back(parent);
            body.J_regressor.push_back(
                whole_actor().J_regressor[joints == 24 && j >= 22 ? (j == 22 ? 28 : 43) : from(j)]);
        }
        body.weights.assign(body.vertex_count() * joints, 0.0);
        for (std::size_t v = 0; v < body.vertex_count(); ++v) body.weights[v * joints] = 1;
        body.posedirs.clear();
        const Motion result = retarget(rig_of_motion(whole_actor(), motion), body);
        CHECK(result.joint_count == joints);
        for (std::size_t j = 0; j < joints; ++j)
            CHECK(length(result.pose_at(1)[j] -
                         (joints == 24 && j >= 22 ? vec3<double>(0) : motion.pose_at(1)[from(j)])) < 1e-9);
    }
}

TEST_CASE("bodies whose joints have no known names, and rigs without limbs, are refused with a list of names") {
    const auto sample = test::sample_rig();
    const RigMotion rig = rig_of(sample, {});
    test::check_throws<ValueError>([&] { (void)retarget(rig, test::small_body(27)); }, {"pelvis", "22, 24, 52 or 55"});
    for (const char* part : {"pelvis", "left_knee", "right_elbow", "left_hip"}) {
        RigMotion other = rig;
        other.names[static_cast<std::size_t>(sample.joint(part))] = "Bone_7";
        test::check_throws<ValueError>([&] { (void)retarget(other, whole_actor(), {}, {{}, "walk.bvh", nullptr}); },
                                       {"walk.bvh", part, "--joint-map", "Bone_7", "mixamorig:Head"});
        JointMap map;
        map.named["Bone_7"] = part;
        CHECK(retarget(other, whole_actor(), map).pose == retarget(rig, whole_actor()).pose);
    }
    test::check_throws<ShapeError>(
        [&] { (void)retarget(rig, whole_actor(), {}, {std::vector<double>(500, 0.0), "x", nullptr}); },
        {"betas", "500"});
    RigMotion flat = rig; // hips and shoulders on one line, at rest and in the frames
    for (auto* points : {&flat.rest_joints, &flat.joints})
        for (auto& x : *points) x = {0, x.y, 0};
    test::check_throws<ValueError>([&] { (void)retarget(flat, whole_actor()); }, {"do not span a plane"});
    RigMotion none = rig;
    none.rotations[3][1].x = std::numeric_limits<double>::quiet_NaN();
    test::check_throws<ValueError>([&] { (void)retarget(none, whole_actor()); }, {"rotation"});
}

TEST_CASE("warned of: joints without a source, joints that are not used, left and right swapped, feet that slide") {
    const auto warnings_of = [](const RigMotion& rig) {
        std::vector<std::string> warnings;
        (void)retarget(rig, whole_actor(), {}, {{}, "x", &warnings});
        std::string all;
        for (const auto& warning : warnings) all += warning + "\n";
        return all;
    };
    const auto sample = test::sample_rig({.twist = true});
    std::string text = warnings_of(rig_of(sample, {}));
    CHECK(text == test::contains("no joint was found for jaw, left_eye"));
    CHECK(text == test::contains("Twistleft_arm"));
    CHECK(text != test::contains("backwards"));

    RigMotion mirrored = rig_of(sample, {}); // as from left-handed axes
    for (auto* points : {&mirrored.rest_joints, &mirrored.joints})
        for (auto& x : *points) x.x = -x.x;
    for (auto& R : mirrored.rotations) R = mat3<double>(1.0);
    CHECK(warnings_of(mirrored) == test::contains("left and right swapped"));

    // The source sits down with its feet in place. With shins as long as its thighs, the body's feet must slide.
    test::SampleOptions squat{.frames = 20};
    auto sitting = test::sample_rig(squat);
    for (std::size_t t = 0; t < 20; ++t) {
        for (auto& a : sitting.angles[t]) a = vec3<double>(0);
        const double bend = 0.06 * static_cast<double>(t);
        for (const std::string side : {"left_", "right_"}) {
            sitting.angles[t][static_cast<std::size_t>(sitting.joint(side + "hip"))] = {-bend, 0, 0};
            sitting.angles[t][static_cast<std::size_t>(sitting.joint(side + "knee"))] = {2 * bend, 0, 0};
        }
        const auto ankle = static_cast<std::size_t>(sitting.joint("left_ankle"));
        sitting.root[t] = sitting.rest[0];
        sitting.root[t] += sitting.rest[ankle] - test::pose_of(sitting, t, "ZXY").joints[ankle];
    }
    CHECK(warnings_of(rig_of(sitting, squat)) != test::contains("slide"));         // nearly the body's proportions
    for (auto* points : {&sitting.rest})                                           // shins of half the length
        for (const std::string side : {"left_", "right_"}) {
            const auto knee = static_cast<std::size_t>(sitting.joint(side + "knee"));
            (*points)[knee].y -= 0.22;
        }
    for (std::size_t t = 0; t < 20; ++t) {
        const auto ankle = static_cast<std::size_t>(sitting.joint("left_ankle"));
        sitting.root[t] += sitting.rest[ankle] - test::pose_of(sitting, t, "ZXY").joints[ankle];
    }
    CHECK(warnings_of(rig_of(sitting, squat)) == test::contains("feet slide by up to"));
}

TEST_CASE("a short spine goes to the joints at the same share of the way from the hips to the shoulders") {
    const auto spine_of = [](const std::vector<double>& heights, const JointMap& map = {}) {
        RigMotion rig = rig_of(test::sample_rig({.spine = static_cast<int>(heights.size())}), {});
        std::string first;
        for (std::size_t n = 0; n < heights.size(); ++n) {
            const auto j = static_cast<std::size_t>(
                std::find(rig.names.begin(), rig.names.end(), "mixamorig:Spine" + (n ? std::to_string(n) : "")) -
                rig.names.begin());
            rig.rest_joints[j].y = heights[n];
            for (std::size_t t = 0; t < rig.frame_count(); ++t) // turned against the hips by 0.1, 0.2, ...
                rig.rotations[t * rig.joint_count() + j] =
                    rig.rotation(t, 0) * test::turn_about(0, 0.1 * static_cast<double>(n + 1));
        }
        const Motion motion = retarget(rig, whole_actor(), map);
        std::string moved; // joints of the body's spine that turn against their parents
        for (const std::string_view joint : {"spine1", "spine2", "spine3"})
            if (length(motion.pose_at(1)[static_cast<std::size_t>(smplx_joint(joint))]) > 1e-6) moved += joint.back();
        return moved;
    };
    // The actor has spine1 at 26 %, spine2 at 45 % and spine3 at 65 % of the way. The rig's hips are at 0.93 m, its
    // shoulders at 1.43 m.
    CHECK(spine_of({1.00}) == "1");
    CHECK(spine_of({1.17}) == "2");
    CHECK(spine_of({1.30}) == "3");
    CHECK(spine_of({1.00, 1.15}) == "12");
    CHECK(spine_of({1.00, 1.35}) == "13");
    CHECK(spine_of({1.20, 1.35}) == "23");
    JointMap map;
    map.named["mixamorig:Spine"] = "spine1";
    CHECK(spine_of({1.30}, map) == "1"); // as the joint map has it
}
