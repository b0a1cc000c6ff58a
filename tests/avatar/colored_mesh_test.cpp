// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar as a coloured mesh: where its vertices lie, what moves them, and which colours they take.
#include <gsh/avatar/colored_mesh.hpp>

#include "io/temporary.hpp"
#include "support/tube_avatar.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using MeshFaces = std::vector<std::array<int, 3>>;

const MeshFaces tetrahedron{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};

double enclosed_volume(const detail::DivisibleMesh& mesh) {
    double sum = 0;
    for (const auto& [a, b, c] : mesh.faces()) {
        const auto at = [&](int v) { return mesh.position(static_cast<std::size_t>(v)); };
        sum += dot(at(a), cross(at(b), at(c))) / 6;
    }
    return sum;
}

double largest_distance(const std::vector<vec3<double>>& a, const std::vector<vec3<double>>& b) {
    double largest = a.size() == b.size() ? 0 : HUGE_VAL;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) largest = std::max(largest, length(a[i] - b[i]));
    return largest;
}

} // namespace

TEST_CASE("the mesh lies where the Gaussians are and has their colours") {
    const AvatarData avatar = test::tube_avatar();
    const ColoredMesh mesh = colored_mesh(avatar);
    REQUIRE(mesh.vertices.size() >= avatar.rig.body.vertex_count());
    std::size_t checked = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const vec3<double>& p = mesh.vertices[v];
        float sum = 0;
        for (const float weight : mesh.weights[v]) sum += weight;
        CHECK(sum == doctest::Approx(1));
        if (p.y < 0.3 || p.y > 1.3) continue; // off the caps
        ++checked;
        const double radius = std::hypot(p.x, p.z);
        CHECK(radius > 0.185); // the tube has 0.2 at its corners and 0.185 in the middle of its sides
        CHECK(radius < 0.235);
        if (std::abs(p.x) < 0.1) continue;
        CHECK(mesh.colors[v].x == doctest::Approx(p.x > 0 ? 1 : 0).epsilon(0.02));
        CHECK(mesh.colors[v].z == doctest::Approx(p.x > 0 ? 0 : 1).epsilon(0.02));
        CHECK(dot(mesh.normals[v], normalize(vec3<double>(p.x, 0, p.z))) > 0.8);
    }
    CHECK(checked > 50);
}

TEST_CASE("a divided triangle is four that face the same way, and its edges' middles are shared means of all numbers") {
    const std::vector<double> rows{0, 0, 0, 10, 1, 0, 0, 20, 0, 1, 0, 40, 0, 0, 1, 80};
    detail::DivisibleMesh mesh(tetrahedron, rows, 4);
    REQUIRE(enclosed_volume(mesh) == doctest::Approx(1.0 / 6));
    mesh.divide();
    CHECK(mesh.size() == 4 + 6); // a vertex for each edge
    CHECK(mesh.faces().size() == 16);
    CHECK(enclosed_volume(mesh) == doctest::Approx(1.0 / 6));
    for (std::size_t v = 0; v < 4; ++v) CHECK(mesh.row(v)[3] == rows[4 * v + 3]); // what was there stays
    for (std::size_t v = 4; v < 10; ++v) {
        const vec3<double> p = mesh.position(v);
        CHECK(mesh.row(v)[3] == doctest::Approx(10 + 10 * p.x + 30 * p.y + 70 * p.z)); // linear in the corners' numbers
        int halves = 0;
        for (int k = 0; k < 3; ++k) halves += p[k] == 0.5, CHECK((p[k] == 0 || p[k] == 0.5));
        CHECK((halves == 1 || halves == 2)); // from the corner at zero, or between two others
    }
    mesh.divide();
    CHECK(mesh.size() == 10 + 24);
    CHECK(mesh.faces().size() == 64);
    CHECK(enclosed_volume(mesh) == doctest::Approx(1.0 / 6));
}

TEST_CASE("triangles are divided while Gaussians outnumber vertices two to one, at most as often as allowed") {
    const BodyModel body = test::tube(4, 8, 8);
    const std::vector<vec3<double>> vertices = shaped_vertices(body, {});
    const std::size_t V = body.vertex_count(), F = body.faces.size(), divided = V + F * 3 / 2;
    const auto size = [&](std::size_t gaussians, int most_levels) {
        return detail::divided_body(body, vertices, vertices, gaussians, most_levels).size();
    };
    CHECK(size(0, 2) == V);
    CHECK(size(2 * V, 2) == V);
    CHECK(size(2 * V + 1, 2) == divided);
    CHECK(size(2 * V + 1, 0) == V);
    CHECK(size(2 * divided, 9) == divided);
    CHECK(size(2 * divided + 1, 2) == divided + 4 * F * 3 / 2);
    CHECK(size(2 * divided + 1, 1) == divided);
}

TEST_CASE("a smoothed value is the mean of itself and its neighbours") {
    const MeshFaces triangle{{0, 1, 2}};
    std::vector<vec3<double>> values{{0, 3, 1}, {1, 3, 1}, {5, 6, 1}, {7, 8, 9}}; // the last has no neighbour
    auto smoothed = values;
    detail::smooth(smoothed, triangle, 0);
    CHECK(smoothed == values);
    detail::smooth(smoothed, triangle, 1);
    for (std::size_t v = 0; v < 3; ++v) CHECK(length(smoothed[v] - vec3<double>(2, 4, 1)) < 1e-12);
    CHECK(smoothed[3] == values[3]);

    // Two triangles: their outer corners do not see each other but in the second round.
    const MeshFaces strip{{0, 1, 2}, {2, 1, 3}};
    std::vector<vec3<double>> corner{{12, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    detail::smooth(corner, strip, 1);
    CHECK(corner[0].x == doctest::Approx(4));
    CHECK(corner[1].x > 0);
    CHECK(corner[3].x == 0);
    detail::smooth(corner, strip, 1);
    CHECK(corner[3].x > 0);
}

TEST_CASE("a vertex has the four largest of its weights, which are made to sum to 1") {
    ColoredMesh mesh;
    detail::add_influences(mesh, std::vector<double>{0.1, 0.3, 0, 0.15, 0.05, 0.4});
    detail::add_influences(mesh, std::vector<double>{0, 0, 0.25, 0.75, 0, 0});
    detail::add_influences(mesh, std::vector<double>{1});
    REQUIRE((mesh.joints.size() == 3 && mesh.weights.size() == 3));
    CHECK(mesh.joints[0] == std::array<std::uint16_t, 4>{5, 1, 3, 0});
    CHECK(mesh.joints[1] == std::array<std::uint16_t, 4>{3, 2, 0, 0});
    CHECK(mesh.joints[2] == std::array<std::uint16_t, 4>{0, 0, 0, 0});
    CHECK(mesh.weights[1] == std::array<float, 4>{0.75f, 0.25f, 0, 0});
    CHECK(mesh.weights[2] == std::array<float, 4>{1, 0, 0, 0});
    const double expected[] = {0.4, 0.3, 0.15, 0.1};
    for (std::size_t k = 0; k < 4; ++k) CHECK(mesh.weights[0][k] == doctest::Approx(expected[k] / 0.95));
}

TEST_CASE("a vertex follows its Gaussians by the mean of their offsets, up to a limit") {
    AvatarData avatar = test::tube_avatar(4);
    const BodyModel& body = avatar.rig.body;
    const std::vector<vec3<double>> rest = shaped_vertices(body, avatar.rig.betas);
    const auto moved_by = [&](const vec3<double>& offset, const ColoredMeshParams& params) {
        for (std::size_t i = 0; i < avatar.gaussians.size(); ++i) {
            vec3<double> attached(0);
            for (std::size_t k = 0; k < 3; ++k)
                attached += rest[static_cast<std::size_t>(avatar.rig.triangles[i][k])] *
                            avatar.rig.barycentric[i][static_cast<int>(k)];
            avatar.gaussians.means[i] = vec3<float>(attached + offset);
        }
        auto vertices = colored_mesh(avatar, {}, params).vertices;
        for (std::size_t v = 0; v < vertices.size(); ++v) vertices[v] -= rest[v];
        return vertices;
    };
    const auto all = [&](const vec3<double>& offset) { return std::vector<vec3<double>>(rest.size(), offset); };
    const vec3<double> offset(0.03, -0.01, 0.02), far(0.3, 0, -0.4);
    for (const std::size_t near : {1, 3, 12, 1'000'000}) {
        CAPTURE(near);
        const ColoredMeshParams params{.most_levels = 0, .near = near};
        CHECK(largest_distance(moved_by(offset, params), all(offset)) < 1e-6);
        CHECK(largest_distance(moved_by(far, params), all(far * (0.08 / 0.5))) < 1e-6);
    }
    CHECK(largest_distance(moved_by(far, {.most_levels = 0, .most_offset = 1}), all(far)) < 1e-6);
}

TEST_CASE("displacements are smoothed over the mesh") {
    AvatarData avatar = test::tube_avatar(4);
    test::Rng rng(7);
    for (auto& mean : avatar.gaussians.means) mean += vec3<float>(rng.vec(-0.02, 0.02));
    const std::vector<vec3<double>> rest = shaped_vertices(avatar.rig.body, avatar.rig.betas);
    const auto offsets = [&](int smoothing) {
        auto vertices = colored_mesh(avatar, {}, {.most_levels = 0, .smoothing = smoothing}).vertices;
        for (std::size_t v = 0; v < vertices.size(); ++v) vertices[v] -= rest[v];
        return vertices;
    };
    auto expected = offsets(0);
    detail::smooth(expected, avatar.rig.body.faces, 3);
    CHECK(largest_distance(offsets(3), expected) < 1e-12);
    CHECK(largest_distance(offsets(0), expected) > 1e-3);
}

TEST_CASE("of the Gaussians around a vertex, near ones count more, and the middle one an e-th of its opacity") {
    AvatarData avatar = test::tube_avatar(4);
    const std::vector<vec3<double>> rest = shaped_vertices(avatar.rig.body, avatar.rig.betas);
    for (std::size_t i = 0; i < avatar.gaussians.size(); ++i) { // a Gaussian is where it is attached
        avatar.gaussians.means[i] = vec3<float>(0);
        for (std::size_t k = 0; k < 3; ++k)
            avatar.gaussians.means[i] += vec3<float>(rest[static_cast<std::size_t>(avatar.rig.triangles[i][k])] *
                                                     avatar.rig.barycentric[i][static_cast<int>(k)]);
    }
    const auto mesh = detail::divided_body(avatar.rig.body, rest, rest, 0, 0);
    for (const std::size_t near : {1, 2, 9}) {
        CAPTURE(near);
        const auto shares = detail::vertex_shares(mesh, avatar.rig, avatar.gaussians, rest, {.near = near});
        REQUIRE(shares.gaussians.size() == mesh.size());
        for (std::size_t v = 0; v < mesh.size(); ++v) {
            const auto distance = [&](std::size_t i) {
                return length(vec3<double>(avatar.gaussians.means[i]) - mesh.position(v));
            };
            std::vector<std::pair<double, double>> by_distance; // and their weights
            for (const auto& [weight, i] : shares.gaussians[v]) by_distance.push_back({distance(i), weight});
            std::sort(by_distance.begin(), by_distance.end());
            REQUIRE(by_distance.size() == near);
            for (std::size_t k = 1; k < near; ++k) CHECK(by_distance[k].second <= by_distance[k - 1].second);
            CHECK(by_distance[near / 2].second == doctest::Approx(sigmoid(3.0) * std::exp(-1)));
            std::size_t nearer = 0; // than the farthest of them
            for (std::size_t i = 0; i < avatar.gaussians.size(); ++i)
                nearer += distance(i) < by_distance.back().first - 1e-6;
            CHECK(nearer < near);
        }
    }
}

TEST_CASE("opaque Gaussians count more than transparent ones, for places and colours") {
    AvatarData avatar = test::tube_avatar(6);
    const ColoredMesh before = colored_mesh(avatar, {}, {.most_levels = 0});
    AvatarData both = avatar; // each Gaussian has a green companion 3 cm above it that is almost transparent
    const std::size_t N = avatar.gaussians.size();
    both.rig.triangles.insert(both.rig.triangles.end(), avatar.rig.triangles.begin(), avatar.rig.triangles.end());
    both.rig.barycentric.insert(both.rig.barycentric.end(), avatar.rig.barycentric.begin(),
                                avatar.rig.barycentric.end());
    both.gaussians.resize(2 * N, 1);
    for (std::size_t i = 0; i < 2 * N; ++i) {
        both.gaussians.means[i] = avatar.gaussians.means[i % N] + vec3<float>(0, i < N ? 0.0f : 0.03f, 0);
        both.gaussians.opacity_logits[i] = i < N ? 3.0f : -12.0f;
        for (std::size_t k = 0; k < 4; ++k) both.gaussians.sh[4 * i + k] = avatar.gaussians.sh[4 * (i % N) + k];
        if (i >= N) both.gaussians.sh[4 * i] = sh_of_color(vec3<float>(0, 1, 0));
    }
    const ColoredMesh after = colored_mesh(both, {}, {.most_levels = 0, .near = 24});
    CHECK(largest_distance(after.vertices, before.vertices) < 1e-4);
    for (std::size_t v = 0; v < before.colors.size(); ++v) CHECK(length(after.colors[v] - before.colors[v]) < 1e-4f);
}

TEST_CASE("a colour is the one that is seen from outside, along the normal, within [0, 1], and shaded") {
    AvatarData avatar = test::tube_avatar(4);
    test::Rng rng(5);
    std::vector<vec3<float>> sh;
    for (int k = 0; k < 4; ++k) sh.push_back(vec3<float>(rng.vec(-0.4, 0.4)));
    sh[0].z = 9; // far beyond white
    for (std::size_t i = 0; i < avatar.gaussians.sh.size(); ++i) avatar.gaussians.sh[i] = sh[i % 4];
    const auto check_colors = [&](float factor) {
        const ColoredMesh mesh = colored_mesh(avatar, {}, {.most_levels = 0});
        vec3<float> low(1), high(0);
        for (std::size_t v = 0; v < mesh.colors.size(); ++v) {
            const vec3<float> color = SHEval<1>::forward(sh.data(), -vec3<float>(mesh.normals[v])) + vec3<float>(0.5f);
            CHECK(length(mesh.colors[v] - glm::clamp(color * factor, 0.0f, 1.0f)) < 1e-5f);
            low = glm::min(low, mesh.colors[v]), high = glm::max(high, mesh.colors[v]);
        }
        CHECK(high.x - low.x > 0.1f); // it depends on the view
        CHECK(low.z == doctest::Approx(1));
    };
    check_colors(1);
    avatar.ao.assign(avatar.gaussians.size(), 0.5f);
    check_colors(0.5f);
}

TEST_CASE("betas move vertices and joints as they move the body, and leave the colours") {
    AvatarData avatar = test::tube_avatar(2);
    const BodyModel& body = avatar.rig.body;
    avatar.rig.joints[2] += vec3<double>(0.01, 0.02, 0.03); // after training
    test::Rng rng(8);
    for (std::size_t i = 0; i < avatar.gaussians.sh.size(); ++i) // depends on the view, in the avatar's own shape
        if (i % 4) avatar.gaussians.sh[i] = vec3<float>(rng.vec(-0.5, 0.5));
    const ColoredMesh own = colored_mesh(avatar), same = colored_mesh(avatar, avatar.rig.betas);
    CHECK(own.vertices == same.vertices);
    CHECK(own.rest_joints == avatar.rig.joints);
    const std::vector<double> betas{2};
    const ColoredMesh other = colored_mesh(avatar, betas);
    const auto was = shaped_vertices(body, avatar.rig.betas), is = shaped_vertices(body, betas);
    REQUIRE(other.vertices.size() == body.vertex_count());
    auto expected = own.vertices;
    for (std::size_t v = 0; v < expected.size(); ++v) expected[v] += is[v] - was[v];
    CHECK(largest_distance(other.vertices, expected) < 1e-12);
    CHECK(largest_distance(other.vertices, own.vertices) > 0.01);
    CHECK(other.colors == own.colors);
    CHECK(other.normals == vertex_normals(other.vertices, other.faces));
    auto joints = avatar.rig.joints;
    const auto joints_were = regress_joints(body, was), joints_are = regress_joints(body, is);
    for (std::size_t j = 0; j < joints.size(); ++j) joints[j] += joints_are[j] - joints_were[j];
    CHECK(largest_distance(other.rest_joints, joints) < 1e-12);

    // Weights and expressions are the body's.
    for (std::size_t v = 0; v < body.vertex_count(); ++v)
        for (std::size_t k = 0; k < 4; ++k)
            if (own.weights[v][k] > 0)
                CHECK(own.weights[v][k] == doctest::Approx(body.weights[4 * v + own.joints[v][k]]));
    REQUIRE(own.expressions.size() == 2);
    for (std::size_t e = 0; e < 2; ++e) {
        REQUIRE(own.expressions[e].size() == body.vertex_count());
        for (std::size_t v = 0; v < body.vertex_count(); ++v)
            CHECK(own.expressions[e][v] == vec3<float>(body.exprdirs[2 * v + e]));
    }
}

TEST_CASE("bodies without triangles, avatars without Gaussians and too many betas are refused") {
    AvatarData avatar = test::tube_avatar(1);
    const std::vector<double> betas{0, 0, 0};
    test::check_throws<ShapeError>([&] { (void)colored_mesh(avatar, betas); }, {"betas", "3", "2"});
    AvatarData none = avatar;
    none.gaussians = {};
    test::check_throws<ValueError>([&] { (void)colored_mesh(none); }, {"colored_mesh: the avatar has no Gaussians"});
    avatar.rig.body.faces.clear();
    test::check_throws<ValueError>([&] { (void)colored_mesh(avatar); }, {"colored_mesh: the body has no triangles"});
}
