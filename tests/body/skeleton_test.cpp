// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/math/wide.hpp>

#include <cstring>
#include <numbers>

namespace gsh {
namespace {

/// A root with two branches, one of them forked.
const std::vector<int> tree{-1, 0, 1, 0, 3, 3, 5};

struct Case {
    std::vector<vec3<double>> pose, joints, transl;
    std::vector<mat3<double>> rotations;

    explicit Case(std::uint64_t seed, std::size_t count = tree.size()) {
        test::Rng rng(seed);
        pose = rng.vecs(count), joints = rng.vecs(count), transl = rng.vecs(1);
        for (const auto& v : pose) rotations.push_back(rotation_from_axis_angle(v));
    }
};

double inner(const std::vector<Affine<double>>& a, const std::vector<Affine<double>>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
        for (int c = 0; c < 3; ++c) sum += dot(a[i].linear[c], b[i].linear[c]);
        sum += dot(a[i].translation, b[i].translation);
    }
    return sum;
}

TEST_CASE("one joint: the bone turns space about the joint, then shifts it") {
    const std::vector<int> parents{-1};
    const std::vector<vec3<double>> joints{{1, 2, 3}};
    const std::vector<mat3<double>> rotations{rotation_from_axis_angle(vec3<double>(0, 0, std::numbers::pi / 2))};
    std::vector<Affine<double>> bones(1);
    bone_transforms<double>(parents, rotations, joints, vec3<double>(0, 0, 10), bones);
    const auto moved = bones[0](vec3<double>(2, 2, 3)); // one metre from the joint along x, now along y
    CHECK(length(moved - vec3<double>(1, 3, 13)) < 1e-14);
    CHECK(length(bones[0](joints[0]) - vec3<double>(1, 2, 13)) < 1e-14);
}

TEST_CASE("a chain of three in the plane has the closed form of a robot arm") {
    const std::vector<int> parents{-1, 0, 1};
    const double a = 0.3, b = -0.7, c = 1.1;
    const std::vector<vec3<double>> joints{{0, 0, 0}, {2, 0, 0}, {3, 0, 0}};
    std::vector<mat3<double>> rotations;
    for (double angle : {a, b, c}) rotations.push_back(rotation_from_axis_angle(vec3<double>(0, 0, angle)));
    std::vector<Affine<double>> bones(3);
    bone_transforms<double>(parents, rotations, joints, vec3<double>(0), bones);
    const vec3<double> tip = bones[2](vec3<double>(3.5, 0, 0));
    const vec3<double> expected(2 * std::cos(a) + std::cos(a + b) + 0.5 * std::cos(a + b + c),
                                2 * std::sin(a) + std::sin(a + b) + 0.5 * std::sin(a + b + c), 0);
    CHECK(length(tip - expected) < 1e-14);
}

TEST_CASE("bones are the quotient of the posed and the resting chain") {
    const Case c(3);
    std::vector<Affine<double>> bones(tree.size()), posed(tree.size()), rest(tree.size());
    bone_transforms<double>(tree, c.rotations, c.joints, c.transl[0], bones);
    for (std::size_t j = 0; j < tree.size(); ++j) {
        if (j == 0) {
            posed[0] = {c.rotations[0], c.joints[0] + c.transl[0]};
            rest[0] = {mat3<double>(1.0), c.joints[0]};
            continue;
        }
        const auto parent = static_cast<std::size_t>(tree[j]);
        const vec3<double> offset = c.joints[j] - c.joints[parent];
        posed[j] = posed[parent] * Affine<double>{c.rotations[j], offset};
        rest[j] = rest[parent] * Affine<double>{mat3<double>(1.0), offset};
    }
    test::Rng rng(4);
    for (std::size_t j = 0; j < tree.size(); ++j) {
        const vec3<double> x = rng.vec();
        CHECK(length(bones[j](rest[j](x)) - posed[j](x)) < 1e-13);
    }
}

TEST_CASE("the identity pose moves nothing") {
    const Case c(5);
    const std::vector<mat3<double>> identity(tree.size(), mat3<double>(1.0));
    std::vector<Affine<double>> bones(tree.size());
    bone_transforms<double>(tree, identity, c.joints, vec3<double>(0), bones);
    for (const auto& bone : bones) {
        CHECK(length(bone.translation) < 1e-15);
        for (int k = 0; k < 3; ++k) CHECK(bone.linear[k] == mat3<double>(1.0)[k]);
    }
}

TEST_CASE("Skeleton: the adjoint of the whole chain, pose to bones and feature") {
    Case c(7);
    cpu::Serial backend;
    Skeleton<cpu::Serial, double> skeleton(backend, tree);
    test::Rng rng(8);
    const std::size_t J = tree.size();
    std::vector<mat3<double>> R(J), dL_dR(J, mat3<double>(0.0));
    std::vector<Affine<double>> bones(J), dL_dbones(J);
    std::vector<double> feature(9 * (J - 1)), dL_dfeature = rng.numbers(9 * (J - 1));
    for (double& x : test::scalars(dL_dbones)) x = rng.uniform(-1, 1);
    const auto loss = [&] {
        skeleton.rotations(c.pose, R);
        skeleton.feature(R, feature);
        skeleton.bones(R, c.joints, c.transl, bones);
        double sum = inner(bones, dL_dbones);
        for (std::size_t i = 0; i < feature.size(); ++i) sum += feature[i] * dL_dfeature[i];
        return sum;
    };
    std::vector<vec3<double>> dL_dpose(J, vec3<double>(0)), dL_djoints(J, vec3<double>(0)),
        dL_dtransl(1, vec3<double>(0));
    const auto backward = [&] {
        for (auto& m : dL_dR) m = mat3<double>(0.0);
        skeleton.bones_backward(R, c.joints, bones, dL_dbones, dL_dR, dL_djoints, dL_dtransl);
        skeleton.feature_backward(dL_dfeature, dL_dR);
        skeleton.rotations_backward(c.pose, dL_dR, dL_dpose);
    };
    loss();
    backward();
    test::check_gradient(loss, test::scalars(c.pose), test::scalars(dL_dpose));
    test::check_gradient(loss, test::scalars(c.joints), test::scalars(dL_djoints));
    test::check_gradient(loss, test::scalars(c.transl), test::scalars(dL_dtransl));

    const auto once = dL_dpose;
    const auto joints_once = dL_djoints;
    loss();
    backward();
    for (std::size_t j = 0; j < J; ++j) {
        CHECK(dL_dpose[j] == once[j] * 2.0);
        CHECK(dL_djoints[j] == joints_once[j] * 2.0);
    }
}

TEST_CASE("bone_transforms_backward: the nine numbers of a rotation count as independent") {
    Case c(9);
    test::Rng rng(10);
    std::vector<Affine<double>> bones(tree.size()), dL_dbones(tree.size()), scratch(tree.size());
    for (double& x : test::scalars(dL_dbones)) x = rng.uniform(-1, 1);
    for (double& x : test::scalars(c.rotations)) x += rng.uniform(-0.1, 0.1);
    const auto loss = [&] {
        bone_transforms<double>(tree, c.rotations, c.joints, c.transl[0], bones);
        return inner(bones, dL_dbones);
    };
    loss();
    std::vector<mat3<double>> dL_dR(tree.size(), mat3<double>(0.0));
    std::vector<vec3<double>> dL_djoints(tree.size(), vec3<double>(0));
    vec3<double> dL_dtransl(0);
    bone_transforms_backward<double>(tree, c.rotations, c.joints, bones, dL_dbones, dL_dR, dL_djoints, dL_dtransl,
                                     scratch);
    test::check_gradient(loss, test::scalars(c.rotations), test::scalars(dL_dR));
}

TEST_CASE("a register of skeletons equals its lanes") {
    using P = Wide<double>;
    constexpr std::size_t width = LaneTraits<P>::width;
    std::vector<Case> cases;
    for (std::size_t lane = 0; lane < width; ++lane) cases.emplace_back(20 + lane);
    const auto gather = [&](auto number) {
        double lanes[width];
        for (std::size_t lane = 0; lane < width; ++lane) lanes[lane] = number(cases[lane]);
        return P::load(lanes);
    };
    const std::size_t J = tree.size();
    std::vector<mat3<P>> R(J);
    std::vector<vec3<P>> joints(J);
    vec3<P> transl;
    for (int k = 0; k < 3; ++k) {
        transl[k] = gather([&](const Case& c) { return c.transl[0][k]; });
        for (std::size_t j = 0; j < J; ++j) {
            joints[j][k] = gather([&](const Case& c) { return c.joints[j][k]; });
            for (int r = 0; r < 3; ++r) R[j][k][r] = gather([&](const Case& c) { return c.rotations[j][k][r]; });
        }
    }
    std::vector<Affine<P>> bones(J);
    bone_transforms<P>(tree, R, joints, transl, bones);
    for (std::size_t lane = 0; lane < width; ++lane) {
        std::vector<Affine<double>> expected(J);
        bone_transforms<double>(tree, cases[lane].rotations, cases[lane].joints, cases[lane].transl[0], expected);
        for (std::size_t j = 0; j < J; ++j)
            for (int k = 0; k < 3; ++k)
                CHECK(bones[j].translation[k][lane] == doctest::Approx(expected[j].translation[k]));
    }
}

TEST_CASE("Threads equals Serial bit for bit") {
    constexpr std::size_t J = 1300; // more than one chunk of Threads::for_each, so that several threads work
    const Case c(11, J);
    std::vector<int> parents(J);
    for (std::size_t j = 0; j < J; ++j) parents[j] = j == 0 ? -1 : (static_cast<int>(j) - 1) / 2;
    std::vector<Affine<double>> dL_dbones(J);
    test::Rng rng(12);
    for (double& x : test::scalars(dL_dbones)) x = rng.uniform(-1, 1);
    const auto run = [&](auto&& backend) {
        using B = std::remove_reference_t<decltype(backend)>;
        Skeleton<B, double> skeleton(backend, parents);
        std::vector<mat3<double>> R(J), dL_drotations(J, mat3<double>(0.0));
        std::vector<Affine<double>> bones(J);
        std::vector<vec3<double>> dL_djoints(J, vec3<double>(0.0)), dL_dpose = dL_djoints,
                                                                    dL_dtransl(1, vec3<double>(0.0));
        skeleton.rotations(c.pose, R);
        skeleton.bones(R, c.joints, c.transl, bones);
        skeleton.bones_backward(R, c.joints, bones, dL_dbones, dL_drotations, dL_djoints, dL_dtransl);
        skeleton.rotations_backward(c.pose, dL_drotations, dL_dpose);
        std::vector<double> all;
        const auto append = [&](const auto& values) {
            const auto* first = reinterpret_cast<const double*>(values.data());
            all.insert(all.end(), first, first + values.size() * sizeof(values[0]) / sizeof(double));
        };
        append(bones), append(dL_drotations), append(dL_djoints), append(dL_dpose), append(dL_dtransl);
        return all;
    };
    const auto expected = run(cpu::Serial());
    for (std::size_t threads : {1, 2, 3, 7}) {
        const auto found = run(cpu::Threads(threads));
        CHECK(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(expected[0])) == 0);
    }
}

TEST_CASE("Skeleton checks its arguments; an empty one is fine") {
    cpu::Serial backend;
    CHECK_THROWS_AS((Skeleton<cpu::Serial, double>(backend, std::vector<int>{0, -1})), ValueError);
    CHECK_THROWS_AS((Skeleton<cpu::Serial, double>(backend, std::vector<int>{-1, 2, 1})), ValueError);
    Skeleton<cpu::Serial, double> none(backend, std::vector<int>{});
    none.rotations({}, {});
    none.feature({}, {});

    Skeleton<cpu::Serial, double> skeleton(backend, std::vector<int>{-1, 0});
    std::vector<vec3<double>> two(2, vec3<double>(0)), three(3, vec3<double>(0)), one(1, vec3<double>(0));
    std::vector<mat3<double>> R(2), R3(3);
    std::vector<Affine<double>> bones(2), bones3(3);
    std::vector<double> nine(9), eight(8);
    CHECK_THROWS_AS(skeleton.rotations(three, R), ShapeError);
    CHECK_THROWS_AS(skeleton.rotations(two, R3), ShapeError);
    CHECK_THROWS_AS(skeleton.rotations_backward(three, R, two), ShapeError);
    CHECK_THROWS_AS(skeleton.rotations_backward(two, R3, two), ShapeError);
    CHECK_THROWS_AS(skeleton.rotations_backward(two, R, three), ShapeError);
    CHECK_THROWS_AS(skeleton.feature(R3, nine), ShapeError);
    CHECK_THROWS_AS(skeleton.feature(R, eight), ShapeError);
    CHECK_THROWS_AS(skeleton.feature_backward(eight, R), ShapeError);
    CHECK_THROWS_AS(skeleton.feature_backward(nine, R3), ShapeError);
    CHECK_THROWS_AS(skeleton.bones(R3, two, one, bones), ShapeError);
    CHECK_THROWS_AS(skeleton.bones(R, three, one, bones), ShapeError);
    CHECK_THROWS_AS(skeleton.bones(R, two, two, bones), ShapeError);
    CHECK_THROWS_AS(skeleton.bones(R, two, one, bones3), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R3, two, bones, bones, R, two, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, three, bones, bones, R, two, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, two, bones3, bones, R, two, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, two, bones, bones3, R, two, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, two, bones, bones, R3, two, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, two, bones, bones, R, three, one), ShapeError);
    CHECK_THROWS_AS(skeleton.bones_backward(R, two, bones, bones, R, two, two), ShapeError);
}

} // namespace
} // namespace gsh
