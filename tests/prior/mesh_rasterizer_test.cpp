// SPDX-License-Identifier: Apache-2.0
#include "io/temporary.hpp"
#include "prior/shapes.hpp"
#include "support/gradient.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <limits>

namespace gsh {
namespace {

using test::serial;
using Faces = std::vector<std::array<int, 3>>;

Camera<double> pinhole(int size, double focal) {
    Camera<double> camera;
    camera.fx = focal, camera.fy = 1.1 * focal, camera.cx = 0.47 * size, camera.cy = 0.55 * size;
    camera.width = camera.height = size;
    return camera;
}

TEST_CASE("a box has the depth of its nearest side, on exactly the pixels inside it") {
    const auto mesh = test::box({-0.31, -0.2, 2}, {0.1, 0.4, 3});
    const auto camera = test::square_camera(50, 40); // x in pixels: 25 - 12.4 = 12.6 to 29, y: 17 to 41
    const MeshImage image = rasterize_mesh(serial, mesh.vertices, mesh.faces, camera);
    for (int y = 0; y < 50; ++y)
        for (int x = 0; x < 50; ++x) {
            const std::size_t i = static_cast<std::size_t>(y * 50 + x);
            const bool inside = x >= 13 && x < 29 && y >= 17 && y < 41;
            REQUIRE(image.covers(i) == inside);
            REQUIRE(image.mask().data[i] == inside);
            CHECK(std::abs(image.depth[i] - (inside ? 2 : 0)) < 1e-12);
        }
    const auto places = interpolate_attribute<vec3<double>>(image, mesh.faces, mesh.vertices);
    const auto heights = interpolate_attribute<double>(image, mesh.faces, std::vector<double>(8, 3.0));
    for (int y = 17; y < 41; ++y) {
        const std::size_t i = static_cast<std::size_t>(y * 50 + 20);
        // Corners sit on a 2^-14 pixel grid.
        CHECK(length(places[i] - vec3<double>(-4.5 / 40, (y - 24.5) / 40, 2)) < 1e-5);
        CHECK(heights[i] == doctest::Approx(3));
    }
    CHECK(places[0] == vec3<double>(0));
}

TEST_CASE("the nearer of two surfaces is seen, whatever their order; of equal ones the first") {
    auto mesh = test::box({-1, -1, 3}, {1, 1, 4});
    mesh.add(test::box({-0.5, -0.5, 1}, {0.5, 0.5, 2}));
    const auto camera = test::square_camera(30, 10);
    for (const bool reversed : {false, true}) {
        auto faces = mesh.faces;
        if (reversed) std::reverse(faces.begin(), faces.end());
        const MeshImage image = rasterize_mesh(serial, mesh.vertices, faces, camera);
        CHECK(image.depth[15 * 30 + 15] == doctest::Approx(1));
        CHECK(image.depth[7 * 30 + 15] == doctest::Approx(3));
        CHECK_FALSE(image.covers(0));
    }
    mesh.add(mesh);
    const MeshImage twice = rasterize_mesh(serial, mesh.vertices, mesh.faces, camera);
    for (const int t : twice.triangle) CHECK(t < 24);
}

TEST_CASE("a sphere: analytic depth and mask, orthographic and pinhole") {
    const vec3<double> center(0.1, -0.05, 3);
    const auto mesh = test::sphere(center, 0.8, 180, 360);
    const double sagitta = 0.8 * (1 - std::cos(std::numbers::pi / 180));
    const auto compare = [&](const auto& camera, const auto& ray) {
        const MeshImage image = rasterize_mesh(serial, mesh.vertices, mesh.faces, camera);
        std::size_t wrong = 0, covered = 0;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const std::size_t i = static_cast<std::size_t>(y * camera.width + x);
                const auto [origin, direction] = ray(x + 0.5, y + 0.5);
                const vec3<double> to = center - origin;
                const double a = dot(direction, direction), b = dot(direction, to), c = dot(to, to) - 0.64;
                const double under = b * b - a * c;
                const double grazing = 0.05; // the mesh only approximates the sphere's rim
                if (std::abs(under) < grazing * a * 0.64) continue;
                wrong += image.covers(i) != (under > 0);
                if (under < 0 || !image.covers(i)) continue;
                ++covered;
                const double depth = (origin + direction * ((b - std::sqrt(under)) / a)).z;
                if (std::abs(image.depth[i] - depth) > 8 * sagitta) FAIL_CHECK(x, " ", y, " ", image.depth[i] - depth);
            }
        CHECK(wrong == 0);
        CHECK(covered > 1000);
    };
    const auto flat = test::square_camera(80, 40);
    compare(flat, [&](double u, double v) {
        return std::pair{vec3<double>((u - flat.cx) / flat.scale, (v - flat.cy) / flat.scale, 0),
                         vec3<double>(0, 0, 1)};
    });
    const auto eye = pinhole(80, 110);
    compare(eye, [&](double u, double v) {
        return std::pair{vec3<double>(0), vec3<double>((u - eye.cx) / eye.fx, (v - eye.cy) / eye.fy, 1)};
    });
}

TEST_CASE("an edge that triangles share belongs to one of them, at any position") {
    // A jittered grid with some vertices on pixel centres and corners. Each triangle is drawn alone and counted.
    test::Rng rng(3);
    constexpr int n = 12, size = 40;
    const auto camera = test::square_camera(size, 1);
    for (const double snap : {0.5, 1.0, 1.0 / 16384, 0.0}) {
        std::vector<vec3<double>> vertices;
        for (int y = 0; y <= n; ++y)
            for (int x = 0; x <= n; ++x) {
                const bool inner = x > 0 && y > 0 && x < n && y < n;
                vec3<double> p(3.5 * x - 21, 3.5 * y - 21, 5);
                if (inner) p += rng.vec(-1.1, 1.1);
                if (snap > 0) p.x = std::round(p.x / snap) * snap, p.y = std::round(p.y / snap) * snap;
                vertices.push_back(p);
            }
        Faces faces;
        for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x) {
                const int i = y * (n + 1) + x;
                if ((x + y) % 2) faces.push_back({i, i + 1, i + n + 2}), faces.push_back({i, i + n + 2, i + n + 1});
                else faces.push_back({i, i + 1, i + n + 1}), faces.push_back({i + n + 1, i + 1, i + n + 2});
            }
        std::vector<int> count(size * size, 0);
        for (const auto& face : faces) {
            const MeshImage image = rasterize_mesh(serial, vertices, Faces{face}, camera);
            for (std::size_t i = 0; i < image.size(); ++i) count[i] += image.covers(i);
        }
        for (const int c : count) REQUIRE(c == 1);
    }
    // A fan about a pixel's centre.
    std::vector<vec3<double>> vertices{{0.5, 0.5, 1}};
    for (int k = 0; k < 7; ++k) vertices.push_back({0.5 + 3 * std::cos(0.9 * k), 0.5 + 3 * std::sin(0.9 * k), 1});
    int center = 0;
    for (int k = 0; k < 7; ++k) {
        const MeshImage image = rasterize_mesh(serial, vertices, Faces{{0, k + 1, (k + 1) % 7 + 1}}, camera);
        center += image.covers(20 * size + 20);
    }
    CHECK(center == 1);
}

TEST_CASE("random triangles agree with rays, in front of, across and behind the camera's plane") {
    test::Rng rng(11);
    std::vector<vec3<double>> vertices = rng.vecs(120, -3, 3);
    vertices.push_back({1e9, 0, 4}), vertices.push_back({-1e9, 1e8, 5}), vertices.push_back({0, -1e9, 2e5});
    Faces faces;
    for (int k = 0; k < 41; ++k) faces.push_back({3 * k, 3 * k + 1, 3 * k + 2});
    const double near = 0.3;
    const auto compare = [&](const auto& camera, const auto& ray, double nearest) {
        const MeshImage image = [&] {
            if constexpr (requires { camera.fx; })
                return rasterize_mesh(serial, vertices, faces, camera, {.near = near});
            else
                return rasterize_mesh(serial, vertices, faces, camera);
        }();
        std::size_t compared = 0;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const std::size_t i = static_cast<std::size_t>(y * camera.width + x);
                const auto [origin, direction] = ray(x + 0.5, y + 0.5);
                double best = std::numeric_limits<double>::infinity();
                bool clear = true; // no edge near the ray
                for (const auto& face : faces) {
                    const vec3<double> a = vertices[static_cast<std::size_t>(face[0])] - origin,
                                       b = vertices[static_cast<std::size_t>(face[1])] - origin,
                                       c = vertices[static_cast<std::size_t>(face[2])] - origin;
                    const double u = dot(direction, cross(b, c)), v = dot(direction, cross(c, a)),
                                 w = dot(direction, cross(a, b)), sum = u + v + w;
                    if (sum == 0) continue;
                    const double depth = (a * (u / sum) + b * (v / sum) + c * (w / sum)).z + origin.z;
                    const double least = std::min({u / sum, v / sum, w / sum});
                    const bool seen = depth > nearest;
                    clear =
                        clear && (std::abs(least) > 1e-3 || !seen) && (least < 0 || std::abs(depth - nearest) > 1e-3);
                    if (least > 0 && seen) best = std::min(best, depth);
                }
                if (!clear) continue;
                ++compared;
                REQUIRE(image.covers(i) == std::isfinite(best));
                if (image.covers(i)) CHECK(std::abs(image.depth[i] - best) < 1e-4 * (1 + std::abs(best)));
            }
        CHECK(compared > 1500);
    };
    const auto eye = pinhole(50, 30);
    compare(eye, [&](double u, double v) {
        return std::pair{vec3<double>(0), vec3<double>((u - eye.cx) / eye.fx, (v - eye.cy) / eye.fy, 1)};
    }, near);
    const auto flat = test::square_camera(50, 10);
    compare(
        flat,
        [&](double u, double v) {
            return std::pair{vec3<double>((u - flat.cx) / flat.scale, (v - flat.cy) / flat.scale, 0),
                             vec3<double>(0, 0, 1)};
        },
        -std::numeric_limits<double>::infinity());
}

TEST_CASE("barycentric coordinates are those in space, also through a pinhole and after clipping") {
    const std::vector<vec3<double>> vertices{{-1, 0.4, 1}, {1.5, 0.4, 6}, {0, -2, -3}};
    const Faces faces{{0, 1, 2}};
    const auto camera = pinhole(60, 40);
    const MeshImage image = rasterize_mesh(serial, vertices, faces, camera, {.near = 0.2});
    const auto places = interpolate_attribute<vec3<double>>(image, faces, vertices);
    std::size_t covered = 0;
    for (std::size_t i = 0; i < image.size(); ++i) {
        if (!image.covers(i)) continue;
        ++covered;
        CHECK(image.depth[i] > 0.2);
        CHECK(places[i].z == doctest::Approx(image.depth[i]));
        const vec2<double> pixel = to_pixel(camera, places[i]);
        CHECK(std::abs(pixel.x - (static_cast<double>(i % 60) + 0.5)) < 1e-3);
        CHECK(std::abs(pixel.y - (static_cast<double>(i / 60) + 0.5)) < 1e-3);
    }
    CHECK(covered > 100);
}

TEST_CASE("threads give the reference's image, bit for bit; sizes 0 and 1") {
    auto mesh = test::sphere({0, 0, 2}, 0.9, 60, 90);
    mesh.add(test::box({-0.2, -0.3, 1}, {1, 0.2, 2.5}));
    const auto camera = test::square_camera(137, 60);
    const MeshImage reference = rasterize_mesh(serial, mesh.vertices, mesh.faces, camera);
    for (const std::size_t threads : {1, 2, 5}) {
        cpu::Threads backend(threads);
        const MeshImage image = rasterize_mesh(backend, mesh.vertices, mesh.faces, camera);
        CHECK(image.triangle == reference.triangle);
        CHECK(image.depth == reference.depth);
        CHECK(image.barycentric == reference.barycentric);
    }
    CHECK(rasterize_mesh(serial, {}, {}, camera).mask().data == std::vector<std::uint8_t>(137 * 137, 0));
    const MeshImage one = rasterize_mesh(serial, mesh.vertices, mesh.faces, test::square_camera(1, 1));
    CHECK(one.covers(0));
    const std::vector<vec3<double>> flat{{0, 0, 1}, {1, 1, 1}, {2, 2, 1}, {0, 0, 1}}; // no area
    const Faces none{{0, 1, 2}, {0, 0, 1}, {0, 3, 1}};
    CHECK(rasterize_mesh(serial, flat, none, test::square_camera(9, 2)).mask().data ==
          std::vector<std::uint8_t>(81, 0));
}

TEST_CASE("meshes and cameras that cannot be drawn") {
    const std::vector<vec3<double>> vertices{{0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
    const Faces faces{{0, 1, 2}};
    auto camera = test::square_camera(10, 5);
    const auto draw = [&](const auto& v, const Faces& f) {
        return [&] { (void)rasterize_mesh(serial, v, f, camera); };
    };
    const Faces beyond{{0, 1, 2}, {0, 1, 3}}, negative{{0, -1, 2}};
    test::check_throws<ValueError>(draw(vertices, beyond), {"rasterize_mesh", "faces[1]", "3"});
    test::check_throws<ValueError>(draw(vertices, negative), {"faces[0]", "-1"});
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e200})
        for (int k = 0; k < 3; ++k) {
            auto spoiled = vertices;
            spoiled[2][k] = bad;
            test::check_throws<ValueError>(draw(spoiled, faces), {"vertices[2]"});
        }
    camera.width = 20000;
    test::check_throws<ValueError>(draw(vertices, faces), {"20000", "16384"});
    camera.width = 0;
    test::check_throws<ValueError>(draw(vertices, faces), {"camera"});
    const auto eye = pinhole(10, 5);
    test::check_throws<ValueError>([&] { (void)rasterize_mesh(serial, vertices, faces, eye, {.near = 0}); }, {"near"});
    const MeshImage image = rasterize_mesh(serial, vertices, faces, eye);
    test::check_throws<ShapeError>([&] { (void)interpolate_attribute<double>(image, faces, std::vector<double>(2)); },
                                   {"attribute"});
    test::check_throws<ValueError>([&] { (void)interpolate_attribute<double>(image, {}, std::vector<double>(3)); },
                                   {"face"});
}

} // namespace
} // namespace gsh
