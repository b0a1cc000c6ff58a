// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"
#include "support/lit_sphere.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/light/coarse_caster.hpp>
#include <gsh/light/cpu/shadow_map.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/ray_scene.hpp>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <type_traits>

namespace gsh {
namespace {

template <class T>
using LitMesh = test::LitMesh<T>;
using test::sphere;

/// A grid of points at height y, facing up.
LitMesh<float> floor_grid(float y, float half, std::size_t side = 81) {
    LitMesh<float> mesh;
    for (std::size_t i = 0; i < side; ++i)
        for (std::size_t k = 0; k < side; ++k) {
            const auto along = [&](std::size_t n) { return half * (2 * float(n) / float(side - 1) - 1); };
            mesh.vertices.push_back({along(i), y, along(k)});
            mesh.normals.push_back({0, 1, 0});
        }
    return mesh;
}

/// [V, L] visibility of `receiver`.
template <class B, class T>
std::vector<T> visibility(B&& backend, const std::vector<ShadowCaster<T>>& casters, const std::vector<vec3<T>>& points,
                          const std::vector<vec3<T>>& directions, const LitMesh<T>& receiver,
                          const ShadowMapParams& params = {}) {
    using Backend = std::remove_reference_t<B>;
    const ShadowMaps<Backend, T> maps(backend, params);
    typename ShadowMaps<Backend, T>::Cache cache;
    std::vector<T> result(receiver.vertices.size() * (points.size() + directions.size()), T(-1));
    maps.forward(casters, LightView<const T>{.points = points, .directions = directions}, receiver.vertices,
                 receiver.normals, result, cache);
    return result;
}

using Points = std::vector<vec3<float>>;

Points twelve_directions() {
    Points result;
    const float g = std::numbers::phi_v<float>;
    for (const float s : {-1.0f, 1.0f})
        for (const float t : {-g, g})
            for (const auto& d : {vec3<float>(0, s, t), vec3<float>(s, t, 0), vec3<float>(t, 0, s)})
                result.push_back(normalize(d));
    return result;
}

/// The actor in one frame of a motion.
LitMesh<float> actor_in(const BodyModel& actor, ActorMotion motion, std::size_t frame) {
    const Motion m = actor_motion(motion, 24);
    const PosedBody posed = pose_body(actor, m.pose_at(frame), m.transl[frame], m.betas, m.expression_at(frame));
    const auto normals = vertex_normals(posed.vertices, actor.faces);
    LitMesh<float> mesh{{posed.vertices.begin(), posed.vertices.end()}, {normals.begin(), normals.end()}, {}};
    for (const auto& f : actor.faces)
        mesh.triangles.push_back({static_cast<std::uint32_t>(f[0]), static_cast<std::uint32_t>(f[1]),
                                  static_cast<std::uint32_t>(f[2])});
    return mesh;
}

TEST_CASE("a sphere casts a round shadow of known size on a plane, from a direction and from a point") {
    const auto ball = sphere<float>({0, 1, 0}, 0.2);
    const auto floor = floor_grid(0, 0.6f);
    const Points above{{0, 3, 0}}, down{{0, 1, 0}};
    const auto found = visibility(cpu::Serial(), {ball.caster()}, above, down, floor);
    // The cone from (0, 3, 0) that touches the ball has a half angle of asin(0.2 / 2).
    const double radii[2] = {3 * std::tan(std::asin(0.1)), 0.2};
    const double soft[2] = {0.008 * 3 / 2, 0.045}; // of the filter, on the plane
    for (std::size_t i = 0; i < floor.vertices.size(); ++i)
        for (std::size_t l = 0; l < 2; ++l) {
            const double off = std::hypot(floor.vertices[i].x, floor.vertices[i].z) - radii[l];
            const double edge = 1.5 * soft[l] + 0.02; // corner of the filter's square, and a texel
            const float seen = found[2 * i + l];
            INFO("light " << l << ", metres outside the shadow " << off);
            CHECK((seen >= 0 && seen <= 1));
            if (off > edge) CHECK(seen == 1);
            if (off < -edge) CHECK(seen == 0);
        }
    // At the edge of the shadow, half of the filter's square is lit.
    const auto rim = [&](double radius) {
        LitMesh<float> ring;
        for (int k = 0; k < 64; ++k) {
            const double a = 2 * std::numbers::pi * k / 64;
            ring.vertices.push_back({float(radius * std::cos(a)), 0, float(radius * std::sin(a))});
            ring.normals.push_back({0, 1, 0});
        }
        return ring;
    };
    for (std::size_t l = 0; l < 2; ++l) {
        const auto on_rim = visibility(cpu::Serial(), {ball.caster()}, above, down, rim(radii[l]));
        double mean = 0;
        for (std::size_t i = 0; i < 64; ++i) mean += on_rim[2 * i + l] / 64;
        CHECK(mean == doctest::Approx(0.5).epsilon(0.25));
    }
}

TEST_CASE("a convex body does not shadow itself, whether it is drawn by its far sides or by both") {
    const auto ball = sphere<float>({0.3f, 1, -0.2f}, 0.5);
    const Points points{{3, 2, 1}, {-1, 1, 0.5f}}, directions = twelve_directions();
    for (const bool closed : {true, false}) {
        CAPTURE(closed);
        const auto found =
            visibility(cpu::Serial(), {ball.caster()}, points, directions, ball, {.closed = closed});
        double lit = 0, sum = 0;
        float least = 1;
        for (std::size_t v = 0; v < ball.vertices.size(); ++v)
            for (std::size_t l = 0; l < 14; ++l) {
                const vec3<float> to = l < 2 ? normalize(points[l] - ball.vertices[v]) : directions[l - 2];
                const float facing = dot(to, ball.normals[v]);
                if (facing < 0.1f) continue;
                lit += 1, sum += found[v * 14 + l];
                if (facing > 0.4f) least = std::min(least, found[v * 14 + l]);
            }
        CHECK(sum / lit > 0.995);
        CHECK(least > (closed ? 0.99f : 0.95f));
    }
}

TEST_CASE("casters shadow each other, in any order") {
    const auto low = sphere<float>({0, 0, 0}, 0.3), high = sphere<float>({0, 1.5f, 0}, 0.3);
    const Points sun{{0, 1, 0}};
    const auto alone = visibility(cpu::Serial(), {low.caster()}, {}, sun, low);
    const auto both = visibility(cpu::Serial(), {low.caster(), high.caster()}, {}, sun, low);
    const auto swapped = visibility(cpu::Serial(), {high.caster(), low.caster()}, {}, sun, low);
    CHECK(both == swapped);
    CHECK(alone[0] == 1); // the pole
    CHECK(both[0] == 0);
    const auto upper = visibility(cpu::Serial(), {low.caster(), high.caster()}, {}, sun, high);
    CHECK(upper[0] == 1);
    const auto none = visibility(cpu::Serial(), std::vector<ShadowCaster<float>>(), {{0, 2, 0}}, sun, low);
    CHECK(none[0] == 1);
    CHECK(none[1] == 1);
}

TEST_CASE("a point far away shadows as a direction does") {
    const BodyModel actor = make_actor({.edge_scale = 1.5});
    const auto mesh = actor_in(actor, ActorMotion::talk, 5);
    const vec3<float> direction = normalize(vec3<float>(0.4f, 0.7f, 0.6f));
    const Points far{direction * 400.0f}, sun{direction};
    const ShadowMapParams same{.point_resolution = 128, .direction_resolution = 128, .point_softness = 0.03,
                               .direction_softness = 0.03};
    const auto found = visibility(cpu::Serial(), {mesh.caster()}, far, sun, mesh, same);
    // The texels of the two maps lie elsewhere, so single vertices differ at the edges of shadows.
    double difference = 0, sum = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        difference += std::abs(found[2 * v] - found[2 * v + 1]);
        sum += found[2 * v] - found[2 * v + 1];
    }
    CHECK(difference / double(mesh.vertices.size()) < 0.02);
    CHECK(std::abs(sum) / double(mesh.vertices.size()) < 0.002);
}

TEST_CASE("a point light inside, at, or close to the casters gives numbers in [0, 1]") {
    const auto ball = sphere<float>({0, 1, 0}, 0.5);
    const Points points{{0, 1, 0}, {0, 1.5f, 0}, {0, 1.51f, 0}, {0.1f, 1.6f, 0}, {0, 1, 0.6f}, {1e4f, 0, 0}};
    const auto found = visibility(cpu::Serial(), {ball.caster()}, points, {}, ball);
    for (const float v : found) CHECK((v >= 0 && v <= 1));
    CHECK(found[3] == 1); // the upper pole sees the fourth point, and faces away from the fifth
    CHECK(found[4] == 0);
    // Visibility stays within [0, 1] if receivers and casters are not finite.
    auto broken = ball;
    broken.vertices[7] = vec3<float>(std::numeric_limits<float>::quiet_NaN());
    broken.vertices[900] = vec3<float>(std::numeric_limits<float>::infinity(), 0, 0);
    for (const float v : visibility(cpu::Serial(), {broken.caster()}, points, twelve_directions(), broken))
        CHECK((v >= 0 && v <= 1));
}

/// Visibility by rays to a disc of the given size around each light (at a point) or each direction (at distance 1).
std::vector<float> traced(const LitMesh<float>& mesh, const BodyModel& body, const Points& points,
                          const Points& directions, float point_disc, float direction_disc, std::size_t stride) {
    const RayScene scene(mesh.vertices, body.faces);
    const std::size_t L = points.size() + directions.size();
    constexpr int rays = 24;
    std::vector<float> result(mesh.vertices.size() * L, 0);
    for (std::size_t v = 0; v < mesh.vertices.size(); v += stride)
        for (std::size_t l = 0; l < L; ++l) {
            const bool near = l < points.size();
            const vec3<float> to = near ? points[l] - mesh.vertices[v] : directions[l - points.size()];
            const vec3<float> side =
                normalize(cross(to, std::abs(to.y) < 0.9f * length(to) ? vec3<float>(0, 1, 0) : vec3<float>(1, 0, 0)));
            const vec3<float> up = cross(normalize(to), side), from = mesh.vertices[v] + mesh.normals[v] * 0.001f;
            int seen = 0;
            for (int k = 0; k < rays; ++k) {
                const float radius = (near ? point_disc : direction_disc) * std::sqrt((float(k) + 0.5f) / rays);
                const float angle = 2.39996f * float(k) + float(v % 97);
                const vec3<float> d = to + (side * std::cos(angle) + up * std::sin(angle)) * radius;
                seen += dot(d, mesh.normals[v]) > 0 && !scene.occluded(from, d, 1e-4f, near ? 1.0f : 1e9f);
            }
            result[v * L + l] = float(seen) / rays;
        }
    return result;
}

TEST_CASE("soft visibility of the posed actor agrees with rays, also with a coarse caster") {
    const BodyModel actor = make_actor();
    const Points directions = twelve_directions();
    const vec3<float> middle(0, 0, 0);
    const Points points{middle + vec3<float>(2, 3, 2), middle + vec3<float>(-3, 1.5f, 1),
                        middle + vec3<float>(0.5f, 2, -3), middle + vec3<float>(0, -0.2f, 4)};
    constexpr std::size_t L = 16, stride = 5;
    for (const auto& [motion, frame] : {std::pair(ActorMotion::talk, 3), std::pair(ActorMotion::talk, 14),
                                       std::pair(ActorMotion::stride, 5), std::pair(ActorMotion::stride, 17)}) {
        CAPTURE(frame);
        const auto mesh = actor_in(actor, motion, static_cast<std::size_t>(frame));
        const auto expected = traced(mesh, actor, points, directions, 0.12f, std::tan(0.2f), stride);

        cpu::Serial backend;
        const CoarseCaster<cpu::Serial> proxy(backend, actor.v_template, actor.faces);
        CoarseCaster<cpu::Serial>::Cache cache;
        CHECK(proxy.picked_count() < actor.vertex_count() / 2);
        const auto fine = visibility(backend, {mesh.caster()}, points, directions, mesh);
        const auto less = visibility(backend, {proxy.forward(mesh.vertices, cache)}, points, directions, mesh);

        // By area and by the light that falls on it: what a picture shows. Vertices that no light reaches, of eyeballs
        // behind their lids, are inside the closed mesh.
        std::vector<double> area(mesh.vertices.size(), 0);
        for (const auto& t : mesh.triangles) {
            const vec3<float> a = mesh.vertices[t.x];
            const double size = length(cross(mesh.vertices[t.y] - a, mesh.vertices[t.z] - a)) / 6;
            area[t.x] += size, area[t.y] += size, area[t.z] += size;
        }
        for (const auto* found : {&fine, &less}) {
            double difference[2] = {0, 0}, weight[2] = {0, 0};
            for (std::size_t v = 0; v < mesh.vertices.size(); v += stride) {
                float reached = 0;
                for (std::size_t l = 0; l < L; ++l) reached += expected[v * L + l];
                if (reached < 0.5f) continue;
                for (std::size_t l = 0; l < L; ++l) {
                    const vec3<float> to = l < 4 ? normalize(points[l] - mesh.vertices[v]) : directions[l - 4];
                    const double w = area[v] * std::max(0.0f, dot(to, mesh.normals[v]));
                    difference[l < 4 ? 0 : 1] += w * std::abs((*found)[v * L + l] - expected[v * L + l]);
                    weight[l < 4 ? 0 : 1] += w;
                }
            }
            CHECK(difference[0] / weight[0] < 0.02);
            CHECK(difference[1] / weight[1] < 0.05);
        }
    }
}

TEST_CASE_TEMPLATE("visibility is bit-identical on Threads and Serial, and that of the function for one point", T,
                   float, double) {
    const auto low = sphere<T>(vec3<T>(T(0), T(0), T(0)), 0.3, 31),
               high = sphere<T>(vec3<T>(T(0.2), T(0.9), T(0.1)), 0.3, 20);
    const std::vector<vec3<T>> points{vec3<T>(T(2), T(2), T(1)), vec3<T>(T(0.1), T(0.5), T(0))};
    std::vector<vec3<T>> directions;
    for (const auto& d : twelve_directions()) directions.push_back(vec3<T>(d));
    for (const bool closed : {true, false}) {
        const ShadowMapParams params{.closed = closed};
        const std::vector<ShadowCaster<T>> casters{low.caster(), high.caster()};
        const auto expected = visibility(cpu::Serial(), casters, points, directions, low, params);
        for (const std::size_t threads : {1, 2, 3, 7, 40}) {
            cpu::Threads backend(threads);
            const auto found = visibility(backend, casters, points, directions, low, params);
            CHECK(std::memcmp(found.data(), expected.data(), expected.size() * sizeof(T)) == 0);
        }
        // The kernel that a device would run.
        cpu::Serial backend;
        const ShadowMaps<cpu::Serial, T> maps(backend, params);
        typename ShadowMaps<cpu::Serial, T>::Cache cache;
        std::vector<T> again(expected.size()), alone(expected.size());
        maps.forward(casters, {.points = points, .directions = directions}, low.vertices, low.normals, again, cache);
        CHECK(again == expected);
        backend.for_each(low.vertices.size(),
                         detail::ReceiveShadows<T>{cache.frames, cache.maps, low.vertices, low.normals, alone,
                                                   T(params.normal_offset)});
        CHECK(alone == expected);
    }
}

TEST_CASE("ShadowMaps refuses arrays of the wrong size and numbers out of range; no vertices are fine") {
    cpu::Serial backend;
    using Maps = ShadowMaps<cpu::Serial>;
    CHECK_THROWS_AS(Maps(backend, {.point_resolution = 15}), ValueError);
    CHECK_THROWS_AS(Maps(backend, {.direction_resolution = 1025}), ValueError);
    CHECK_THROWS_AS(Maps(backend, {.point_softness = -1}), ValueError);
    CHECK_THROWS_AS(Maps(backend, {.normal_offset = std::numeric_limits<double>::quiet_NaN()}), ValueError);
    const Maps maps(backend);
    Maps::Cache cache;
    const auto ball = sphere<float>({0, 0, 0}, 1, 4);
    const std::vector<ShadowCaster<float>> casters{ball.caster()};
    const Points sun{{0, 1, 0}};
    const LightView<const float> light{.directions = sun};
    const std::size_t V = ball.vertices.size();
    std::vector<float> few(V - 1), right(V);
    CHECK_THROWS_AS(maps.forward(casters, light, ball.vertices, ball.normals, few, cache), ShapeError);
    CHECK_THROWS_AS(maps.forward(casters, light, ball.vertices, sun, right, cache), ShapeError);
    CHECK_NOTHROW(maps.forward(casters, light, ball.vertices, ball.normals, right, cache));
    CHECK_NOTHROW(maps.forward(casters, light, {}, {}, {}, cache));
    CHECK_NOTHROW(maps.forward(casters, {}, ball.vertices, ball.normals, {}, cache));
    const std::vector<ShadowCaster<float>> empty(2);
    CHECK_NOTHROW(maps.forward(empty, light, ball.vertices, ball.normals, right, cache));
    CHECK(right[0] == 1);

    const std::vector<vec3<double>> rest(3);
    const std::vector<std::array<int, 3>> face{{0, 1, 2}};
    const CoarseCaster<cpu::Serial> coarse(backend, rest, face, 1e-3);
    CoarseCaster<cpu::Serial>::Cache picked;
    CHECK_THROWS_AS((void)coarse.forward(sun, picked), ShapeError);
}

} // namespace
} // namespace gsh
