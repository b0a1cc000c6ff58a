// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_error.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include "support/bodies.hpp"
#include "support/skip.hpp"


using namespace gsh;

namespace {

struct Fixture {
    BodyModel body = test::tube(4, 8, 6);
    Motion motion;
    test::Rng rng{12};

    Fixture() {
        motion.joint_count = 4;
        motion.expression_count = 2;
        motion.betas = {0.3, -0.5};
        for (int t = 0; t < 3; ++t) {
            for (const auto& v : rng.vecs(4)) motion.pose.push_back(v);
            motion.expression.insert(motion.expression.end(), {rng.uniform(), rng.uniform()});
            motion.transl.push_back(rng.vec());
            motion.timestamps.push_back(0.1 * t);
        }
    }
};

} // namespace

TEST_CASE("joints of a motion are those of the posed body") {
    const Fixture f;
    const auto joints = motion_joints(f.body, f.motion);
    REQUIRE(joints.size() == 12);
    for (std::size_t t = 0; t < 3; ++t) {
        const auto posed =
            pose_body(f.body, f.motion.pose_at(t), f.motion.transl[t], f.motion.betas, f.motion.expression_at(t));
        for (std::size_t j = 0; j < 4; ++j) CHECK(length(joints[4 * t + j] - posed.joints[j]) < 1e-14);
    }
}

TEST_CASE("a motion has no distance to itself, and alignment takes out what it says") {
    Fixture f;
    CHECK(joint_errors(f.body, f.motion, f.motion).mean_mm == 0);
    Motion moved = f.motion;
    for (auto& t : moved.transl) t += vec3<double>(0.003, 0, -0.004);
    CHECK(joint_errors(f.body, moved, f.motion, RootAlignment::none).mean_mm == doctest::Approx(5));
    CHECK(joint_errors(f.body, moved, f.motion).mean_mm < 1e-9);
    for (std::size_t t = 0; t < 3; ++t) // turn the whole body
        moved.pose[4 * t] = axis_angle_from_rotation(rotation_from_axis_angle(vec3<double>(0.1, 0, 0.2)) *
                                                     rotation_from_axis_angle(moved.pose[4 * t]));
    CHECK(joint_errors(f.body, moved, f.motion).mean_mm > 10);
    CHECK(joint_errors(f.body, moved, f.motion, RootAlignment::rotation).mean_mm < 1e-9);
}

TEST_CASE("one bent joint moves what lies beyond it, by the chord of its angle") {
    Fixture f;
    f.motion.betas.clear(), f.motion.expression.clear(), f.motion.expression_count = 0;
    std::fill(f.motion.pose.begin(), f.motion.pose.end(), vec3<double>(0.0));
    Motion bent = f.motion;
    bent.pose[4 + 2] = {0, 0, 0.1}; // joint 2 in frame 1; joints lie 0.4 m apart
    const auto errors = joint_errors(f.body, bent, f.motion);
    const double chord = 1000 * 0.4 * 2 * std::sin(0.05);
    CHECK(errors.per_joint_mm[2] == doctest::Approx(0));
    CHECK(errors.per_joint_mm[3] == doctest::Approx(chord / 3));
    CHECK(errors.per_frame_mm[0] == doctest::Approx(0));
    CHECK(errors.per_frame_mm[1] == doctest::Approx(chord / 4));
    CHECK(errors.mean_mm == doctest::Approx(chord / 12));
    CHECK(errors.worst_mm == doctest::Approx(chord));
    const std::vector<std::size_t> frame{1}, joints{2, 3};
    CHECK(joint_errors(f.body, bent, f.motion, RootAlignment::position, frame).mean_mm == doctest::Approx(chord / 4));
    CHECK(errors.mean_of_mm(joints) == doctest::Approx(chord / 6));
}

TEST_CASE("motions that cannot be compared are refused") {
    Fixture f;
    Motion shorter = f.motion;
    shorter.transl.pop_back(), shorter.timestamps.pop_back();
    shorter.pose.resize(8, vec3<double>(0.0)), shorter.expression.resize(4);
    CHECK_THROWS_AS((void)joint_errors(f.body, shorter, f.motion), ShapeError);
    const std::vector<std::size_t> beyond{3}, joint{4};
    CHECK_THROWS_AS((void)joint_errors(f.body, f.motion, f.motion, RootAlignment::position, beyond), ValueError);
    CHECK_THROWS_AS((void)joint_errors(test::tube(5), f.motion, f.motion), ShapeError);
    CHECK_THROWS_AS((void)joint_errors(f.body, f.motion, f.motion).mean_of_mm(joint), ValueError);
    CHECK(joint_errors(f.body, f.motion, f.motion).mean_of_mm({}) == 0);
}

TEST_CASE("the noisy poses of a capture are as far from the true ones as its readme says") {
    const auto body_file = test::shared_data("body/cc0_body_x.npz"), capture = test::shared_data("captures/A_multi");
    if (test::skip_without({body_file, capture / "poses.npz", capture / "poses_noisy.npz"})) return;
    const BodyModel body = load_body_model(body_file);
    const Motion truth = load_motion(capture / "poses.npz", body),
                 noisy = load_motion(capture / "poses_noisy.npz", body);
    std::vector<std::size_t> trunk, fingers;
    for (std::size_t j = 0; j < 25; ++j) trunk.push_back(j);
    for (std::size_t j = 25; j < 55; ++j) fingers.push_back(j);
    for (const auto alignment : {RootAlignment::none, RootAlignment::position, RootAlignment::rotation}) {
        const auto errors = joint_errors(body, noisy, truth, alignment);
        MESSAGE("alignment " << static_cast<int>(alignment) << ": mean " << errors.mean_mm << " mm, worst "
                             << errors.worst_mm << ", body and face " << errors.mean_of_mm(trunk) << ", fingers "
                             << errors.mean_of_mm(fingers));
        CHECK(errors.mean_mm > 5);
        CHECK(errors.mean_mm < 40);
    }
}
