// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/moved_motion.hpp>

#include "io/sample_files.hpp"
#include "io/small_body.hpp"

using namespace gsh;

namespace {

Motion some_motion(const BodyModel& body, std::size_t frames, std::uint64_t seed = 3) {
    test::Rng rng(seed);
    Motion motion;
    motion.joint_count = body.joint_count();
    motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas = rng.numbers(static_cast<std::size_t>(body.shape_count));
    motion.pose = rng.vecs(frames * motion.joint_count, -0.4, 0.4);
    motion.expression = rng.numbers(frames * motion.expression_count);
    motion.transl = rng.vecs(frames);
    motion.timestamps.assign(frames, 0);
    return motion;
}

} // namespace

TEST_CASE("root_joint is the first of the regressed joints") {
    const BodyModel body = test::small_body(7);
    const Motion motion = some_motion(body, 2);
    const auto joints = regress_joints(body, shaped_vertices(body, motion.betas, motion.expression_at(1)));
    CHECK(length(root_joint(body, motion.betas, motion.expression_at(1)) - joints[0]) < 1e-15);
    CHECK_THROWS_AS((void)root_joint(body, std::vector<double>(4)), ShapeError);
    CHECK_THROWS_AS((void)root_joint(body, {}, std::vector<double>(3)), ShapeError);
    CHECK_THROWS_AS((void)root_joint(BodyModel(), {}), ValueError);
}

TEST_CASE("moving a frame moves every point of the posed body rigidly") {
    const BodyModel body = test::small_body(9);
    Motion motion = some_motion(body, 3);
    const auto before = test::posed_points(body, motion, 1), other = test::posed_points(body, motion, 0);
    const Affine<double> change(rotation_from_axis_angle(vec3<double>(0.3, 2.5, -0.7)), {1, -2, 3});
    move_frame(body, motion, 1, change);
    auto expected = before;
    for (auto& point : expected) point = change(point);
    CHECK(test::largest_distance(test::posed_points(body, motion, 1), expected) < 1e-13);
    CHECK(test::largest_distance(test::posed_points(body, motion, 0), other) == 0);

    CHECK_THROWS_AS(move_frame(body, motion, 3, change), ValueError);
    CHECK_THROWS_AS(move_frame(body, motion, 0, {mat3<double>(2.0), vec3<double>(0)}), ValueError);
    const mat3<double> mirror(vec3<double>(-1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1));
    CHECK_THROWS_AS(move_frame(body, motion, 0, {mirror, vec3<double>(0)}), ValueError);
}

TEST_CASE("a body stands up, whichever axis it stood along") {
    const BodyModel body = test::small_body(5);
    for (const vec3<double> turn :
         {vec3<double>(0), vec3<double>(1.5707963, 0, 0), vec3<double>(-1.5707963, 0, 0), vec3<double>(3.1415926, 0, 0),
          vec3<double>(0, 0, 1.5707963), vec3<double>(0, 0, -1.5707963)}) {
        Motion motion = some_motion(body, 4);
        for (std::size_t t = 0; t < 4; ++t)
            motion.pose[5 * t] = axis_angle_from_rotation(rotation_from_axis_angle(turn) *
                                                          rotation_from_axis_angle(vec3<double>(0.1, 0.5, 0)));
        Motion stood = motion;
        REQUIRE(upright_rotation(motion));
        for (std::size_t t = 0; t < 4; ++t) move_frame(body, stood, t, {*upright_rotation(motion), vec3<double>(0)});
        CHECK(length((*upright_rotation(motion) * rotation_from_axis_angle(turn))[1] - vec3<double>(0, 1, 0)) < 1e-6);
        CHECK(upright_rotation(stood) == mat3<double>(1.0));
        for (std::size_t t = 0; t < 4; ++t) CHECK(rotation_from_axis_angle(stood.pose[5 * t])[1].y > 0.99);
        // A rigid motion keeps the distances between frames.
        const double before = length(test::posed_points(body, motion, 0)[3] - test::posed_points(body, motion, 2)[1]);
        CHECK(length(test::posed_points(body, stood, 0)[3] - test::posed_points(body, stood, 2)[1]) ==
              doctest::Approx(before));
    }
    Motion lying = some_motion(body, 2);
    lying.pose[0] = {1, 0, 0}, lying.pose[5] = {-2.2, 0, 0};
    CHECK(!upright_rotation(lying));
    CHECK(!upright_rotation(Motion{}));
}
