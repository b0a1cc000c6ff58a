// SPDX-License-Identifier: Apache-2.0
/// @file  Sums of weights: all of them, and those of points whose surface a camera does not see from behind.
#include <gsh/avatar/facing_weights.hpp>
#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

using namespace gsh;

namespace {

constexpr double facing_degree = std::numbers::pi / 180;

/// Points that a camera at the origin sees at the distance 2 along z. The normal of each is turned about x from the
/// direction to the camera, by an angle in degrees. Weights are 1, 2, 4, …, so that a sum names its points.
struct FacingScene {
    std::vector<vec3<double>> normals, means, weights;
    std::vector<std::uint16_t> joints;
    std::vector<double> skin_weights, all, front;
    std::vector<Affine<double>> bones = std::vector<Affine<double>>(2);

    explicit FacingScene(const std::vector<double>& angles) {
        for (std::size_t i = 0; i < angles.size(); ++i) {
            normals.emplace_back(0, std::sin(angles[i] * facing_degree), -std::cos(angles[i] * facing_degree));
            means.emplace_back(0, 0, 2);
            weights.emplace_back(std::exp2(static_cast<double>(i)), 100, 100); // red counts
            joints.insert(joints.end(), {0, 1});
            skin_weights.insert(skin_weights.end(), {1, 0});
        }
        all.assign(angles.size(), 0), front = all;
    }
    void add(double behind = 0) {
        const detail::AddFacingWeights<double> element{{joints, skin_weights, 2}, bones,  normals, means, weights,
                                                       vec3<double>(0),           behind, all,     front};
        for (std::size_t i = 0; i < means.size(); ++i) element(i);
    }
    [[nodiscard]] static double sum(const std::vector<double>& values) {
        double total = 0;
        for (const double value : values) total += value;
        return total;
    }
};

} // namespace

TEST_CASE("points that the camera sees from behind count among all, but not in front") {
    FacingScene s({0, 60, 89, 91, 120, 180});
    s.add();
    CHECK(s.all == std::vector<double>{1, 2, 4, 8, 16, 32});
    CHECK(s.front == std::vector<double>{1, 2, 4, 0, 0, 0});
    s.add(); // another photograph
    CHECK(s.all == std::vector<double>{2, 4, 8, 16, 32, 64});
    CHECK(s.front == std::vector<double>{2, 4, 8, 0, 0, 0});
}

TEST_CASE("where behind begins is a cosine, whatever the distance and the normal's length") {
    for (const double size : {1.0, 0.01, 300.0}) {
        CAPTURE(size);
        FacingScene s({0, 59, 61, 119, 121, 180});
        for (auto& normal : s.normals) normal *= size;
        for (auto& mean : s.means) mean /= size;
        s.add(0.5); // 60 degrees
        CHECK(FacingScene::sum(s.front) == 1 + 2);
        s.add(-0.5);
        CHECK(FacingScene::sum(s.front) == 2 * (1 + 2) + 4 + 8);
        s.add(-1.1); // never
        CHECK(FacingScene::sum(s.front) == 3 * (1 + 2) + 2 * (4 + 8) + 16 + 32);
    }
}

TEST_CASE("the camera is seen from where the point is") {
    FacingScene s({0, 0});
    s.means = {{0, 0, 2}, {0, 0, -2}};
    s.add();
    CHECK(s.front == std::vector<double>{1, 0});
}

TEST_CASE("normals turn with the blend of the bones, and do not move with them") {
    FacingScene s({0, 0, 0, 0});
    s.bones[1] = {rotation_from_axis_angle(vec3<double>(0, 100 * facing_degree, 0)), vec3<double>(50, -60, 70)};
    for (std::size_t i = 0; i < 4; ++i) s.joints[2 * i] = 1, s.joints[2 * i + 1] = 0;
    s.skin_weights = {1, 0, 0.6, 0.4, 0.5, 0.5, 1, 0}; // in the middle, the normal turns by half of the angle
    s.normals[3] = transpose(s.bones[1].linear) * s.normals[3];
    s.add();
    CHECK(s.front == std::vector<double>{0, 2, 4, 8});
    s.front.assign(4, 0);
    s.add(0.7); // 45.6 degrees
    CHECK(FacingScene::sum(s.front) == 8);
}

TEST_CASE("a point without a normal has no back, nor has one at the camera; without a weight, a point adds nothing") {
    FacingScene s({180, 180, 0});
    s.normals[0] = vec3<double>(0);
    s.weights[1].x = 0;
    s.means[2] = vec3<double>(0);
    s.add();
    CHECK(s.all == std::vector<double>{1, 0, 4});
    CHECK(s.front == std::vector<double>{1, 0, 4});
}
