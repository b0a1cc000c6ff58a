// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/skinning.hpp>

namespace gsh {
namespace {

TEST_CASE("at rest the body is its shaped mesh, shifted by transl") {
    const BodyModel model = test::tube();
    const std::vector<vec3<double>> rest(4, vec3<double>(0));
    const std::vector<double> betas{0.3, -1, 2}, expression{1, 0.5};
    const auto shaped = shaped_vertices(model, betas, expression);
    const PosedBody body = pose_body(model, rest, {1, 2, 3}, betas, expression);
    for (std::size_t v = 0; v < shaped.size(); ++v)
        CHECK(length(body.vertices[v] - shaped[v] - vec3<double>(1, 2, 3)) < 1e-14);
    const auto joints = regress_joints(model, shaped);
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(body.joints[j] - joints[j] - vec3<double>(1, 2, 3)) < 1e-14);
}

TEST_CASE("two bones, weights one half: the closed form of linear blend skinning") {
    BodyModel model;
    model.v_template = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {1.5, 0.25, 0}};
    model.weights = {1, 0, 0.5, 0.5, 0, 1, 0.25, 0.75};
    model.parents = {-1, 0};
    model.J_regressor = {{{0, 1.0}}, {{1, 1.0}}}; // joints at vertices 0 and 1
    const double a = 0.4, b = -0.9;
    const std::vector<vec3<double>> pose{{0, 0, a}, {0, 0, b}};
    const PosedBody body = pose_body(model, pose, {5, 6, 7});
    const auto turn = [](double angle, vec3<double> p) {
        return vec3<double>(std::cos(angle) * p.x - std::sin(angle) * p.y,
                            std::sin(angle) * p.x + std::cos(angle) * p.y, p.z);
    };
    const vec3<double> elbow = turn(a, {1, 0, 0}), transl(5, 6, 7);
    CHECK(length(body.vertices[0] - transl) < 1e-14);
    CHECK(length(body.vertices[1] - elbow - transl) < 1e-14); // at the joint both bones agree
    CHECK(length(body.vertices[2] - elbow - turn(a + b, {1, 0, 0}) - transl) < 1e-14);
    const vec3<double> upper = turn(a, {1.5, 0.25, 0}), lower = elbow + turn(a + b, {0.5, 0.25, 0});
    CHECK(length(body.vertices[3] - upper * 0.25 - lower * 0.75 - transl) < 1e-14);
    CHECK(length(body.joints[1] - elbow - transl) < 1e-14);
}

TEST_CASE("pose correctives follow R - I, row by row, of the joints after the root") {
    BodyModel model;
    model.v_template = {{0, 0, 0}};
    model.weights = {1, 0};
    model.parents = {-1, 0};
    model.J_regressor = {{{0, 1.0}}, {{0, 1.0}}};
    model.posedirs.assign(9, vec3<double>(0));
    model.posedirs[1] = {1, 0, 0}; // R(0, 1)
    model.posedirs[3] = {0, 1, 0}; // R(1, 0)
    model.posedirs[0] = {0, 0, 1}; // R(0, 0) - 1
    const double angle = 0.5;
    const PosedBody body = pose_body(model, std::vector<vec3<double>>{{0, 0, 0}, {0, 0, angle}});
    CHECK(length(body.vertices[0] - vec3<double>(-std::sin(angle), std::sin(angle), std::cos(angle) - 1)) < 1e-15);
}

TEST_CASE("the backend's components, one after the other, agree with the plain evaluation") {
    const BodyModel model = test::tube();
    validate(model, "tube");
    test::Rng rng(2);
    const std::size_t V = model.vertex_count(), J = 4;
    const auto pose = rng.vecs(J), transl = rng.vecs(1);
    const auto betas = rng.numbers(3), expression = rng.numbers(2);
    const PosedBody expected = pose_body(model, pose, transl[0], betas, expression);

    cpu::Serial backend;
    Skeleton<cpu::Serial, double> skeleton(backend, model.parents);
    const BlendShapes<cpu::Serial, double> detail(backend, V, {model.shapedirs, model.exprdirs, model.posedirs});
    const BlendShapes<cpu::Serial, double> joint_shapes(
        backend, J, {joint_directions(model, model.shapedirs), joint_directions(model, model.exprdirs)});
    std::vector<mat3<double>> rotations(J);
    std::vector<Affine<double>> bones(J);
    std::vector<double> coefficients(5 + 27);
    std::copy(betas.begin(), betas.end(), coefficients.begin());
    std::copy(expression.begin(), expression.end(), coefficients.begin() + 3);
    skeleton.rotations(pose, rotations);
    skeleton.feature(rotations, Span<double>(coefficients).subspan(5, 27));
    auto vertices = model.v_template, joints = regress_joints(model, model.v_template);
    detail.forward(coefficients, vertices);
    joint_shapes.forward(Span<const double>(coefficients).subspan(0, 5), joints);
    skeleton.bones(rotations, joints, transl, bones);
    const auto weights = sparse_weights(model.weights, J);
    for (std::size_t v = 0; v < V; ++v)
        CHECK(length(blend<double>(weights.view(), v, bones)(vertices[v]) - expected.vertices[v]) < 1e-13);
    for (std::size_t j = 0; j < J; ++j) CHECK(length(bones[j](joints[j]) - expected.joints[j]) < 1e-13);
}

TEST_CASE("joints given by hand replace the regressed ones; sizes are checked") {
    const BodyModel model = test::tube();
    test::Rng rng(3);
    const auto pose = rng.vecs(4), joints = rng.vecs(4);
    const PosedBody body = pose_body(model, pose, {}, {}, {}, joints);
    CHECK(length(body.joints[0] - joints[0]) < 1e-14);
    CHECK_THROWS_AS((void)pose_body(model, rng.vecs(3)), ShapeError);
    CHECK_THROWS_AS((void)pose_body(model, pose, {}, {}, {}, rng.vecs(3)), ShapeError);
    CHECK_THROWS_AS((void)pose_body(model, pose, {}, rng.numbers(4)), ShapeError);
    CHECK_THROWS_AS((void)pose_body(model, pose, {}, {}, rng.numbers(3)), ShapeError);
}

} // namespace
} // namespace gsh
