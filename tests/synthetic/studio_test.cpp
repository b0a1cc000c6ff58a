// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <gsh/backend/threads.hpp>
#include <gsh/io/capture/capture_warnings.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include "support/bodies.hpp"
#include "support/chunks_alone.hpp"

#include <algorithm>
#include <vector>

using namespace gsh;

namespace {

const BodyModel& actor() {
    static const BodyModel body = make_actor({.edge_scale = 1.5});
    return body;
}

/// Which of size x size points at pixel offsets (du, dv) a mesh covers, by rasterizing its triangles, without rays.
std::vector<char> covered(const std::vector<vec3<double>>& vertices, const std::vector<std::array<int, 3>>& faces,
                          const Camera<double>& camera, double du, double dv) {
    std::vector<char> mask(static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), 0);
    for (const auto& f : faces) {
        vec2<double> p[3];
        for (std::size_t k = 0; k < 3; ++k)
            p[k] = to_pixel(camera, to_camera(camera, vertices[static_cast<std::size_t>(f[k])])) - vec2<double>(du, dv);
        const auto [x0, x1] = std::minmax({p[0].x, p[1].x, p[2].x});
        const auto [y0, y1] = std::minmax({p[0].y, p[1].y, p[2].y});
        for (int y = std::max(0, static_cast<int>(std::ceil(y0)));
             y <= std::min(camera.height - 1, static_cast<int>(y1)); ++y)
            for (int x = std::max(0, static_cast<int>(std::ceil(x0)));
                 x <= std::min(camera.width - 1, static_cast<int>(x1)); ++x) {
                int left = 0, right = 0;
                for (int k = 0; k < 3; ++k) {
                    const vec2<double> a = p[k], b = p[(k + 1) % 3];
                    const double side = (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
                    left += side >= 0, right += side <= 0;
                }
                if (left == 3 || right == 3) mask[static_cast<std::size_t>(y * camera.width + x)] = 1;
            }
    }
    return mask;
}

} // namespace

TEST_CASE("alpha is the silhouette of the posed mesh seen by the cameras") {
    cpu::Threads backend(2);
    const Motion motion = actor_motion(ActorMotion::talk, 2);
    StudioParams params;
    params.train_cameras = 3, params.image_size = 200, params.samples = 4;
    const Capture shot = film(backend, actor(), motion, params);
    REQUIRE(shot.cameras.size() == 4);
    for (std::size_t c = 0; c < 4; ++c)
        for (std::size_t t = 0; t < 2; ++t) {
            const auto vertices = test::posed_vertices(actor(), motion, t);
            const auto& camera = shot.cameras[c].camera;
            std::vector<int> count(40000, 0);
            for (const double du : {0.25, 0.75})
                for (const double dv : {0.25, 0.75}) {
                    const auto mask = covered(vertices, actor().faces, camera, du, dv);
                    for (std::size_t i = 0; i < mask.size(); ++i) count[i] += mask[i];
                }
            double both = 0, either = 0;
            for (std::size_t i = 0; i < count.size(); ++i) {
                const bool a = shot.image({c, t}).data[4 * i + 3] > 127, b = count[i] >= 2;
                both += a && b, either += a || b;
            }
            INFO("camera " << c << ", frame " << t << ": " << both << " of " << either);
            CHECK(both / either > 0.98);
            CHECK(either > 1500);
        }
}

TEST_CASE("images are the same bytes at any thread count") {
    const Motion motion = actor_motion(ActorMotion::stride, 2);
    StudioParams params;
    params.train_cameras = 2, params.image_size = 64, params.samples = 5;
    test::ChunksAlone executor; // the studio needs no backend
    const Capture expected = film(executor, actor(), motion, params);
    for (const std::size_t threads : {1, 2, 3, 7}) {
        cpu::Threads backend(threads);
        const Capture shot = film(backend, actor(), motion, params);
        for (std::size_t i = 0; i < expected.images.size(); ++i) CHECK(shot.images[i].data == expected.images[i].data);
    }
    params.seed = 2;
    CHECK(film(executor, actor(), motion, params).images[0].data != expected.images[0].data);
}

TEST_CASE("pixels: straight alpha, no colour where there is none, nothing cut off at the border") {
    cpu::Threads backend(2);
    StudioParams params;
    params.train_cameras = 4, params.test_cameras = 2, params.image_size = 96, params.samples = 9;
    const Capture shot = film(backend, actor(), actor_motion(ActorMotion::talk, 3), params);
    CHECK(shot.images.size() == 18);
    CHECK(shot.fps == doctest::Approx(10));
    for (const auto& image : shot.images) {
        std::size_t partial = 0, opaque = 0;
        for (int y = 0; y < 96; ++y)
            for (int x = 0; x < 96; ++x) {
                const auto* p = image.pixel(y, x);
                if (p[3] == 0) CHECK(p[0] + p[1] + p[2] == 0);
                if (y == 0 || x == 0 || y == 95 || x == 95) CHECK(p[3] == 0);
                partial += p[3] > 0 && p[3] < 255, opaque += p[3] == 255;
            }
        CHECK(partial > 50);
        CHECK(opaque > 300);
    }
    CHECK(capture_warnings(shot, actor()).empty());
    std::vector<double> focal, centre;
    for (const auto& named : shot.cameras) {
        CHECK(determinant(named.camera.R) == doctest::Approx(1));
        focal.push_back(named.camera.fx), centre.push_back(named.camera.cx);
    }
    std::sort(focal.begin(), focal.end()), std::sort(centre.begin(), centre.end());
    CHECK(std::adjacent_find(focal.begin(), focal.end()) == focal.end());
    CHECK(std::adjacent_find(centre.begin(), centre.end()) == centre.end());
    CHECK(shot.cameras[0].name == "cam00");
    CHECK(shot.cameras[5].name == "test01");
    CHECK(shot.cameras[5].role == NamedCamera::Role::test);
}

TEST_CASE("shadows are soft and move over the body") {
    const Motion motion = actor_motion(ActorMotion::talk, 6);
    std::vector<LitMesh> frames;
    for (std::size_t t = 0; t < 6; ++t)
        frames.emplace_back(test::posed_vertices(actor(), motion, t), actor().v_template, actor().faces,
                            StudioLight{});
    std::size_t moving = 0, half_lit = 0;
    for (std::size_t f = 0; f < actor().faces.size(); ++f) {
        const auto v = static_cast<std::size_t>(actor().faces[f][0]);
        const auto& p = actor().v_template[v];
        if (std::abs(p.x) > 0.15 || p.y < 0 || p.y > 0.45 || p.z < 0.05) continue; // the shirt's front
        float low = 1, high = 0;
        for (const auto& frame : frames) {
            const float seen = frame.lamp_visibility(f, vec3<float>(1.0f / 3), 16);
            low = std::min(low, seen), high = std::max(high, seen);
            half_lit += seen > 0.2f && seen < 0.8f;
        }
        moving += high - low > 0.8f;
    }
    CHECK(moving > 20);   // lit in one frame, dark in another
    CHECK(half_lit > 20); // penumbra
}

TEST_CASE("two actors hide each other and throw shadows on each other") {
    cpu::Threads backend(2);
    StudioParams params;
    params.train_cameras = 3, params.test_cameras = 0, params.image_size = 80, params.samples = 9, params.distance = 4;
    const auto moved = [](Motion motion, const vec3<double>& by) {
        for (auto& transl : motion.transl) transl += by;
        return motion;
    };
    const Motion left = moved(actor_motion(ActorMotion::talk, 2), {0.1, 0, -0.3}),
                 // Between the other person and the lamp.
                 right = moved(actor_motion(ActorMotion::stride, 2), {0.3, 0, 0.3});
    const auto white = [](const vec3<double>&) { return SurfaceColor{.albedo = vec3<double>(0.8), .gloss = 0}; };
    const auto blue = [](const vec3<double>&) { return SurfaceColor{.albedo = {0, 0, 0.8}, .gloss = 0}; };
    const StudioActor a{&actor(), &left, white}, b{&actor(), &right, blue};
    const Capture both = film(backend, {a, b}, params);
    params.cameras = both.cameras;
    const Capture first = film(backend, {a}, params), second = film(backend, {b}, params);
    CHECK(first.cameras[1].camera.fx == both.cameras[1].camera.fx);
    CHECK(film(backend, actor(), left, params, white).images[3].data == first.images[3].data);
    std::size_t union_of_both = 0, white_hidden = 0, shadowed = 0;
    for (std::size_t i = 0; i < both.images.size(); ++i)
        for (std::size_t p = 0; p < both.images[i].data.size(); p += 4) {
            const std::uint8_t *seen = &both.images[i].data[p], *one = &first.images[i].data[p],
                               *other = &second.images[i].data[p];
            union_of_both += seen[3] < std::max(one[3], other[3]); // never less, because the rays are the same
            if (one[3] == 255 && other[3] == 255 && seen[0] == 0 && seen[2] > 0) ++white_hidden;
            if (one[3] == 255 && other[3] == 0 && one[0] > seen[0] + 30) ++shadowed;
        }
    CHECK(union_of_both == 0);
    CHECK(white_hidden > 50);
    CHECK(shadowed > 20);
    const Motion longer = actor_motion(ActorMotion::talk, 3);
    CHECK_THROWS_AS((void)film(backend, {a, {&actor(), &longer}}, params), ShapeError);
    CHECK_THROWS_AS((void)film(backend, std::vector<StudioActor>(), params), ValueError);
    params.image_size = 40;
    CHECK_THROWS_AS((void)film(backend, {a}, params), ValueError); // images of other cameras
}

TEST_CASE("a ray meets a triangle where it should") {
    const std::vector<vec3<float>> points = {{0, 0, 5}, {1, 0, 5}, {0, 1, 5}};
    const std::vector<std::array<int, 3>> faces = {{0, 1, 2}};
    const RayScene scene(points, faces);
    const RayHit hit = scene.closest({0.25f, 0.5f, 0}, {0, 0, 1});
    CHECK(hit.found);
    CHECK(hit.distance == doctest::Approx(5));
    CHECK(hit.u == doctest::Approx(0.25));
    CHECK(hit.v == doctest::Approx(0.5));
    CHECK_FALSE(scene.closest({0.8f, 0.8f, 0}, {0, 0, 1}).found);
    CHECK(scene.occluded({0.25f, 0.25f, 0}, {0, 0, 1}, 0, 10));
    CHECK_FALSE(scene.occluded({0.25f, 0.25f, 0}, {0, 0, 1}, 0, 4));
}

TEST_CASE("parameters out of range are refused") {
    test::ChunksAlone executor;
    const Motion motion = actor_motion(ActorMotion::talk, 1);
    const auto refused = [&](const auto& change) {
        StudioParams params;
        params.image_size = 16, params.samples = 1;
        change(params);
        CHECK_THROWS_AS((void)film(executor, actor(), motion, params), ValueError);
    };
    refused([](StudioParams& p) { p.train_cameras = 0; });
    refused([](StudioParams& p) { p.train_cameras = 1, p.test_cameras = 2; });
    refused([](StudioParams& p) { p.image_size = 0; });
    refused([](StudioParams& p) { p.samples = 0; });
    refused([](StudioParams& p) { p.distance = 0.5; });
    CHECK_THROWS_AS((void)film(executor, actor(), Motion{}), ValueError);
    Motion other = motion;
    other.joint_count = 24;
    CHECK_THROWS_AS((void)film(executor, actor(), other), ShapeError);
}
