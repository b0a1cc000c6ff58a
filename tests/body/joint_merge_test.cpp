// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_merge.hpp>
#include <gsh/body/posed_body.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"

#include <vector>

using namespace gsh;

TEST_CASE("a merged body moves as the whole one does while the joints that are gone are at rest") {
    const BodyModel body = test::tube(5, 8, 6);
    const std::vector<int> kept{0, 1, 3};
    const BodyModel merged = merge_joints(body, kept, true);
    validate(merged, "merged");
    CHECK(merged.joint_count() == 3);
    CHECK(merged.parents == std::vector<int>{-1, 0, 1});
    for (std::size_t v = 0; v < body.vertex_count(); ++v) {
        const double* whole = &body.weights[v * 5];
        CHECK(merged.weights[v * 3] == doctest::Approx(whole[0]));
        CHECK(merged.weights[v * 3 + 1] == doctest::Approx(whole[1] + whole[2])); // joint 1 is the parent of joint 2
        CHECK(merged.weights[v * 3 + 2] == doctest::Approx(whole[3] + whole[4]));
    }

    test::Rng rng(3);
    Motion motion;
    motion.joint_count = 5;
    motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas = {0.3, -0.2};
    motion.pose = rng.vecs(10, -0.5, 0.5);
    for (const std::size_t gone : {2, 4, 7, 9}) motion.pose[gone] = vec3<double>(0.0);
    motion.expression = rng.numbers(2 * motion.expression_count);
    motion.transl = rng.vecs(2);
    motion.timestamps = {0, 1};
    const Motion less = merge_joints(motion, kept, true);
    validate(less, merged, "less");
    for (std::size_t t = 0; t < 2; ++t) {
        const auto whole = pose_body(body, motion.pose_at(t), motion.transl[t], motion.betas, motion.expression_at(t));
        const auto part = pose_body(merged, less.pose_at(t), less.transl[t], less.betas, less.expression_at(t));
        for (std::size_t v = 0; v < whole.vertices.size(); ++v)
            CHECK(length(whole.vertices[v] - part.vertices[v]) < 1e-12);
    }
    const BodyModel mute = merge_joints(body, kept);
    validate(mute, "mute");
    CHECK(mute.expression_count == 0);
    CHECK(merge_joints(motion, kept).expression.empty());
}

TEST_CASE("trunk and limbs are the first 22 joints, or all there are") {
    BodyModel body = test::tube(4, 6, 6);
    CHECK(trunk_and_limbs(body) == std::vector<int>{0, 1, 2, 3});
    body.parents.assign(55, 0);
    CHECK(trunk_and_limbs(body).size() == 22);
}

TEST_CASE("merge_joints refuses lists that make no tree") {
    const BodyModel body = test::tube(4, 6, 6);
    CHECK_THROWS_AS((void)merge_joints(body, std::vector<int>{}), ValueError);
    CHECK_THROWS_AS((void)merge_joints(body, std::vector<int>{1, 2}), ValueError);
    CHECK_THROWS_AS((void)merge_joints(body, std::vector<int>{0, 2, 1}), ValueError);
    CHECK_THROWS_AS((void)merge_joints(body, std::vector<int>{0, 4}), ValueError);
    Motion motion;
    motion.joint_count = 2;
    motion.pose.resize(2);
    motion.transl.resize(1);
    CHECK_THROWS_AS((void)merge_joints(motion, std::vector<int>{0, 2}), ValueError);
}
