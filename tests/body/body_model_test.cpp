// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/body/body_model.hpp>

#include <limits>

namespace gsh {
namespace {

/// The message of the exception that validate throws after a change to a valid body.
template <class Change>
std::string complaint(Change change) {
    BodyModel model = test::tube();
    model.vt.assign(4, vec2<double>(0));
    model.ft.assign(model.faces.size(), {0, 1, 2});
    change(model);
    try {
        validate(model, "body.npz");
    } catch (const Error& error) {
        return error.what();
    }
    return "";
}

TEST_CASE("a good body passes, with all or none of what is optional") {
    CHECK(complaint([](BodyModel&) {}).empty());
    CHECK(complaint([](BodyModel& m) { m.posedirs.clear(), m.vt.clear(), m.ft.clear(), m.faces.clear(); }).empty());
    CHECK(complaint([](BodyModel& m) {
              m.hands_mean_left.assign(15, vec3<double>(0.1)), m.joint_names.assign(4, "joint");
          }).empty());
}

TEST_CASE("each kind of damage is named") {
    const auto names = [](const std::string& message, const char* words) {
        INFO(message);
        return message.find("body.npz: ") == 0 && message.find(words) != std::string::npos;
    };
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK(names(complaint([](BodyModel& m) { m = BodyModel(); }), "v_template is empty"));
    CHECK(names(complaint([](BodyModel& m) { m.parents.clear(); }), "kinematic tree is empty"));
    CHECK(names(complaint([](BodyModel& m) { m.shape_count = -1; }), "negative"));
    CHECK(names(complaint([](BodyModel& m) { m.shape_count = 4; }), "shapedirs has"));
    CHECK(names(complaint([](BodyModel& m) { m.exprdirs.pop_back(); }), "exprdirs has"));
    CHECK(names(complaint([](BodyModel& m) { m.posedirs.pop_back(); }), "posedirs has"));
    CHECK(names(complaint([](BodyModel& m) { m.weights.pop_back(); }), "weights has"));
    CHECK(names(complaint([](BodyModel& m) { m.J_regressor.pop_back(); }), "J_regressor has"));
    CHECK(names(complaint([](BodyModel& m) { m.v_template[3].y = nan; }), "v_template[10] is nan"));
    CHECK(names(complaint([](BodyModel& m) { m.shapedirs[0].x = nan; }), "shapedirs[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.exprdirs[0].x = nan; }), "exprdirs[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.posedirs[0].x = nan; }), "posedirs[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.weights[5] = nan; }), "weights[5]"));
    CHECK(names(complaint([](BodyModel& m) { m.weights[0] += 0.01; }), "weights of vertex 0 sum to 1.01"));
    CHECK(names(complaint([](BodyModel& m) { m.weights[4] -= 2, m.weights[5] += 2; }), "no negative number"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {-1, 2, 1, 2}; }), "cycle"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {-1, 1, 1, 2}; }), "joint 1 lies on a cycle"));
    CHECK(names(complaint([](BodyModel& m) { m.v_template[2].y = -1e31; }), "v_template[7] is -1e+31"));
    CHECK(names(complaint([](BodyModel& m) { m.shapedirs[0].x = 1e31; }), "shapedirs[0] is 1e+31"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {-1, 3, 1, 0}; }), "joint 1 comes before its parent 3"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {-1, 0, -1, 2}; }), "second root"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {1, -1, 1, 2}; }), "first joint must be the root"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {-1, 0, 9, 2}; }), "joint 2 has parent 9"));
    CHECK(names(complaint([](BodyModel& m) { m.parents = {2, 0, 9, 2}; }), "joint 2 has parent 9"));
    CHECK(names(complaint([](BodyModel& m) { m.J_regressor[2][0].vertex = -1; }), "J_regressor row 2"));
    CHECK(names(complaint([](BodyModel& m) { m.J_regressor[1][0].weight = nan; }), "J_regressor row 1"));
    CHECK(names(complaint([](BodyModel& m) { m.J_regressor[1].clear(); }), "sums to 0"));
    CHECK(names(complaint([](BodyModel& m) { m.faces[7][2] = 100000; }), "f[23] is 100000"));
    CHECK(names(complaint([](BodyModel& m) { m.faces[7][2] = -1; }), "f[23] is -1"));
    CHECK(names(complaint([](BodyModel& m) { m.ft.pop_back(); }), "ft has"));
    CHECK(names(complaint([](BodyModel& m) { m.ft[0][1] = 4; }), "ft[1] is 4"));
    CHECK(names(complaint([](BodyModel& m) { m.joint_names.assign(3, ""); }), "joint_names has"));
    CHECK(names(complaint([](BodyModel& m) { m.hands_mean_left.assign(3, {}); }), "hands_mean has"));
    CHECK(names(
        complaint([](BodyModel& m) { m.hands_mean_right.assign(15, vec3<double>(0)), m.hands_mean_right[0].x = nan; }),
        "hands_mean[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.hands_components_left.assign(46, 0); }), "hands_components has"));
    CHECK(names(
        complaint([](BodyModel& m) { m.hands_components_right.assign(45, 0), m.hands_components_right[0] = nan; }),
        "hands_components[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.face_vertices = {0, 100000}; }), "face_vertices[1]"));
    CHECK(names(complaint([](BodyModel& m) { m.left_hand_vertices = {-1}; }), "left_hand_vertices[0]"));
    CHECK(names(complaint([](BodyModel& m) { m.right_hand_vertices = {100000}; }), "right_hand_vertices[0]"));
}

TEST_CASE("shape and expression are linear, and regression follows them") {
    const BodyModel model = test::tube();
    const std::vector<double> betas{0.5, -2, 1}, expression{1.5, -1};
    const auto shaped = shaped_vertices(model, betas, expression);
    for (std::size_t v = 0; v < model.vertex_count(); ++v) {
        auto expected = model.v_template[v];
        for (std::size_t k = 0; k < 3; ++k) expected += model.shapedirs[3 * v + k] * betas[k];
        for (std::size_t k = 0; k < 2; ++k) expected += model.exprdirs[2 * v + k] * expression[k];
        CHECK(length(shaped[v] - expected) < 1e-15);
    }
    const auto joints = regress_joints(model, shaped), rest = regress_joints(model, model.v_template);
    const auto by_shape = joint_directions(model, model.shapedirs),
               by_expression = joint_directions(model, model.exprdirs);
    for (std::size_t j = 0; j < 4; ++j) {
        auto expected = rest[j];
        for (std::size_t k = 0; k < 3; ++k) expected += by_shape[3 * j + k] * betas[k];
        for (std::size_t k = 0; k < 2; ++k) expected += by_expression[2 * j + k] * expression[k];
        CHECK(length(joints[j] - expected) < 1e-15);
    }
    const auto two = shaped_vertices(model, std::vector<double>{0.5, -2}); // the third counts as zero
    CHECK(length(two[0] - model.v_template[0] - model.shapedirs[0] * 0.5 + model.shapedirs[1] * 2.0) < 1e-15);
    CHECK_THROWS_AS((void)shaped_vertices(model, std::vector<double>(4)), ShapeError);
    CHECK_THROWS_AS((void)shaped_vertices(model, {}, std::vector<double>(3)), ShapeError);
    CHECK_THROWS_AS((void)regress_joints(model, std::vector<vec3<double>>(3)), ShapeError);
    CHECK_THROWS_AS((void)joint_directions(model, std::vector<vec3<double>>(model.vertex_count() + 1)), ShapeError);
}

} // namespace
} // namespace gsh
