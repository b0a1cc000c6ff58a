// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"

#include <gsh/body/skinning.hpp>

#include <cmath>
#include <limits>

namespace gsh {
namespace {

constexpr std::size_t joint_count = 9, point_count = 40;

std::vector<double> dense_weights(std::uint64_t seed) {
    test::Rng rng(seed);
    std::vector<double> dense(point_count * joint_count, 0);
    for (std::size_t i = 0; i < point_count; ++i) {
        const std::size_t used = 1 + i % 5;
        double sum = 0;
        for (std::size_t k = 0; k < used; ++k)
            sum += dense[i * joint_count + (i + 2 * k) % joint_count] = rng.uniform(0.1, 1);
        for (std::size_t j = 0; j < joint_count; ++j) dense[i * joint_count + j] /= sum;
    }
    return dense;
}

std::vector<Affine<double>> random_maps(std::size_t count, std::uint64_t seed) {
    test::Rng rng(seed);
    std::vector<Affine<double>> maps(count);
    for (double& x : test::scalars(maps)) x = rng.uniform(-1, 1);
    return maps;
}

TEST_CASE("sparse weights blend as the dense matrix does") {
    const auto dense = dense_weights(1);
    const auto table = sparse_weights(dense, joint_count);
    const auto bones = random_maps(joint_count, 2);
    CHECK(table.influences == 5);
    CHECK(table.size() == point_count);
    for (std::size_t i = 0; i < point_count; ++i) {
        Affine<double> expected = Affine<double>::zero();
        for (std::size_t j = 0; j < joint_count; ++j) expected.add_scaled(bones[j], dense[i * joint_count + j]);
        const Affine<double> found = blend<double>(table.view(), i, bones);
        CHECK(length(found.translation - expected.translation) < 1e-14);
        for (int c = 0; c < 3; ++c) CHECK(length(found.linear[c] - expected.linear[c]) < 1e-14);
    }
}

TEST_CASE("weights are sorted and sum to one in the scalar type, also when influences are dropped") {
    const auto check = [](const auto& table) {
        using T = typename std::remove_cvref_t<decltype(table.weights)>::value_type;
        for (std::size_t i = 0; i < table.size(); ++i) {
            T sum = 0;
            for (std::size_t k = 0; k < table.influences; ++k) {
                sum += table.weights[i * table.influences + k];
                if (k > 1)
                    CHECK(table.weights[i * table.influences + k] <= table.weights[i * table.influences + k - 1]);
            }
            CHECK(std::abs(sum - T(1)) <= 2 * std::numeric_limits<T>::epsilon());
        }
    };
    for (std::size_t most : {0, 1, 3}) {
        const auto table = sparse_weights(dense_weights(3), joint_count, most);
        CHECK(table.influences == (most ? most : 5));
        check(table);
        check(table.template cast<float>());
    }
}

TEST_CASE("equal bones blend to themselves") {
    const auto table = sparse_weights(dense_weights(4), joint_count);
    const std::vector<Affine<double>> bones(joint_count, random_maps(1, 5)[0]);
    for (std::size_t i = 0; i < point_count; ++i)
        CHECK(length(blend<double>(table.view(), i, bones).translation - bones[0].translation) < 1e-15);
}

TEST_CASE("dual quaternions blend on the side of the heaviest bone, and the adjoint keeps their signs") {
    const auto table = sparse_weights(dense_weights(6), joint_count);
    test::Rng rng(7);
    std::vector<dual_quat<double>> bones(joint_count), dL_dblended(point_count), flipped;
    for (double& x : test::scalars(bones)) x = rng.uniform(-1, 1);
    for (double& x : test::scalars(dL_dblended)) x = rng.uniform(-1, 1);
    flipped = bones;
    for (std::size_t j = 0; j < joint_count; j += 2) {
        flipped[j] = dual_quat<double>::zero();
        flipped[j].add_scaled(bones[j], -1);
    }
    std::vector<dual_quat<double>> dL_dbones(joint_count, dual_quat<double>::zero());
    int turned = 0;
    for (std::size_t i = 0; i < point_count; ++i) {
        const auto found = blend<double>(table.view(), i, bones), other = blend<double>(table.view(), i, flipped);
        const std::size_t first = i * table.influences;
        const bool heaviest_flipped = table.joints[first] % 2 == 0;
        CHECK(std::abs(found.real.x - (heaviest_flipped ? -other.real.x : other.real.x)) < 1e-15);
        CHECK(std::abs(found.dual.w - (heaviest_flipped ? -other.dual.w : other.dual.w)) < 1e-15);
        CHECK(dot(found.real, bones[table.joints[first]].real) > 0);
        for (std::size_t k = first; k < first + table.influences && table.weights[k] > 0; ++k)
            turned += blend_weight<double>(bones, table.joints[first], table.joints[k], 1.0) < 0;
        blend_backward<double>(table.view(), i, bones, dL_dblended[i], dL_dbones);
    }
    CHECK(turned > 20);
    const auto loss = [&] {
        double sum = 0;
        for (std::size_t i = 0; i < point_count; ++i) {
            const auto b = blend<double>(table.view(), i, bones);
            sum += dot(b.real, dL_dblended[i].real) + dot(b.dual, dL_dblended[i].dual);
        }
        return sum;
    };
    test::check_gradient(loss, test::scalars(bones), test::scalars(dL_dbones));
}

TEST_CASE("blend_backward is the gradient of blend, and adds") {
    const auto table = sparse_weights(dense_weights(6), joint_count);
    auto bones = random_maps(joint_count, 7);
    const auto dL_dblended = random_maps(point_count, 8);
    const auto loss = [&] {
        double sum = 0;
        for (std::size_t i = 0; i < point_count; ++i) {
            const Affine<double> m = blend<double>(table.view(), i, bones);
            for (int c = 0; c < 3; ++c) sum += dot(m.linear[c], dL_dblended[i].linear[c]);
            sum += dot(m.translation, dL_dblended[i].translation);
        }
        return sum;
    };
    std::vector<Affine<double>> dL_dbones(joint_count, Affine<double>::zero());
    const auto backward = [&] {
        for (std::size_t i = 0; i < point_count; ++i)
            blend_backward<double>(table.view(), i, bones, dL_dblended[i], dL_dbones);
    };
    backward();
    test::check_gradient(loss, test::scalars(bones), test::scalars(dL_dbones));
    const auto once = dL_dbones;
    backward();
    for (std::size_t j = 0; j < joint_count; ++j)
        CHECK(length(dL_dbones[j].translation - once[j].translation * 2.0) < 1e-12);
}

TEST_CASE("bad weights are refused") {
    CHECK_THROWS_AS((void)sparse_weights(std::vector<double>(7, 0.5), 2), ShapeError);
    CHECK_THROWS_AS((void)sparse_weights(std::vector<double>{1, 0, 0, 0}, 2), ValueError);
    CHECK(sparse_weights({}, 4).size() == 0);
    const auto table = sparse_weights(std::vector<double>{1, 0, 0.5, 0.5}, 2);
    CHECK_NOTHROW(check_skin("here", table.view(), 2));
    CHECK_THROWS_AS(check_skin("here", table.view(), 3), ShapeError);
    CHECK_THROWS_AS(check_skin("here", SkinWeights<double>{{}, table.weights, 2}, 2), ShapeError);
}

} // namespace
} // namespace gsh
