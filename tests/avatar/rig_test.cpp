// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/body/posed_body.hpp>

#include "support/gradient.hpp"
#include "support/bodies.hpp"

using namespace gsh;

namespace {

struct Fixture {
    BodyModel body = test::tube(4, 6, 6);
    std::vector<double> betas{0.3, -0.7};
    SurfaceSamples samples;
    RigData data;
    Motion motion;

    Fixture() {
        const auto vertices = shaped_vertices(body, betas);
        samples = sample_surface(body, vertices, std::vector<double>(body.vertex_count(), 1.5), 3);
        data = make_rig(body, betas, samples);
        test::Rng rng(5);
        motion.joint_count = 4;
        motion.expression_count = 2;
        motion.betas = {0.1, 0.4};
        motion.pose = rng.vecs(4);
        motion.expression = {0.5, -0.2};
        motion.transl = {rng.vec()};
        motion.timestamps = {0};
    }
};

} // namespace

TEST_CASE("a rig at rest moves nothing") {
    Fixture f;
    cpu::Serial backend;
    Rig<cpu::Serial, double> rig(backend, f.data);
    Motion rest;
    rest.joint_count = 4;
    rest.pose.assign(4, vec3<double>(0.0));
    rest.transl = {vec3<double>(0.0)};
    RigPose<cpu::Serial, double> pose;
    rig.upload_pose(rest, 0, pose);
    Rig<cpu::Serial, double>::Cache cache;
    rig.forward(pose, f.data.joints, cache);
    auto points = f.samples.positions;
    rig.add_offsets(cache, points);
    for (std::size_t i = 0; i < points.size(); ++i) {
        const auto moved = blend(rig.skin(), i, Span<const Affine<double>>(cache.bones))(points[i]);
        CHECK(length(moved - f.samples.positions[i]) < 1e-12);
    }
}

TEST_CASE("a rig carries surface points as the body model carries its vertices") {
    Fixture f;
    f.motion.betas = f.betas; // samples lie on this shape's mesh, so the model must have the same shape
    cpu::Serial backend;
    // One sample at each vertex, with that vertex's weights.
    SurfaceSamples at_vertices;
    at_vertices.positions = shaped_vertices(f.body, f.betas);
    for (int v = 0; v < static_cast<int>(f.body.vertex_count()); ++v) {
        at_vertices.triangles.push_back({v, v, v});
        at_vertices.barycentric.push_back({1, 0, 0});
    }
    at_vertices.weights = sparse_weights(f.body.weights, 4);
    const RigData data = make_rig(f.body, f.betas, at_vertices);
    Rig<cpu::Serial, double> rig(backend, data);
    RigPose<cpu::Serial, double> pose;
    rig.upload_pose(f.motion, 0, pose);
    Rig<cpu::Serial, double>::Cache cache;
    rig.forward(pose, data.joints, cache);
    auto points = at_vertices.positions;
    rig.add_offsets(cache, points);
    const auto expected =
        pose_body(f.body, f.motion.pose_at(0), f.motion.transl[0], f.motion.betas, f.motion.expression_at(0)).vertices;
    for (std::size_t v = 0; v < points.size(); ++v) {
        const auto moved = blend(rig.skin(), v, Span<const Affine<double>>(cache.bones))(points[v]);
        CHECK(length(moved - expected[v]) < 1e-12);
    }
}

TEST_CASE_TEMPLATE("a prepared pose gives the same bits", B, cpu::Serial, cpu::Threads) {
    Fixture f;
    B backend;
    Rig<B, double> rig(backend, f.data);
    test::Rng rng(11);
    const std::vector<Affine<double>> dL_dbones(4, {mat3<double>(rng.vec(), rng.vec(), rng.vec()), rng.vec()});
    const auto dL_dpoints = rng.vecs(rig.point_count());
    RigPose<B, double> pose;
    typename Rig<B, double>::Cache cache;
    const auto results = [&] {
        rig.forward(pose, f.data.joints, cache);
        auto points = f.samples.positions;
        rig.add_offsets(cache, points);
        std::vector<vec3<double>> dL_djoints(4, vec3<double>(0.0)), dL_dangles = dL_djoints;
        std::vector<double> dL_dcoefficients(rig.coefficient_count(), 0);
        rig.backward(pose, cache, dL_dbones, dL_dpoints, dL_djoints,
                     {.pose = dL_dangles, .coefficients = dL_dcoefficients, .transl = {}});
        std::vector<double> all = dL_dcoefficients;
        for (const auto& bone : cache.bones)
            for (int c = 0; c < 3; ++c) all.insert(all.end(), &bone.linear[c].x, &bone.linear[c].x + 3);
        for (const auto* vectors : {&points, &dL_djoints, &dL_dangles})
            for (const auto& v : *vectors) all.insert(all.end(), {v.x, v.y, v.z});
        return all;
    };
    rig.upload_pose(f.motion, 0, pose);
    const auto expected = results();
    rig.prepare(pose);
    CHECK(rig.prepared_bytes() ==
          sizeof(double) * (9 * 4 + pose.prepared.blend_coefficients.size() + 3 * pose.prepared.vertex_offsets.size()));
    cache = {};
    CHECK(results() == expected);
    CHECK(cache.prepared.empty()); // it was read from the pose

    f.motion.pose[1] = rng.vec(); // another pose: upload_pose forgets the shape of the last one
    rig.upload_pose(f.motion, 0, pose);
    CHECK(pose.prepared.empty());
    CHECK(results() != expected);

    rig.prepare(pose);
    pose.prepared.vertex_offsets.resize(3);
    CHECK_THROWS_AS(rig.forward(pose, f.data.joints, cache), ShapeError);
}

TEST_CASE_TEMPLATE("Rig::backward is the gradient of forward", B, cpu::Serial, cpu::Threads) {
    Fixture f;
    B backend;
    Rig<B, double> rig(backend, f.data);
    const std::size_t N = rig.point_count(), J = 4;
    RigPose<B, double> pose;
    rig.upload_pose(f.motion, 0, pose);
    auto joints = f.data.joints;
    test::Rng rng(9);
    const auto point_weights = rng.vecs(N);
    std::vector<Affine<double>> bone_weights(J);
    for (auto& w : bone_weights) w = {mat3<double>(rng.vec(), rng.vec(), rng.vec()), rng.vec()};
    typename Rig<B, double>::Cache cache;
    const auto loss = [&] {
        rig.forward(pose, joints, cache);
        std::vector<vec3<double>> points(N, vec3<double>(0.0));
        rig.add_offsets(cache, points);
        double sum = 0;
        for (std::size_t i = 0; i < N; ++i) sum += dot(points[i], point_weights[i]);
        for (std::size_t j = 0; j < J; ++j) {
            for (int c = 0; c < 3; ++c) sum += dot(cache.bones[j].linear[c], bone_weights[j].linear[c]);
            sum += dot(cache.bones[j].translation, bone_weights[j].translation);
        }
        return sum;
    };
    loss();
    std::vector<vec3<double>> dL_djoints(J, vec3<double>(0.0)), dL_dangles = dL_djoints,
                                                                dL_dtransl(1, vec3<double>(0.0));
    std::vector<double> dL_dcoefficients(rig.coefficient_count(), 0);
    const RigPoseGradient<double> dL_dpose{dL_dangles, dL_dcoefficients, dL_dtransl};
    rig.backward(pose, cache, bone_weights, point_weights, dL_djoints, dL_dpose);
    const auto numbers = [](auto& buffer) {
        return Span<double>(reinterpret_cast<double*>(buffer.data()),
                            buffer.size() * sizeof(buffer[0]) / sizeof(double));
    };
    test::check_gradient(loss, test::scalars(joints), test::scalars(dL_djoints));
    test::check_gradient(loss, numbers(pose.pose), test::scalars(dL_dangles));
    test::check_gradient(loss, numbers(pose.coefficients), test::scalars(dL_dcoefficients));
    test::check_gradient(loss, numbers(pose.transl), test::scalars(dL_dtransl));

    const auto once = dL_dangles;
    rig.backward(pose, cache, bone_weights, point_weights, dL_djoints, dL_dpose);
    for (std::size_t j = 0; j < J; ++j) CHECK(length(dL_dangles[j] - 2.0 * once[j]) < 1e-12);
}

TEST_CASE("a rig refuses a motion for another skeleton") {
    Fixture f;
    cpu::Serial backend;
    Rig<cpu::Serial, double> rig(backend, f.data);
    RigPose<cpu::Serial, double> pose;
    CHECK_THROWS_AS(rig.upload_pose(f.motion, 1, pose), ValueError);
    f.motion.joint_count = 3;
    CHECK_THROWS_AS(rig.upload_pose(f.motion, 0, pose), ShapeError);
    f.motion.joint_count = 4;
    f.motion.betas = {1, 2, 3};
    CHECK_THROWS_AS(rig.upload_pose(f.motion, 0, pose), ShapeError);
    CHECK_THROWS_AS((void)make_rig(f.body, std::vector<double>{1, 2, 3, 4}, f.samples), ValueError);
}
