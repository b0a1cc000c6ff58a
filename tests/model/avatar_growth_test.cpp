// SPDX-License-Identifier: Apache-2.0
/// A finer model goes on from what a coarser one has learned, and stored colours from what a field gave.
#include <gsh/cpu.hpp>
#include <gsh/model/avatar_growth.hpp>
#include <gsh/model/configured_avatar.hpp>

#include "support/bodies.hpp"
#include "support/learned.hpp"

#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using Model = ConfiguredAvatar<cpu::Serial, float, 2>;

/// A tube at two strides, with small fields.
struct Tube {
    cpu::Serial backend;
    BodyModel body = test::tube(4, 6, 6);
    SurfaceSamples all = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 4.0), 3);
    RigData rig = make_rig(body, {}, all);
    CanonicalPriors priors{.region = std::vector<double>(all.size(), 0.5),
                           .features = std::vector<double>(2 * all.size(), 0.25)};

    Model make(std::size_t stride, const std::string& appearance = "shared_field") {
        ConfiguredAvatarParams config;
        config.appearance_type = appearance;
        config.appearance.field = {.grid = {.base = 3, .table_size = 128}, .width = 8, .hidden_layers = 1};
        config.appearance.fine_level = 1;
        return make_avatar<cpu::Serial, AvatarParts, float, 3, 2, 2>(
            backend, thinned(rig, stride), thinned(all, stride), 1, 7, config, thinned(priors, all.positions, stride));
    }
    /// Splats of the rest pose.
    Splats<cpu::Serial> posed(Model& model) {
        RigPose<cpu::Serial, float> pose;
        model.rig().upload_pose(rest_motion(rig), 0, pose);
        Splats<cpu::Serial> splats;
        splats.resize(model.size());
        model.update_canonical();
        model.pose(pose, 0, {0, 1, 3}, splats.view());
        return splats;
    }
};

/// Numbers that differ everywhere, in all arrays of a model.
void scramble(Model& model, std::uint64_t seed) {
    test::Rng rng(seed);
    for (const LearnedArray<float>& array : model.learned())
        for (const Span<float>& numbers : {array.values, array.first_moment, array.second_moment})
            for (float& number : numbers) number += static_cast<float>(rng.uniform(0.01, 0.2));
}

} // namespace

TEST_CASE("a model of thinned points has the fields of the model of all: they give a point the same") {
    Tube tube;
    Model all = tube.make(1), part = tube.make(4);
    scramble(all, 1);
    carry_over(tube.backend,
               LearnedArrays<float>{test::learned_array(all, "shared_field.table"),
                                    test::learned_array(all, "shared_field.network")},
               part.learned());
    all.update_canonical(), part.update_canonical();
    const auto a = all.gaussians(), b = part.gaussians();
    REQUIRE(b.sh.size() == part.size() * b.sh_stride);
    for (std::size_t i = 0; i < part.size(); ++i)
        for (std::size_t k = 0; k < a.sh_stride; ++k)
            CHECK(b.sh[i * b.sh_stride + k].x == doctest::Approx(a.sh[4 * i * a.sh_stride + k].x).epsilon(1e-5));
}

TEST_CASE("an untrained model grows to the initial one: covered as before") {
    Tube tube;
    Model part = tube.make(4), all = tube.make(1), initial = tube.make(1);
    scramble(all, 2);
    const PointParents parents(thinned(tube.all, 4), tube.all);
    carry_over(tube.backend, part.learned(), all.learned(), parents);
    const auto made = all.learned(), expected = initial.learned();
    REQUIRE(made.size() == expected.size());
    for (std::size_t n = 0; n < made.size(); ++n) {
        CAPTURE(made[n].name);
        if (made[n].name == "quats") continue; // may be turned about the normal
        for (std::size_t i = 0; i < made[n].values.size(); ++i) {
            CHECK(made[n].values[i] == doctest::Approx(expected[n].values[i]).epsilon(1e-5));
            CHECK(made[n].first_moment[i] == 0);
        }
    }
    const auto quats = all.gaussians().quats;
    for (std::size_t i = 0; i < all.size(); ++i) { // the thin axis is the normal
        const vec3<double> thin(rotation_matrix(normalize(quats[i])) * vec3<float>(0, 0, 1));
        if (dot(tube.all.normals[i], thinned(tube.all, 4).normals[parents.parents[i]]) > -0.5)
            CHECK(std::abs(dot(thin, tube.all.normals[i])) == doctest::Approx(1).epsilon(1e-4));
    }
}

TEST_CASE("a point takes over what its parent has learned, and the moments of its share of the gradient") {
    Tube tube;
    Model part = tube.make(4), all = tube.make(1);
    const SurfaceSamples coarse = thinned(tube.all, 4);
    scramble(part, 3);
    const PointParents parents(coarse, tube.all);
    carry_over(tube.backend, part.learned(), all.learned(), parents);
    const auto &opacity = test::learned_array(part, "opacity_logits"),
               &of_points = test::learned_array(all, "opacity_logits");
    const auto &scales = test::learned_array(part, "log_scales"), &of_all = test::learned_array(all, "log_scales");
    const double share = static_cast<double>(part.size()) / static_cast<double>(all.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
        const std::size_t parent = parents.parents[i];
        double nearest = 1e9;
        for (const auto& p : coarse.positions) nearest = std::min(nearest, length(p - tube.all.positions[i]));
        CHECK(length(coarse.positions[parent] - tube.all.positions[i]) == doctest::Approx(nearest));
        CHECK(of_points.values[i] == opacity.values[parent]);
        CHECK(of_points.first_moment[i] == doctest::Approx(share * opacity.first_moment[parent]));
        CHECK(of_points.second_moment[i] == doctest::Approx(share * share * opacity.second_moment[parent]));
        for (std::size_t k = 0; k < 3; ++k)
            CHECK(of_all.values[3 * i + k] - scales.values[3 * parent + k] ==
                  doctest::Approx(std::log(tube.all.scales[i] / coarse.scales[parent])).epsilon(1e-4));
    }
    // Joints and fields do not depend on the points.
    for (const char* name : {"joints", "shared_field.table", "shared_field.network"}) {
        const auto &a = test::learned_array(part, name), &b = test::learned_array(all, name);
        CHECK(std::vector<float>(a.values.begin(), a.values.end()) ==
              std::vector<float>(b.values.begin(), b.values.end()));
        CHECK(std::vector<float>(a.second_moment.begin(), a.second_moment.end()) ==
              std::vector<float>(b.second_moment.begin(), b.second_moment.end()));
    }
}

TEST_CASE("rotations turn with the normal, and not across something thin") {
    SurfaceSamples coarse, fine;
    coarse.positions = {{0, 0, 0}}, coarse.normals = {{0, 0, 1}}, coarse.scales = {0.02};
    fine.positions = {{0, 0, 0}, {0, 0, 0.1}, {0, 0, -0.1}};
    fine.normals = {{0, 0, 1}, {std::sqrt(0.5), 0, std::sqrt(0.5)}, {0, 0, -1}}, fine.scales = {0.01, 0.01, 0.02};
    const PointParents parents(coarse, fine);
    CHECK(parents.parent_count == 1);
    const auto turned = [&](std::size_t i) { return rotation_matrix(parents.turns[i]) * vec3<double>(0, 0, 1); };
    CHECK(length(turned(0) - fine.normals[0]) < 1e-12);
    CHECK(length(turned(1) - fine.normals[1]) < 1e-12);
    CHECK(length(turned(2) - vec3<double>(0, 0, 1)) < 1e-12);
    CHECK(parents.log_scales[0] == doctest::Approx(std::log(0.5)));
    CHECK(parents.log_scales[2] == doctest::Approx(0));
    // 45 degrees about y, then 90 about z: the product of the quaternions rotates as the product of the matrices.
    const quat<double> z{std::sqrt(0.5), 0, 0, std::sqrt(0.5)};
    const auto both = rotation_matrix(product(z, parents.turns[1])) * vec3<double>(1, 2, 3);
    const auto steps = rotation_matrix(z) * (rotation_matrix(parents.turns[1]) * vec3<double>(1, 2, 3));
    CHECK(length(both - steps) < 1e-12);
    CHECK_THROWS_WITH_AS(PointParents(SurfaceSamples(), fine), doctest::Contains("there are no samples"), ValueError);
}

TEST_CASE("stored colours and displacements give the splats of the field that they come from") {
    Tube tube;
    Model field = tube.make(1), stored = tube.make(1, "stored");
    scramble(field, 4);
    carry_over(tube.backend, field.learned(), stored.learned());
    field.update_canonical();
    store_appearance(tube.backend, field.appearance().view(), 9, stored.learned());
    const auto a = tube.posed(field), b = tube.posed(stored);
    REQUIRE(a.means.size() == b.means.size());
    for (std::size_t i = 0; i < a.means.size(); ++i) {
        CHECK(a.means[i] == b.means[i]);
        CHECK(a.colors[i] == b.colors[i]);
        CHECK(a.opacities[i] == b.opacities[i]);
    }
    for (const float moment : test::learned_array(stored, "sh").first_moment) CHECK(moment == 0);

    store_appearance(tube.backend, field.appearance().view(), 1, stored.learned());
    const auto sh = test::learned_array(stored, "sh").values;
    const auto view = field.appearance().view();
    for (std::size_t i = 0; i < stored.size(); ++i) {
        CHECK(sh[27 * i] == view.sh[i * view.sh_stride].x);
        for (std::size_t k = 3; k < 27; ++k) CHECK(sh[27 * i + k] == 0);
    }
}

TEST_CASE("models that do not fit each other are refused by the name of the array") {
    Tube tube;
    Model part = tube.make(4), all = tube.make(1);
    CHECK_THROWS_WITH_AS(carry_over(tube.backend, part.learned(), all.learned()), doctest::Contains("quats"),
                         ShapeError);
    CHECK_THROWS_WITH_AS(store_appearance(tube.backend, part.appearance().view(), 9, part.learned()),
                         doctest::Contains("the model has no array sh"), ValueError);
    Model stored = tube.make(1, "stored");
    CHECK_THROWS_AS(store_appearance(tube.backend, part.appearance().view(), 9, stored.learned()), ShapeError);
}
