// SPDX-License-Identifier: Apache-2.0
#include "io/temporary.hpp"
#include "prior/shapes.hpp"
#include "support/gradient.hpp"

#include <gsh/prior/normal_integration.hpp>

#include <algorithm>
#include <limits>

namespace gsh {
namespace {

/// Depth of a surface at a pixel, and its normal, which faces the viewer. A depth of 0 is a hole.
struct SurfacePoint {
    double depth = 0;
    vec3<double> normal = vec3<double>(0);
};

struct Scene {
    PriorView normals, depth;
};

/// surface(x, y) with x, y in metres on the plane (orthographic) or on the plane one metre away (pinhole).
template <class AnyCamera, class Surface>
Scene scene_of(const AnyCamera& c, const Surface& surface) {
    Scene scene{{c, {Image<double>(3, c.height, c.width), Image<std::uint8_t>(1, c.height, c.width)}, {}},
                {c, {Image<double>(1, c.height, c.width), Image<std::uint8_t>(1, c.height, c.width)}, {}}};
    for (int row = 0; row < c.height; ++row)
        for (int column = 0; column < c.width; ++column) {
            double x = column + 0.5 - c.cx, y = row + 0.5 - c.cy;
            if constexpr (requires { c.scale; }) x /= c.scale, y /= c.scale;
            else x /= c.fx, y /= c.fy;
            const SurfacePoint point = surface(x, y);
            if (point.depth == 0) continue;
            scene.normals.map.mask.at(0, row, column) = scene.depth.map.mask.at(0, row, column) = 1;
            scene.depth.map.values.at(0, row, column) = point.depth;
            const vec3<double> normal = normalize(point.normal);
            for (int k = 0; k < 3; ++k) scene.normals.map.values.at(k, row, column) = normal[k];
        }
    return scene;
}

/// Largest and mean distance between two depths where both are valid. The mean difference is optionally subtracted.
struct Distance {
    double largest = 0, mean = 0;

    Distance(const PriorMap& a, const PriorMap& b, bool free_offset) {
        std::vector<double> differences;
        double offset = 0;
        for (std::size_t i = 0; i < a.mask.data.size(); ++i)
            if (a.mask.data[i] && b.mask.data[i]) differences.push_back(a.values.data[i] - b.values.data[i]);
        for (const double d : differences) offset += free_offset ? d / static_cast<double>(differences.size()) : 0;
        for (const double d : differences) {
            largest = std::max(largest, std::abs(d - offset));
            mean += std::abs(d - offset) / static_cast<double>(differences.size());
        }
    }
};

SurfacePoint ramp(double x, double y, double depth, double dx, double dy) {
    return {depth + dx * x + dy * y, {dx, dy, -1}};
}

constexpr double pixel = 0.01; // metres, of the orthographic scenes
const OrthographicCamera camera64 = test::square_camera(64, 1 / pixel);

TEST_CASE("a plane comes back exactly") {
    const Scene scene = scene_of(camera64, [](double x, double y) { return ramp(x, y, 2, 0.7, -0.4); });
    const IntegratedDepth result = integrate_normals(scene.normals);
    CHECK(Distance(result.view.map, scene.depth.map, true).largest < 1e-5 * pixel);
    CHECK(result.converged);
    CHECK(result.energy < 1e-12);
    double mean = 0;
    for (const double d : result.view.map.values.data) mean += d;
    CHECK(std::abs(mean) < 1e-9); // the free offset is subtracted
    CHECK(result.view.map.mask.data == scene.normals.map.mask.data);
}

TEST_CASE("a sphere's cap and a ripple, within a fraction of a pixel") {
    const double radius = 0.3;
    const Scene cap = scene_of(camera64, [&](double x, double y) {
        const double squared = radius * radius - x * x - y * y;
        if (squared < 0.25 * radius * radius) return SurfacePoint(); // 60 degrees
        return SurfacePoint{3 - std::sqrt(squared), {x, y, -std::sqrt(squared)}};
    });
    const Distance sphere(integrate_normals(cap.normals).view.map, cap.depth.map, true);
    CHECK(sphere.largest < 0.2 * pixel);
    CHECK(sphere.mean < 0.05 * pixel);

    const Scene water = scene_of(camera64, [](double x, double y) {
        return SurfacePoint{1 + 0.02 * std::sin(30 * x + 10 * y),
                            vec3<double>(0.6, 0.2, 0) * std::cos(30 * x + 10 * y) + vec3<double>(0, 0, -1)};
    });
    const Distance ripple(integrate_normals(water.normals).view.map, water.depth.map, true);
    CHECK(ripple.largest < 0.2 * pixel);
    CHECK(ripple.mean < 0.05 * pixel);
}

TEST_CASE("a step is kept: the ramp beside the plane, which least squares smear") {
    // The step grows from 0 in the middle of the seam to 16 pixels at its ends.
    const auto surface = [](double x, double y) { return x < 0 ? ramp(x, y, 2, 0, 0.5) : ramp(x, y, 2, 0, 0); };
    const Scene scene = scene_of(camera64, surface);
    const IntegratedDepth kept = integrate_normals(scene.normals);
    const IntegratedDepth smeared = integrate_normals(scene.normals, nullptr, {.sharpness = 0}); // plain least squares
    const Distance with(kept.view.map, scene.depth.map, true), without(smeared.view.map, scene.depth.map, true);
    CHECK(kept.converged);
    CHECK(with.largest < 1 * pixel);
    CHECK(with.mean < 0.2 * pixel);
    CHECK(without.largest > 5 * pixel);
    for (const int row : {2, 10, 53, 61}) { // the jump lies between two pixels, at full height
        const double jump = kept.view.map.values.at(0, row, 32) - kept.view.map.values.at(0, row, 31);
        CHECK(jump == doctest::Approx(-0.5 * (row + 0.5 - 32) * pixel).epsilon(0.1));
        CHECK(std::abs(kept.view.map.values.at(0, row, 33) - kept.view.map.values.at(0, row, 32)) < 0.1 * pixel);
    }
}

TEST_CASE("a coarse prior places pieces that nothing connects, and does not blunt the detail") {
    const auto surface = [](double x, double y) {
        const double u = x - (x < 0 ? -0.16 : 0.16), squared = 0.02 - u * u - y * y;
        if (squared < 0.004) return SurfacePoint();
        return SurfacePoint{(x < 0 ? 2 : 2.7) - std::sqrt(squared), {u, y, -std::sqrt(squared)}};
    };
    const Scene scene = scene_of(camera64, surface);
    PriorView prior = scene.depth; // like a smooth body: the mean depth of each piece, with a small error
    double mean[2] = {}, count[2] = {};
    for (int pass = 0; pass < 2; ++pass)
        for (int y = 0; y < 64; ++y)
            for (int x = 0; x < 64; ++x) {
                if (!prior.map.mask.at(0, y, x)) continue;
                const int side = x < 32 ? 0 : 1;
                double& depth = prior.map.values.at(0, y, x);
                if (pass == 0) mean[side] += depth, ++count[side];
                else depth = mean[side] / count[side] + 0.01 * std::sin(y);
            }
    const IntegratedDepth with = integrate_normals(scene.normals, &prior);
    CHECK(Distance(with.view.map, scene.depth.map, false).mean < 0.2 * pixel); // without subtracting the offset
    CHECK(Distance(with.view.map, scene.depth.map, false).largest < 0.6 * pixel);
    const IntegratedDepth free = integrate_normals(scene.normals);
    // Truly 70 cm apart. Without the prior they are at the same depth.
    CHECK(Distance(free.view.map, scene.depth.map, true).mean > 30 * pixel);
    const IntegratedDepth ignored = integrate_normals(scene.normals, &prior, {.prior_weight = 0});
    CHECK(ignored.view.map.values.data == free.view.map.values.data);

    // With a prior of one piece only, the other piece keeps the mean depth 0.
    for (int y = 0; y < 64; ++y)
        for (int x = 32; x < 64; ++x) prior.map.mask.at(0, y, x) = 0;
    const IntegratedDepth half = integrate_normals(scene.normals, &prior);
    double right = 0;
    for (int y = 0; y < 64; ++y)
        for (int x = 32; x < 64; ++x) right += half.view.map.values.at(0, y, x);
    CHECK(std::abs(right) < 1e-9);
    CHECK(std::abs(half.view.map.values.at(0, 32, 16) - scene.depth.map.values.at(0, 32, 16)) < 0.5 * pixel);
}

TEST_CASE("a step that no normal betrays: the prior makes it") {
    // Two fronto-parallel halves 20 pixels apart have the normals of one plane.
    const Scene scene = scene_of(camera64, [](double x, double y) { return ramp(x, y, x < 0 ? 2 : 2.2, 0.3, 0); });
    const IntegratedDepth free = integrate_normals(scene.normals);
    CHECK(std::abs(free.view.map.values.at(0, 5, 32) - free.view.map.values.at(0, 5, 31)) < 0.01);
    const IntegratedDepth with = integrate_normals(scene.normals, &scene.depth, {.prior_weight = 1e-2});
    CHECK(Distance(with.view.map, scene.depth.map, false).largest < 1 * pixel);
}

TEST_CASE("a pinhole camera: a slanted plane and a ball, up to one factor, and with a prior without") {
    Camera<double> eye;
    eye.fx = 80, eye.fy = 88, eye.cx = 30, eye.cy = 35, eye.width = eye.height = 64;
    const auto check = [&](const Scene& scene, double bound) {
        IntegratedDepth result = integrate_normals(scene.normals);
        double log_mean = 0, truth_log_mean = 0, count = 0;
        for (std::size_t i = 0; i < 64 * 64; ++i) {
            if (!scene.depth.map.mask.data[i]) continue;
            log_mean += std::log(result.view.map.values.data[i]),
                truth_log_mean += std::log(scene.depth.map.values.data[i]);
            ++count;
        }
        CHECK(std::abs(log_mean / count) < 1e-9);
        for (auto& d : result.view.map.values.data) d *= std::exp(truth_log_mean / count);
        CHECK(Distance(result.view.map, scene.depth.map, false).largest < bound);
        PriorView prior = scene.depth;
        for (auto& d : prior.map.values.data) d *= 1.001;
        CHECK(Distance(integrate_normals(scene.normals, &prior).view.map, scene.depth.map, false).largest <
              bound + 0.004);
    };
    const vec3<double> n(0.3, -0.2, -1);
    check(scene_of(eye, [&](double x, double y) {
              return SurfacePoint{dot(n, vec3<double>(0, 0, 3)) / dot(n, vec3<double>(x, y, 1)), n};
          }), 0.003);
    const vec3<double> center(0.1, 0, 3);
    check(scene_of(eye, [&](double x, double y) {
              const vec3<double> ray(x, y, 1);
              const double a = dot(ray, ray), b = dot(ray, center), under = b * b - a * (dot(center, center) - 0.64);
              if (under < 0.25 * a * 0.64) return SurfacePoint();
              const vec3<double> p = ray * ((b - std::sqrt(under)) / a);
              return SurfacePoint{p.z, p - center};
          }), 0.01);
}

TEST_CASE("a map of the far side gives the same depth as its mirror image in depth") {
    const Scene scene = scene_of(camera64, [](double x, double y) {
        return SurfacePoint{2 + x * y, {y, x, -1}};
    });
    PriorView far = scene.normals;
    for (auto& v : far.map.values.data) v = -v;
    const IntegratedDepth a = integrate_normals(scene.normals), b = integrate_normals(far);
    CHECK(Distance(a.view.map, b.view.map, false).largest < 1e-9);
}

TEST_CASE("conjugate gradients find what the factorisation finds") {
    const Scene scene = scene_of(camera64, [](double x, double y) {
        return SurfacePoint{2 + 0.1 * std::sin(9 * x) * std::cos(7 * y),
                            {0.9 * std::cos(9 * x) * std::cos(7 * y), -0.7 * std::sin(9 * x) * std::sin(7 * y), -1}};
    });
    const IntegratedDepth direct = integrate_normals(scene.normals, &scene.depth);
    const IntegratedDepth iterated =
        integrate_normals(scene.normals, &scene.depth, {.largest_direct = 100, .solver_tolerance = 1e-9});
    CHECK(Distance(direct.view.map, iterated.view.map, false).largest < 1e-3 * pixel);
}

TEST_CASE("small and odd masks") {
    for (const auto& [height, width] : {std::pair{1, 1}, std::pair{1, 7}, std::pair{33, 47}, std::pair{70, 3}}) {
        OrthographicCamera camera = camera64;
        camera.height = height, camera.width = width;
        Scene scene = scene_of(camera, [](double x, double y) { return ramp(x, y, 2, 0.3, 0.2); });
        CHECK(Distance(integrate_normals(scene.normals).view.map, scene.depth.map, true).largest < 1e-3 * pixel);
    }
    test::Rng rng(2); // single pixels, holes, thin bridges and random normals: results must be finite
    Scene scene = scene_of(camera64, [&](double, double) {
        return rng.uniform() < 0.4 ? SurfacePoint() : SurfacePoint{1, rng.vec()};
    });
    const IntegratedDepth result = integrate_normals(scene.normals);
    for (std::size_t i = 0; i < 64 * 64; ++i) {
        REQUIRE(std::isfinite(result.view.map.values.data[i]));
        if (!result.view.map.mask.data[i]) CHECK(result.view.map.values.data[i] == 0);
    }
}

TEST_CASE("integrations that cannot be") {
    const Scene scene = scene_of(camera64, [](double x, double y) { return ramp(x, y, 2, 0.3, 0.2); });
    const auto run = [](const PriorView& normals, const PriorView* prior = nullptr,
                        const NormalIntegrationParams& params = {}) {
        return [&normals, prior, params] { (void)integrate_normals(normals, prior, params); };
    };
    test::check_throws<ShapeError>(run(scene.depth), {"integrate_normals", "normals.map"});
    test::check_throws<ShapeError>(run(scene.normals, &scene.normals), {"depth_prior.map"});
    PriorView empty = scene.normals;
    std::fill(empty.map.mask.data.begin(), empty.map.mask.data.end(), std::uint8_t(0));
    test::check_throws<ValueError>(run(empty), {"mask is empty"});
    PriorView shifted = scene.depth;
    std::get<OrthographicCamera>(shifted.camera).cx += 1;
    test::check_throws<ValueError>(run(scene.normals, &shifted), {"another camera"});
    shifted.camera = Camera<double>{mat3<double>(1.0), vec3<double>(0), 1, 1, 0, 0, 64, 64};
    test::check_throws<ValueError>(run(scene.normals, &shifted), {"another camera"});
    PriorView photographed = scene.normals, behind = scene.depth;
    photographed.camera = behind.camera = shifted.camera;
    behind.map.values.at(0, 3, 3) = -1;
    test::check_throws<ValueError>(run(photographed, &behind), {"depth_prior", "above 0"});
    test::check_throws<ValueError>(run(scene.normals, nullptr, {.max_iterations = 0}), {"max_iterations"});
    test::check_throws<ValueError>(run(scene.normals, nullptr, {.prior_weight = -1}), {"prior_weight"});
    test::check_throws<ValueError>(run(scene.normals, nullptr, {.sharpness = std::numeric_limits<double>::quiet_NaN()}),
                                   {"sharpness"});
    test::check_throws<ValueError>(run(scene.normals, nullptr, {.solver_tolerance = 0}), {"solver_tolerance"});
}

} // namespace
} // namespace gsh
