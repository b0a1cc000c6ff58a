// SPDX-License-Identifier: Apache-2.0
/// @file  The whole rasterizer against finite differences, which are wrong across a step. The tests avoid steps:
///        - The cut alpha >= alpha_min is a step of height alpha_min. With alpha_min = 1e-13 it is far below the
///          resolution of a difference, so Gaussians may overlap freely ("smooth" below).
///        - With the real cut, the plain reference measures how close each pixel is to a decision. The test requires
///          a distance that the steps of the differences cannot cross.
///        - Depths differ by construction, and transmittance stops only where a test intends it.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/contains.hpp"
#include "support/gradient.hpp"
#include "support/raster_scene.hpp"
#include "support/reference_rasterizer.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <utility>

using namespace gsh;

namespace {

using cpu::Serial;
using cpu::Threads;
using test::ball;
using test::make_camera;
using test::make_scene;
using test::random_weights;
using test::Rendering;
template <class T>
using Scene = test::RasterScene<T>;

template <Backend B, std::floating_point T = float>
Rendering<T> render(B& backend, const Scene<T>& scene, const RasterParams<T>& params = {},
                    const ImageView<const T>& background = {}) {
    typename Rasterizer<B, T>::Cache cache;
    Rendering<T> out(scene.camera);
    Rasterizer<B, T>(backend, params)
        .forward(scene.camera, scene.view(), {scene.background, background}, out.target(), cache);
    return out;
}

/// The gradients of a scene with respect to all of its splats, where its picture has the gradient dL_dtarget.
Scene<double> gradients_of(Serial& backend, const Scene<double>& scene, const RasterParams<double>& params,
                           const Rendering<double>& dL_dtarget) {
    const Rasterizer<Serial, double> rasterizer(backend, params);
    Rasterizer<Serial, double>::Cache cache;
    Rendering<double> out(scene.camera);
    rasterizer.forward(scene.camera, scene.view(), {scene.background}, out.target(), cache);
    Scene<double> dL = scene.zeros();
    rasterizer.backward(scene.camera, scene.view(), {scene.background}, dL_dtarget.gradient(), cache,
                        dL.gradient_view());
    return dL;
}

double dot(const Image<double>& a, const Image<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i) sum += a.data[i] * b.data[i];
    return sum;
}
double dot(const Rendering<double>& a, const Rendering<double>& b) {
    return dot(a.color, b.color) + dot(a.alpha, b.alpha) + dot(a.expected_depth, b.expected_depth) +
           dot(a.median_depth, b.median_depth);
}

double largest_difference(const Image<double>& a, const Image<double>& b) {
    REQUIRE(a.data.size() == b.data.size());
    double largest = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i) {
        const double d = std::abs(a.data[i] - b.data[i]);
        largest = d <= largest ? largest : d; // a NaN stays
    }
    return largest;
}

test::ReferenceOptions options_of(const RasterParams<double>& p) {
    return {p.alpha_min,  p.alpha_max,       p.transmittance_min,  p.dilation,
            p.near_plane, p.jacobian_margin, p.compensate_opacity, p.compensation_floor};
}

void check_against_reference(const Scene<double>& scene, const RasterParams<double>& params = {}) {
    Serial backend;
    const Rendering<double> out = render(backend, scene, params);
    const test::Reference reference =
        test::reference_rasterize(scene.camera, scene.view(), scene.background, {}, options_of(params));
    CHECK(largest_difference(out.color, reference.color) <= 1e-9);
    CHECK(largest_difference(out.alpha, reference.alpha) <= 1e-9);
    CHECK(largest_difference(out.expected_depth, reference.expected_depth) <= 1e-9);
    CHECK(largest_difference(out.median_depth, reference.median_depth) <= 1e-9);
}

/// All gradients of a random linear function of the outputs, against central differences.
void check_all_gradients(Scene<double> scene, const RasterParams<double>& params, test::Rng& rng,
                         bool background_image = false, std::size_t stride = 1) {
    using R = Rasterizer<Serial, double>;
    Serial backend;
    const R rasterizer(backend, params);
    const Rendering<double> weights = random_weights(rng, scene.camera);
    Image<double> background(3, scene.camera.height, scene.camera.width), dL_dbackground = background;
    for (double& v : background.data) v = rng.uniform();
    const ImageView<const double> image = background_image ? background.view() : ImageView<double>{};

    R::Cache cache;
    Rendering<double> out(scene.camera);
    const auto loss = [&] {
        rasterizer.forward(scene.camera, scene.view(), {scene.background, image}, out.target(), cache);
        return dot(out, weights);
    };
    loss();
    Scene<double> dL = scene.zeros();
    std::vector<CameraGradient<double>> dL_dcamera(1);
    std::vector<vec3<double>> dL_dcolor(1, vec3<double>(0));
    const BackgroundGradient<double> dL_dback{background_image ? Span<vec3<double>>{} : Span<vec3<double>>(dL_dcolor),
                                              background_image ? dL_dbackground.view() : ImageView<double>{}};
    rasterizer.backward(scene.camera, scene.view(), {scene.background, image}, weights.gradient(), cache,
                        dL.gradient_view(), dL_dcamera, dL_dback);

    test::GradientCheck options;
    options.stride = stride;
    options.tolerance = 5e-6;
    const auto check = [&](const std::string& name, Span<double> x, Span<const double> dL_dx) {
        INFO(name);
        test::check_gradient(loss, x, dL_dx, options);
    };
    check("means", test::scalars(scene.means), test::scalars(dL.means));
    options.step = 3e-7; // covariances are small numbers of square metres
    check("covariances", test::scalars(scene.covariances), test::scalars(dL.covariances));
    options.step = 6e-6;
    check("opacities", test::scalars(scene.opacities), test::scalars(dL.opacities));
    check("colors", test::scalars(scene.colors), test::scalars(dL.colors));
    if (background_image) {
        options.stride = 7;
        check("background image", background.data, dL_dbackground.data);
        options.stride = 1;
    } else {
        check("background", test::scalars(scene.background), test::scalars(dL_dcolor));
    }
    CameraGradient<double>& g = dL_dcamera[0];
    check("R", test::scalars(scene.camera.R), test::scalars(g.dL_dR));
    check("t", test::scalars(scene.camera.t), test::scalars(g.dL_dt));
    check("fx", test::scalars(scene.camera.fx), test::scalars(g.dL_dfx));
    check("fy", test::scalars(scene.camera.fy), test::scalars(g.dL_dfy));
    check("cx", test::scalars(scene.camera.cx), test::scalars(g.dL_dcx));
    check("cy", test::scalars(scene.camera.cy), test::scalars(g.dL_dcy));
}

RasterParams<double> smooth() {
    RasterParams<double> params;
    params.alpha_min = 1e-13;
    params.transmittance_min = 0;
    return params;
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

} // namespace

TEST_CASE("in double the rasterizer is the plain reference to 1e-9") {
    test::Rng rng(1);
    SUBCASE("small Gaussians") { check_against_reference(make_scene(rng, 400, 70, 50, 0.01)); }
    SUBCASE("Gaussians as large as tiles") { check_against_reference(make_scene(rng, 60, 61, 47, 0.1)); }
    SUBCASE("Gaussians larger than the image") { check_against_reference(make_scene(rng, 20, 33, 17, 2.0)); }
    SUBCASE("many tiles, so that covers need no mask") { check_against_reference(make_scene(rng, 30, 200, 150, 0.3)); }
    SUBCASE("many layers, so that pixels stop and lists exceed a batch") {
        auto scene = make_scene(rng, 700, 40, 40, 0.05);
        for (double& opacity : scene.opacities) opacity = 0.3 + 0.7 * opacity; // some saturate
        check_against_reference(scene);
    }
    SUBCASE("needles") {
        auto scene = make_scene(rng, 60, 90, 70, 0.05);
        for (auto& covariance : scene.covariances) {
            mat3<double> axes = rotation_matrix(normalize(rng.quat()));
            axes[0] *= 0.5, axes[1] *= 1e-4, axes[2] *= 1e-3;
            covariance = gram(axes);
        }
        check_against_reference(scene);
    }
    SUBCASE("compensated opacities") {
        RasterParams<double> params;
        params.compensate_opacity = true;
        check_against_reference(make_scene(rng, 300, 60, 45, 0.01), params);
    }
    SUBCASE("some behind the camera, some before the near plane, many beyond the image's sides") {
        auto scene = make_scene(rng, 200, 50, 37, 0.1);
        for (auto& mean : scene.means) mean = rng.vec(-4, 4);
        check_against_reference(scene);
    }
    SUBCASE("other thresholds and a sharper lens") {
        RasterParams<double> params;
        params.alpha_min = 0.02, params.alpha_max = 0.8, params.transmittance_min = 0.05;
        params.dilation = 0.05, params.near_plane = 2.1, params.jacobian_margin = 0;
        check_against_reference(make_scene(rng, 300, 50, 50, 0.05), params);
    }
}

TEST_CASE("the lists of tiles hold little more than the tiles in which a splat passes the cut") {
    test::Rng rng(27);
    Serial backend;
    const auto check = [&](Scene<double> scene, const std::string& name) {
        for (auto& covariance : scene.covariances) { // slanted, three times as long as wide
            mat3<double> axes = rotation_matrix(normalize(rng.quat()));
            axes[0] *= 0.09, axes[1] *= 0.03, axes[2] *= 0.03;
            covariance = gram(axes);
        }
        Rasterizer<Serial, double>::Cache cache;
        Rendering<double> out(scene.camera);
        Rasterizer<Serial, double>(backend, {})
            .forward(scene.camera, scene.view(), {scene.background, {}}, out.target(), cache);
        const test::ReferenceOptions options;
        std::size_t pairs = 0;
        for (std::size_t i = 0; i < scene.size(); ++i) {
            test::ReferenceSplat splat;
            if (!test::reference_project(scene.camera, scene.view(), i, options, splat)) continue;
            std::set<std::pair<int, int>> tiles;
            for (int y = 0; y < scene.camera.height; ++y)
                for (int x = 0; x < scene.camera.width; ++x) {
                    const double dx = x + 0.5 - splat.px, dy = y + 0.5 - splat.py;
                    const double q = splat.conic_a * dx * dx + 2 * splat.conic_b * dx * dy + splat.conic_c * dy * dy;
                    if (splat.opacity * std::exp(-0.5 * q) >= options.alpha_min) tiles.insert({x / 16, y / 16});
                }
            pairs += tiles.size();
        }
        INFO(name << ": " << cache.status[0].pairs << " pairs, of which " << pairs << " have a pixel");
        CHECK(pairs > 300);
        CHECK(cache.status[0].pairs >= pairs); // in the other test, a tile that is missing shows in the picture
        CHECK(static_cast<double>(cache.status[0].pairs) < 1.05 * static_cast<double>(pairs));
    };
    check(make_scene(rng, 60, 150, 120, 0.1), "covers with a mask");
    check(make_scene(rng, 12, 500, 400, 0.1), "larger ones");
}

TEST_CASE("in float it is the reference to 1e-3 but where a decision hangs by a thread") {
    test::Rng rng(2);
    Serial backend;
    const auto check = [&](const Scene<double>& made) {
        const Scene<float> scene = made.cast<float>();
        const Rendering<float> out = render(backend, scene);
        const Scene<double> exact = scene.cast<double>(); // the same numbers
        const test::Reference reference = test::reference_rasterize(exact.camera, exact.view(), exact.background);
        int outside = 0;
        double largest = 0;
        for (int y = 0; y < scene.camera.height; ++y)
            for (int x = 0; x < scene.camera.width; ++x) {
                double difference = 0;
                for (int c = 0; c < 3; ++c)
                    difference = std::max(difference, std::abs(out.color.at(c, y, x) - reference.color.at(c, y, x)));
                if (difference <= 1e-3) {
                    largest = std::max(largest, difference);
                    continue;
                }
                ++outside;
                INFO("pixel " << x << ", " << y << " differs by " << difference << "; margins "
                              << reference.cut_margin.at(0, y, x) << ", " << reference.depth_gap.at(0, y, x));
                CHECK((reference.cut_margin.at(0, y, x) < 1e-4 || reference.depth_gap.at(0, y, x) < 1e-6));
            }
        INFO("largest difference elsewhere " << largest);
        CHECK(outside <= scene.camera.width * scene.camera.height / 1000);
        CHECK(largest < 5e-4);
    };
    SUBCASE("small Gaussians in a wide image, where positions have many digits") {
        check(make_scene(rng, 1500, 1200, 40, 0.004, 0.3));
    }
    SUBCASE("large ones") { check(make_scene(rng, 150, 200, 150, 0.1)); }
    SUBCASE("needles across the image") {
        auto scene = make_scene(rng, 200, 300, 100, 0.05);
        for (auto& covariance : scene.covariances) {
            mat3<double> axes = rotation_matrix(normalize(rng.quat()));
            axes[0] *= 0.1, axes[1] *= 2e-3, axes[2] *= 2e-3;
            covariance = gram(axes);
        }
        check(scene);
    }
}

TEST_CASE("backward is the gradient of forward: splats, background, camera") {
    test::Rng rng(3);
    SUBCASE("smooth, overlapping at will") { check_all_gradients(make_scene(rng, 12, 33, 17, 0.08), smooth(), rng); }
    SUBCASE("smooth, over a background image") {
        check_all_gradients(make_scene(rng, 8, 19, 21, 0.1), smooth(), rng, true);
    }
    SUBCASE("smooth, compensated") {
        auto params = smooth();
        params.compensate_opacity = true;
        check_all_gradients(make_scene(rng, 10, 33, 17, 0.08), params, rng);
    }
    SUBCASE("smooth, beyond the Jacobian's clamp on every side") {
        Scene<double> scene;
        scene.camera = make_camera(24, 20);
        int i = 0;
        for (const auto& p : {vec3<double>(-1.6, 0, 0), vec3<double>(1.7, 0.1, 0.1), vec3<double>(0, -1.5, -0.1),
                              vec3<double>(0.1, 1.3, 0.2), vec3<double>(1.5, 1.4, 0.3)}) {
            const double radius = 0.6 + 0.05 * i++;
            sym3<double> covariance = ball(radius);
            covariance.xy = 0.1 * radius, covariance.yz = -0.05;
            scene.add(p, covariance, 0.7, rng.vec(0, 1));
        }
        check_all_gradients(scene, smooth(), rng);
    }
    SUBCASE("the real cut and stop, no pixel near a decision") {
        // Seeds are tried until the reference finds all margins wide. The choice of the seed does not matter.
        for (std::uint64_t seed = 1;; ++seed) {
            REQUIRE(seed < 200);
            test::Rng tried(seed);
            auto scene = make_scene(tried, 10, 20, 18, 0.12, 0.3);
            for (double& opacity : scene.opacities) opacity = 0.8 + 0.19 * opacity; // dense, so that pixels stop
            const auto reference = test::reference_rasterize(scene.camera, scene.view(), scene.background);
            double margin = 1, stop = 1;
            for (const double m : reference.cut_margin.data) margin = std::min(margin, m);
            for (const double m : reference.stop_margin.data) stop = std::min(stop, m);
            double opaque = 0;
            for (const double a : reference.alpha.data) opaque = std::max(opaque, a);
            if (margin < 1.5e-3 || stop < 1.5e-3 || opaque < 0.999) continue;
            check_all_gradients(scene, {}, tried);
            break;
        }
    }
}

TEST_CASE("nothing passes back through the cap on alpha, and saturated splats still pass colour") {
    using R = Rasterizer<Serial, double>;
    Serial backend;
    test::Rng rng(4);
    Scene<double> scene;
    scene.camera = make_camera(8, 8);
    scene.camera.R = mat3<double>(1.0), scene.camera.t = vec3<double>(0, 0, 2);
    scene.camera.cx = scene.camera.cy = 4;
    scene.add(vec3<double>(0), ball(50), 1.0, vec3<double>(0.3, 0.6, 0.9)); // opacity above the cap at every pixel
    scene.add(vec3<double>(0, 0, 0.5), ball(1), 0.5, vec3<double>(0.9, 0.1, 0.2));
    R::Cache cache;
    Rendering<double> out(scene.camera);
    const R rasterizer(backend);
    rasterizer.forward(scene.camera, scene.view(), {}, out.target(), cache);
    Scene<double> dL = scene.zeros();
    Rendering<double> weights(scene.camera);
    std::fill(weights.color.data.begin(), weights.color.data.end(), 1.0);
    rasterizer.backward(scene.camera, scene.view(), {}, {weights.color.view()}, cache, dL.gradient_view());
    CHECK(dL.means[0] == vec3<double>(0));
    CHECK(dL.covariances[0].xx == 0);
    CHECK(dL.opacities[0] == 0);
    CHECK(dL.colors[0].x == doctest::Approx(64 * 0.99));
    CHECK(dL.opacities[1] > 0); // visible through the remaining 1% of the first one
    CHECK(cache.screen_gradient_norms[0] == 0);
    CHECK(out.median_depth.at(0, 3, 3) == 2);
    check_all_gradients(scene, smooth(), rng);
}

TEST_CASE("a splat that would take the transmittance below the limit is left out, and all behind it") {
    Serial backend;
    Scene<double> scene;
    scene.camera = make_camera(5, 4);
    scene.camera.R = mat3<double>(1.0), scene.camera.t = vec3<double>(0);
    for (int i = 0; i < 4; ++i)
        scene.add(vec3<double>(0, 0, 4 - i), ball(100), i == 0 ? 0.01 : 1.0, vec3<double>(i == 3, i == 2, i == 1));
    // Front to back, 0.99 and 0.99 leave 1e-4, or slightly more by rounding. The third would leave 1e-6.
    auto params = RasterParams<double>{};
    params.transmittance_min = 0.9999e-4;
    const Rendering<double> out = render(backend, scene, params);
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 5; ++x) {
            CHECK(out.color.at(0, y, x) == doctest::Approx(0.99 + 1e-4 * scene.background.x));
            CHECK(out.color.at(1, y, x) == doctest::Approx(0.0099 + 1e-4 * scene.background.y));
            CHECK(out.color.at(2, y, x) == doctest::Approx(1e-4 * scene.background.z));
            CHECK(out.alpha.at(0, y, x) == doctest::Approx(0.9999));
        }
}

TEST_CASE("with gradient_transmittance_min, a pixel passes the exact gradient to splats in the light, no other") {
    constexpr double least = 0.3;
    Serial backend;
    test::Rng rng(6);
    auto scene = make_scene(rng, 60, 20, 18, 0.12);
    for (double& opacity : scene.opacities) opacity = 0.4 + 0.5 * opacity;
    scene.add(0.2 * scene.camera.center(), ball(0.3), 0.97, vec3<double>(0.5));   // a large splat in the middle,
    scene.add(-0.2 * scene.camera.center(), ball(1e-3), 0.9, vec3<double>(0.1)); // and a small one behind it
    const std::size_t n = scene.means.size();
    std::vector<std::size_t> order(n); // front to back
    std::iota(order.begin(), order.end(), std::size_t(0));
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
        return to_camera(scene.camera, scene.means[a]).z < to_camera(scene.camera, scene.means[b]).z;
    });
    std::vector<Image<double>> in_front(n); // 1 - the light that reaches each splat
    Scene<double> front = scene;
    front.means.clear(), front.covariances.clear(), front.opacities.clear(), front.colors.clear();
    for (const std::size_t i : order) {
        in_front[i] = render(backend, front, smooth()).alpha;
        front.add(scene.means[i], scene.covariances[i], scene.opacities[i], scene.colors[i]);
    }

    const Rendering<double> weights = random_weights(rng, scene.camera);
    const auto gradients = [&](double limit, const Rendering<double>& dL_dtarget) {
        auto params = smooth();
        params.gradient_transmittance_min = limit;
        const Scene<double> dL = gradients_of(backend, scene, params, dL_dtarget);
        std::vector<std::vector<double>> rows(n); // all numbers of each splat
        for (std::size_t i = 0; i < n; ++i) {
            const sym3<double>& c = dL.covariances[i];
            rows[i] = {dL.means[i].x, dL.means[i].y, dL.means[i].z, c.xx,           c.xy,           c.xz,          c.yy,
                       c.yz,          c.zz,          dL.opacities[i], dL.colors[i].x, dL.colors[i].y, dL.colors[i].z};
        }
        return rows;
    };
    std::vector<std::vector<double>> expected(n, std::vector<double>(13, 0.0));
    std::size_t dark = 0, lit = 0;
    for (int y = 0; y < scene.camera.height; ++y)
        for (int x = 0; x < scene.camera.width; ++x) {
            Rendering<double> of_pixel(scene.camera);
            for (Image<double>* image :
                 {&of_pixel.color, &of_pixel.alpha, &of_pixel.expected_depth, &of_pixel.median_depth})
                std::fill(image->data.begin(), image->data.end(), 0.0);
            const auto copy = [&](Image<double>& to, const Image<double>& from) {
                for (int c = 0; c < from.channels; ++c) to.at(c, y, x) = from.at(c, y, x);
            };
            copy(of_pixel.color, weights.color), copy(of_pixel.alpha, weights.alpha);
            copy(of_pixel.expected_depth, weights.expected_depth), copy(of_pixel.median_depth, weights.median_depth);
            const auto exact = gradients(0, of_pixel);
            for (std::size_t i = 0; i < n; ++i) {
                const bool sees = 1 - in_front[i].at(0, y, x) >= least;
                (sees ? lit : dark) += exact[i][9] != 0;
                for (std::size_t k = 0; k < 13; ++k) expected[i][k] += sees ? exact[i][k] : 0;
            }
        }
    CHECK(dark > 500);
    CHECK(lit > 500);
    const auto found = gradients(least, weights);
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < 13; ++k) {
            CAPTURE(i);
            CAPTURE(k);
            CHECK(found[i][k] == doctest::Approx(expected[i][k]).epsilon(1e-9));
        }
    const auto all = gradients(0, weights);
    CHECK(all[n - 1][9] != 0);
    CHECK(found[n - 1] == std::vector<double>(13, 0.0));
}

TEST_CASE("a gradient_transmittance_min of 1 leaves the gradient to what nothing stands before") {
    Serial backend;
    test::Rng rng(8);
    Scene<double> scene;
    scene.camera = make_camera(8, 8);
    scene.camera.R = mat3<double>(1.0), scene.camera.t = vec3<double>(0);
    scene.add(vec3<double>(0, 0, 2), ball(1), 0.5, vec3<double>(0.3, 0.6, 0.7));
    const Rendering<double> weights = random_weights(rng, scene.camera);
    const auto gradients = [&](double limit) {
        RasterParams<double> params;
        params.gradient_transmittance_min = limit;
        return gradients_of(backend, scene, params, weights);
    };
    const Scene<double> alone = gradients(0), alone_at_1 = gradients(1);
    CHECK(alone.opacities[0] != 0);
    CHECK(alone_at_1.opacities == alone.opacities);
    CHECK(alone_at_1.colors == alone.colors);
    CHECK(alone_at_1.means == alone.means);
    scene.add(vec3<double>(0, 0, 3), ball(0.5), 0.5, vec3<double>(0.9, 0.1, 0.2)); // behind it
    CHECK(gradients(0).opacities[1] != 0);
    CHECK(gradients(1).opacities[1] == 0);
}

TEST_CASE("depth: equal depths keep the order of their index") {
    Serial backend;
    for (const bool swapped : {false, true}) {
        Scene<double> scene;
        scene.camera = make_camera(16, 16);
        const vec3<double> red(1, 0, 0), green(0, 1, 0);
        scene.add(vec3<double>(0), ball(1), 0.9, swapped ? green : red);
        scene.add(vec3<double>(0), ball(1), 0.9, swapped ? red : green);
        const Rendering<double> out = render(backend, scene);
        const double front = out.color.at(swapped ? 1 : 0, 8, 8), back = out.color.at(swapped ? 0 : 1, 8, 8);
        CHECK(front > 5 * back);
    }
}

TEST_CASE("depth outputs: expected over alpha and median lie between the splats, 0 where nothing is") {
    Serial backend;
    Scene<double> scene;
    scene.camera = make_camera(64, 48);
    scene.camera.R = mat3<double>(1.0), scene.camera.t = vec3<double>(0);
    scene.camera.cx = 32, scene.camera.cy = 24;
    scene.add(vec3<double>(0, 0, 2), ball(0.1), 0.4, vec3<double>(1));
    scene.add(vec3<double>(0, 0, 3), ball(0.1), 0.4, vec3<double>(1));
    const Rendering<double> out = render(backend, scene);
    const double w0 = out.color.at(0, 24, 32);
    CHECK(w0 > 0);
    const double mean_depth = out.expected_depth.at(0, 24, 32) / out.alpha.at(0, 24, 32);
    CHECK(mean_depth > 2);
    CHECK(mean_depth < 2.5);
    CHECK(out.median_depth.at(0, 24, 32) == 3); // 0.6 after the first, 0.36 after the second
    CHECK(out.median_depth.at(0, 24, 37) == 0); // never below one half
    CHECK(out.expected_depth.at(0, 0, 0) == 0);
    CHECK(out.alpha.at(0, 0, 0) == 0);
}

TEST_CASE("a principal point moved by whole pixels moves the image") {
    test::Rng rng(6);
    Serial backend;
    auto scene = make_scene(rng, 150, 80, 64, 0.03);
    scene.camera.cx = 40, scene.camera.cy = 32;
    auto params = RasterParams<double>{};
    params.jacobian_margin = 100; // without the clamp, which depends on the image's frame and not on the scene
    const Rendering<double> centred = render(backend, scene, params);
    scene.camera.cx += 7, scene.camera.cy -= 5;
    const Rendering<double> shifted = render(backend, scene, params);
    double largest = 0;
    for (int y = 0; y + 5 < 64; ++y)
        for (int x = 0; x + 7 < 80; ++x)
            for (int c = 0; c < 3; ++c)
                largest = std::max(largest, std::abs(centred.color.at(c, y + 5, x) - shifted.color.at(c, y, x + 7)));
    CHECK(largest < 1e-11);
}

TEST_CASE("nothing to draw leaves the background") {
    Serial backend;
    test::Rng rng(7);
    Scene<float> scene = make_scene(rng, 3, 33, 17, 0.1).cast<float>();
    SUBCASE("no splats") { scene = make_scene(rng, 0, 33, 17, 0.1).cast<float>(); }
    SUBCASE("all behind") { scene.camera.t.z = -5; }
    SUBCASE("all at the near plane") {
        for (auto& mean : scene.means) mean = vec3<float>(0);
        scene.camera.t = vec3<float>(0, 0, 0.2f);
    }
    SUBCASE("all too faint") { std::fill(scene.opacities.begin(), scene.opacities.end(), 0.0039f); }
    SUBCASE("all beside the image") {
        for (auto& mean : scene.means) mean.x += 30;
    }
    using R = Rasterizer<Serial, float>;
    R::Cache cache;
    Rendering<float> out(scene.camera);
    const R rasterizer(backend);
    Image<float> background(3, 17, 33);
    for (float& v : background.data) v = static_cast<float>(rng.uniform());
    const Background<float> over{vec3<float>(0), background.view()};
    rasterizer.forward(scene.camera, scene.view(), over, out.target(), cache);
    CHECK(same_bits(out.color.data, background.data));
    for (const float a : out.alpha.data) CHECK(a == 0);
    for (const float d : out.expected_depth.data) CHECK(d == 0);
    for (std::size_t i = 0; i < scene.size(); ++i) CHECK(cache.visible[i] == 0);

    Scene<float> dL = scene.zeros();
    Image<float> dL_dbackground(3, 17, 33);
    rasterizer.backward(scene.camera, scene.view(), over, out.gradient(), cache, dL.gradient_view(), {},
                        {{}, dL_dbackground.view()});
    CHECK(same_bits(dL_dbackground.data, out.color.data));
    for (const auto& g : dL.means) CHECK(g == vec3<float>(0));
}

TEST_CASE_TEMPLATE("Threads are Serial bit for bit, and a second backward doubles", T, float, double) {
    test::Rng rng(8);
    // Enough splats for several chunks of every pass; sizes that are no multiple of a tile.
    const Scene<T> scene = make_scene(rng, 9000, 150, 133, 0.012).template cast<T>();
    const Rendering<T> weights = random_weights(rng, scene.camera);

    const auto run = [&](auto& backend, int backward_passes) {
        using R = Rasterizer<std::remove_cvref_t<decltype(backend)>, T>;
        typename R::Cache cache;
        const R rasterizer(backend);
        Rendering<T> out(scene.camera);
        Scene<T> dL = scene.zeros();
        std::vector<CameraGradient<T>> dL_dcamera(1);
        std::vector<vec3<T>> dL_dbackground(1, vec3<T>(0));
        rasterizer.forward(scene.camera, scene.view(), {scene.background}, out.target(), cache);
        for (int i = 0; i < backward_passes; ++i)
            rasterizer.backward(scene.camera, scene.view(), {scene.background}, weights.gradient(), cache,
                                dL.gradient_view(), dL_dcamera, {dL_dbackground});
        std::vector<T> all;
        const auto append = [&](const auto& values) {
            const T* data = reinterpret_cast<const T*>(values.data());
            all.insert(all.end(), data, data + values.size() * sizeof(values[0]) / sizeof(T));
        };
        append(out.color.data), append(out.alpha.data), append(out.expected_depth.data);
        append(out.median_depth.data);
        const std::size_t images = all.size();
        append(dL.means), append(dL.covariances), append(dL.opacities), append(dL.colors);
        append(dL_dcamera), append(dL_dbackground);
        if (backward_passes == 2)
            for (std::size_t i = images; i < all.size(); ++i) all[i] /= 2;
        all.insert(all.end(), cache.screen_gradient_norms.begin(), cache.screen_gradient_norms.end());
        return all;
    };
    Serial serial;
    const std::vector<T> expected = run(serial, 1);
    CHECK(same_bits(run(serial, 2), expected));
    for (const std::size_t threads : {1, 2, 3, 7}) {
        Threads backend(threads);
        INFO(threads << " threads");
        CHECK(same_bits(run(backend, 1), expected));
    }
}

TEST_CASE("gradients that nobody asks for are skipped") {
    Serial backend;
    test::Rng rng(9);
    const Scene<double> scene = make_scene(rng, 30, 40, 30, 0.05);
    const Rendering<double> weights = random_weights(rng, scene.camera);
    using R = Rasterizer<Serial, double>;
    R::Cache cache;
    const R rasterizer(backend);
    Image<double> color(3, 30, 40);
    rasterizer.forward(scene.camera, scene.view(), {}, {color.view()}, cache);
    Scene<double> all = scene.zeros(), some = all;
    rasterizer.backward(scene.camera, scene.view(), {}, {weights.color.view()}, cache, all.gradient_view());
    rasterizer.backward(scene.camera, scene.view(), {}, {weights.color.view()}, cache, {{}, {}, some.opacities, {}});
    CHECK(same_bits(all.opacities, some.opacities));
    CHECK(some.means[0] == vec3<double>(0));
    int visible = 0;
    for (std::size_t i = 0; i < scene.size(); ++i) {
        visible += cache.visible[i];
        CHECK((cache.screen_gradient_norms[i] > 0) == (all.colors[i] != vec3<double>(0)));
    }
    CHECK(visible > 20);
}

TEST_CASE("what does not fit is refused with a name") {
    Serial backend;
    test::Rng rng(10);
    using R = Rasterizer<Serial, double>;
    R::Cache cache;
    const Scene<double> good = make_scene(rng, 5, 20, 10, 0.1);
    Image<double> color(3, 10, 20), wrong(3, 20, 10);
    const auto forward = [&](const Scene<double>& scene, const Image<double>& image, RasterParams<double> params = {}) {
        R(backend, params).forward(scene.camera, scene.view(), {}, {const_cast<Image<double>&>(image).view()}, cache);
    };
    const auto message = [&](const Scene<double>& scene, RasterParams<double> params = {}) {
        try {
            forward(scene, color, params);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("nothing thrown");
    };
    forward(good, color);

    SUBCASE("shapes") {
        Scene<double> scene = good;
        CHECK_THROWS_AS(forward(good, wrong), ShapeError);
        scene.opacities.pop_back();
        CHECK_THROWS_WITH_AS(forward(scene, color),
                             "Rasterizer::forward: opacities has 4 elements, expected 5; store one opacity per mean",
                             ShapeError);
        scene = good, scene.covariances.pop_back();
        CHECK_THROWS_AS(forward(scene, color), ShapeError);
        scene = good, scene.colors.pop_back();
        CHECK_THROWS_AS(forward(scene, color), ShapeError);
        Image<double> two(2, 10, 20);
        const R rasterizer(backend);
        for (int plane = 0; plane < 3; ++plane) {
            RenderTarget<double> target{color.view()};
            (plane == 0 ? target.alpha : plane == 1 ? target.expected_depth : target.median_depth) = two.view();
            CHECK_THROWS_AS(rasterizer.forward(good.camera, good.view(), {}, target, cache), ShapeError);
        }
        CHECK_THROWS_AS(rasterizer.forward(good.camera, good.view(), {{}, wrong.view()}, {color.view()}, cache),
                        ShapeError);
        Scene<double> dL = good.zeros();
        dL.means.pop_back();
        CHECK_THROWS_AS(rasterizer.backward(good.camera, good.view(), {}, {color.view()}, cache, dL.gradient_view()),
                        ShapeError);
        CHECK_THROWS_AS(rasterizer.backward(good.camera, good.view(), {}, {wrong.view()}, cache, {}), ShapeError);
        const Scene<double> other = make_scene(rng, 6, 20, 10, 0.1), larger = make_scene(rng, 5, 21, 10, 0.1);
        CHECK_THROWS_AS(rasterizer.backward(other.camera, other.view(), {}, {color.view()}, cache, {}), ShapeError);
        CHECK_THROWS_AS(rasterizer.backward(larger.camera, larger.view(), {}, {}, cache, {}), ValueError);
    }
    SUBCASE("Gaussians that are not finite, the first one named, the picture untouched") {
        const double bad[] = {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()};
        for (const double value : bad)
            for (int member = 0; member < 4; ++member) {
                Scene<double> scene = good;
                for (const std::size_t i : {2, 4}) {
                    if (member == 0) scene.means[i].y = value;
                    if (member == 1) scene.covariances[i].yz = value;
                    if (member == 2) scene.opacities[i] = value;
                    if (member == 3) scene.colors[i].z = value;
                }
                const auto before = color.data;
                CHECK(message(scene) ==
                      test::contains("Gaussian 2 has a mean, covariance, opacity or color that is not finite (2 "
                                     "such"));
                CHECK(message(scene) != test::contains("learning")); // a picture learns nothing
                CHECK(cache.status[0].nonfinite == 2);
                CHECK(same_bits(before, color.data));
            }
        Scene<double> dL = good.zeros();
        CHECK_THROWS_AS(R(backend).backward(good.camera, good.view(), {}, {}, cache, dL.gradient_view()), ShapeError);
    }
    SUBCASE("absurd numbers of pairs") {
        Scene<double> scene = good;
        scene.camera.width = scene.camera.height = 20000; // 1.5 million tiles
        scene.camera.fx = scene.camera.fy = 20000;
        for (int i = 0; i < 60; ++i) scene.add(vec3<double>(0), ball(1e6), 0.5, vec3<double>(0));
        cpu::Buffer<double> none;
        const RasterParams<double> params;
        R::Cache fresh;
        CHECK_FALSE(cpu::project_splats(backend, scene.camera, scene.view(), params, fresh));
        CHECK(fresh.status[0].pairs > 60u * 1250 * 1250);
        CHECK(fresh.scratch.instances.size() == 0);
        RasterParams<double> few;
        few.max_pairs = 3;
        CHECK(message(good, few) == test::contains("tiles in all, expected at most 3"));
    }
    SUBCASE("cameras") {
        Scene<double> scene = good;
        scene.camera.fx = 0;
        CHECK(message(scene) == test::contains("focal lengths"));
        scene = good, scene.camera.R[1].y = std::numeric_limits<double>::quiet_NaN();
        CHECK(message(scene) == test::contains("not finite"));
        scene = good, scene.camera.width = 0;
        CHECK(message(scene) == test::contains("image is empty"));
        scene.camera.width = 1 << 21;
        CHECK(message(scene) == test::contains("1048560"));
    }
    SUBCASE("settings") {
        const auto refused = [&](auto&& set) {
            RasterParams<double> params;
            set(params);
            CHECK_THROWS_AS(R(backend, params), ValueError);
        };
        refused([](auto& p) { p.alpha_min = 0; });
        refused([](auto& p) { p.alpha_min = 0.995; });
        refused([](auto& p) { p.alpha_max = 1; });
        refused([](auto& p) { p.transmittance_min = 1; });
        refused([](auto& p) { p.gradient_transmittance_min = 1.5; });
        refused([](auto& p) { p.near_plane = 0; });
        refused([](auto& p) { p.dilation = -0.1; });
        refused([](auto& p) { p.compensation_floor = 0; });
        refused([](auto& p) { p.max_pairs = 1ull << 33; });
    }
}

TEST_CASE("finite but absurd Gaussians draw nothing and break nothing") {
    Serial backend;
    test::Rng rng(11);
    Scene<float> scene = make_scene(rng, 8, 40, 30, 0.05).cast<float>();
    const float huge = 1e38f;
    scene.means[0] = vec3<float>(huge, -huge, 1);
    scene.means[1] = vec3<float>(0, 0, huge);
    scene.covariances[2] = {huge, huge, huge, huge, huge, huge};
    scene.covariances[3] = {-1, 0, 0, -1, 0, -1}; // not a covariance
    scene.covariances[4] = {0, 0, 0, 0, 0, 0};    // a point, so only the dilation remains
    scene.opacities[5] = -3;
    scene.opacities[6] = huge;
    scene.colors[7] = vec3<float>(-1, 2, 0);
    const Rendering<float> out = render(backend, scene);
    for (const float v : out.color.data) CHECK(std::isfinite(v));
}
