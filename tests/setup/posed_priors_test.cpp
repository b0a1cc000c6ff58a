// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/setup/canonical_setup.hpp>
#include <gsh/setup/posed_priors.hpp>

#include "io/temporary.hpp"
#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t posed_count = 4000, bent = 1;

/// A smooth tube that bends, and a camera three metres in front of it. It has two joints more than trunk and limbs.
struct BentTube {
    BodyModel body = test::tube(24, 48, 24);
    Motion motion;
    Camera<double> camera;
    cpu::Serial backend;

    BentTube() {
        test::Rng rng(4);
        body.posedirs.clear();
        motion.joint_count = 24;
        motion.pose = rng.vecs(2 * 24, -0.06, 0.06);
        motion.pose[24] = {0.1, 0.5, 0.1}; // the whole tube turns
        motion.transl = {{0, 0, 0}, {0.1, 0.05, 0.2}};
        motion.timestamps = {0, 1};
        camera.R = mat3<double>(vec3<double>(1, 0, 0), vec3<double>(0, -1, 0), vec3<double>(0, 0, -1));
        camera.t = {0, 0.8, 3};
        camera.fx = camera.fy = 360;
        camera.cx = camera.cy = 128;
        camera.width = camera.height = 256;
    }
    [[nodiscard]] std::vector<vec3<double>> seen() const { return test::posed_vertices(body, motion, bent); }
    [[nodiscard]] EstimatedView normals(bool integrate = false, std::optional<std::size_t> frame = bent) {
        return {normal_view(backend, seen(), body.faces, camera), frame, "a map", integrate};
    }
    [[nodiscard]] EstimatedView depths(double farther = 0, double factor = 1) {
        PriorView view = depth_view(backend, seen(), body.faces, camera);
        for (double& depth : view.map.values.data) depth = factor * (depth + farther);
        return {view, bent, "a map"};
    }
    [[nodiscard]] CanonicalSetup setup(const EstimatedPriors& estimated, JointSet joints = JointSet::all) {
        Configuration config = named_configuration("paper");
        config.joints = joints;
        return make_canonical_setup(backend, body, motion, config, posed_count, 7, {}, estimated);
    }
    /// Samples whose posed surface faces the camera, away from the tube's ends.
    [[nodiscard]] std::vector<std::size_t> in_front(const CanonicalSetup& setup, double top) const {
        const auto bones = pose_body(body, motion.pose_at(bent), motion.transl[bent]).bones;
        std::vector<std::size_t> chosen;
        for (std::size_t i = 0; i < setup.samples.size(); ++i) {
            const vec3<double>& p = setup.samples.positions[i];
            const auto joint = std::min<std::size_t>(23, static_cast<std::size_t>(p.y / 1.6 * 24));
            if (p.y > 0.1 && p.y < top && (bones[joint].linear * setup.samples.normals[i]).z > 0.5) chosen.push_back(i);
        }
        REQUIRE(chosen.size() > 200);
        return chosen;
    }
};

/// The errors of features of (depth, normal) relative to those of the body itself: 0 and its canonical normals.
void check_features(const CanonicalSetup& setup, const std::vector<std::size_t>& chosen) {
    REQUIRE(setup.priors.features.size() == 4 * setup.samples.size());
    double depth = 0, normal = 0;
    for (const std::size_t i : chosen) {
        const double* row = &setup.priors.features[4 * i];
        depth += std::abs(row[0]) * 0.1; // metres
        normal += 1 - dot(vec3<double>(row[1], row[2], row[3]), setup.samples.normals[i]);
    }
    CHECK(depth / static_cast<double>(chosen.size()) < 0.002);
    CHECK(normal / static_cast<double>(chosen.size()) < 1e-4);
}

} // namespace

TEST_CASE("maps of a posed body say what is true of the canonical one") {
    BentTube tube;
    EstimatedPriors estimated;
    estimated.normals = {tube.normals()};
    estimated.depths = {tube.depths()};
    const CanonicalSetup all = tube.setup(estimated);
    check_features(all, tube.in_front(all, 1.5));
    // Merged joints do not bend. The features below them do not change.
    const CanonicalSetup merged = tube.setup(estimated, JointSet::trunk_and_limbs);
    CHECK(merged.rig.joint_count() == 22);
    check_features(merged, tube.in_front(merged, 1.3));

    // With the wrong frame, the features are wrong.
    estimated.normals[0].frame = 0, estimated.depths[0].frame = 0;
    const CanonicalSetup wrong = tube.setup(estimated);
    double off = 0;
    for (const std::size_t i : tube.in_front(wrong, 1.5)) off += std::abs(wrong.priors.features[4 * i]);
    CHECK(off / static_cast<double>(tube.in_front(wrong, 1.5).size()) > 0.5);
}

TEST_CASE("the bones are those of the body that moves the Gaussians") {
    BentTube tube;
    EstimatedPriors estimated;
    estimated.normals = {tube.normals()};
    const std::vector<int> kept = trunk_and_limbs(tube.body);
    const BodyModel mover = merge_joints(tube.body, kept);
    const Motion motion = merge_joints(tube.motion, kept);
    const auto posed = [&] {
        return posed_priors(tube.backend, {tube.body, tube.motion, mover, motion}, estimated).normals;
    };
    const auto views = posed();
    REQUIRE(views.size() == 1);
    REQUIRE(views[0].bones.size() == 22);
    const auto bones = pose_body(mover, motion.pose_at(bent), motion.transl[bent]).bones;
    for (std::size_t j = 0; j < 22; ++j)
        CHECK(views[0].bones[j](vec3<double>(0.1, 0.9, 0)) == bones[j](vec3<double>(0.1, 0.9, 0)));
    // Canonical views get no bones, and views keep bones that they have.
    estimated.normals = {two_normal_views(tube.backend, tube.body.v_template, tube.body.faces)[0]};
    CHECK(posed()[0].bones.empty());
    estimated.normals[0].view.bones = bones;
    CHECK(posed()[0].bones.size() == 22);
}

TEST_CASE("normals that ask for it become a depth, placed by the posed mesh") {
    BentTube tube;
    EstimatedPriors estimated;
    estimated.normals = {tube.normals(true)};
    const CanonicalSetup setup = tube.setup(estimated);
    check_features(setup, tube.in_front(setup, 1.5));
    estimated.depths = {tube.depths()}; // in front of it
    CHECK(tube.setup(estimated).priors.features.size() == 5 * posed_count);
    estimated.normals[0].frame.reset();
    estimated.normals[0].view.bones.resize(24);
    test::check_throws<ValueError>([&] { (void)tube.setup(estimated); }, {"a map", "bones", "frame"});
}

TEST_CASE("what nobody asks for is neither made nor looked at") {
    BentTube tube;
    const SeenPerson person{tube.body, tube.motion, tube.body, tube.motion};
    EstimatedPriors estimated{{tube.depths()}, {tube.normals(true), tube.normals()}};
    const auto counts = [&](const PosedPriorsParams& params) {
        const PosedPriors posed = posed_priors(tube.backend, person, estimated, params);
        for (const PriorView& view : posed.depths) CHECK(view.map.values.view().channels == 1);
        for (const PriorView& view : posed.normals) CHECK(view.map.values.view().channels == 3);
        return std::pair(posed.depths.size(), posed.normals.size());
    };
    CHECK(counts({}) == std::pair<std::size_t, std::size_t>(2, 2)); // the second depth from the first normals
    CHECK(counts({.normals = false}) == std::pair<std::size_t, std::size_t>(2, 0));
    CHECK(counts({.depths = false}) == std::pair<std::size_t, std::size_t>(0, 2));
    estimated.normals[0].frame.reset(); // the views' bones matter only where depth is compared
    estimated.normals[0].view.bones.resize(24);
    CHECK(counts({.depths = false}) == std::pair<std::size_t, std::size_t>(0, 2));
    test::check_throws<ValueError>([&] { (void)counts({.normals = false}); }, {"a map", "bones"});
    estimated.normals = {tube.normals(false, 2)}; // no such frame
    CHECK(counts({.normals = false}) == std::pair<std::size_t, std::size_t>(1, 0));
    estimated = {{tube.depths(0, 1000)}, {tube.normals()}}; // a depth map in other units
    CHECK(counts({.depths = false}) == std::pair<std::size_t, std::size_t>(0, 1));
    CHECK(counts({.feature = DepthFeature::raw}) == std::pair<std::size_t, std::size_t>(1, 1));
    test::check_throws<ValueError>([&] { (void)counts({}); }, {"a map", "metres"});
}

TEST_CASE("maps that are not of this body in this frame are refused") {
    BentTube tube;
    const auto refuse = [&](const EstimatedPriors& estimated, std::initializer_list<std::string_view> words) {
        test::check_throws<Error>([&] { (void)tube.setup(estimated); }, words);
    };
    refuse({{}, {tube.normals(false, 2)}}, {"a map", "frame is 2", "2 frames"});
    EstimatedView aside = tube.normals();
    std::get<Camera<double>>(aside.view.camera).t.x += 0.6;
    refuse({{}, {aside}}, {"a map", "does not lie on the body"});
    refuse({{}, {EstimatedView(aside.view, bent, "a map", true)}}, {"a map", "does not lie on the body"});
    std::get<Camera<double>>(aside.view.camera).t.x = 9; // out of the picture
    refuse({{}, {aside}}, {"a map", "nothing of the body"});
    refuse({{tube.depths(0, 1000)}, {}}, {"a map", "metres"});
    refuse({{tube.depths(-2.5)}, {}}, {"a map", "metres"});
    EstimatedView flat = tube.depths();
    flat.view.map.values = Image<double>(3, 256, 256);
    refuse({{flat}, {}}, {"a map", "map.values"});
}
