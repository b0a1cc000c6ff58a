// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/render/screen_gradient.hpp>

#include "support/gradient.hpp"
#include "support/raster_scene.hpp"

#include <cmath>
#include <vector>

using namespace gsh;

namespace {

template <class T>
struct Screen {
    std::vector<vec2<T>> means2d, absolute;
    std::vector<sym2<T>> conics;
    std::vector<T> depths, opacities;
    std::vector<vec3<T>> colors;

    explicit Screen(std::size_t n)
        : means2d(n, vec2<T>(0)), absolute(n, vec2<T>(0)), conics(n, sym2<T>{}), depths(n, T(0)), opacities(n, T(0)),
          colors(n, vec3<T>(0)) {}
    ScreenGradient<T> view(bool with_absolute = true) {
        return {means2d, conics, depths, opacities, colors, with_absolute ? Span<vec2<T>>(absolute) : Span<vec2<T>>()};
    }
    std::vector<T> numbers() const {
        std::vector<T> all(depths);
        all.insert(all.end(), opacities.begin(), opacities.end());
        for (const auto& v : means2d) all.insert(all.end(), {v.x, v.y});
        for (const auto& v : absolute) all.insert(all.end(), {v.x, v.y});
        for (const auto& v : conics) all.insert(all.end(), {v.xx, v.xy, v.yy});
        for (const auto& v : colors) all.insert(all.end(), {v.x, v.y, v.z});
        return all;
    }
};

template <std::floating_point T, Backend B>
Screen<T> screen_gradient(B& backend, const test::RasterScene<T>& scene, const RasterParams<T>& params,
                          const test::Rendering<T>& weights, int passes = 1) {
    const Rasterizer<B, T> rasterizer(backend, params);
    typename Rasterizer<B, T>::Cache cache;
    test::Rendering<T> out(scene.camera);
    rasterizer.forward(scene.camera, scene.view(), {scene.background, {}}, out.target(), cache);
    Screen<T> screen(scene.size());
    for (int pass = 0; pass < passes; ++pass)
        rasterizer.backward_to_screen({scene.background, {}}, weights.gradient(), cache, screen.view());
    return screen;
}

} // namespace

TEST_CASE("a conic's gradient by moments, and back through the inverse, is that of the covariance") {
    test::Rng rng(5);
    sym2<double> covariance{2.5, 0.7, 1.4};
    const auto inverse = [](const sym2<double>& s) {
        const double det = s.xx * s.yy - s.xy * s.xy;
        return sym2<double>{s.yy / det, -s.xy / det, s.xx / det};
    };
    sym2<double> conic = inverse(covariance);
    const Whitening<double> W = whiten(covariance);
    SplatMoments<double> moments{};
    std::vector<vec3<double>> pixels = rng.vecs(30, -2, 2); // dx, dy, G at the splat as it is
    std::vector<double> scale;                              // G over exp
    const auto power = [&](const sym2<double>& c, const vec3<double>& p) {
        return -0.5 * (c.xx * p.x * p.x + 2 * c.xy * p.x * p.y + c.yy * p.y * p.y);
    };
    for (const auto& p : pixels) {
        const double u = W.ux * p.x + W.uy * p.y, v = W.vy * p.y;
        moments.uu += p.z * u * u, moments.uv += p.z * u * v, moments.vv += p.z * v * v;
        scale.push_back(p.z / std::exp(power(conic, p)));
    }
    const auto loss = [&] {
        double sum = 0;
        for (std::size_t i = 0; i < pixels.size(); ++i) sum += scale[i] * std::exp(power(conic, pixels[i]));
        return sum;
    };
    sym2<double> dL_dconic = conic_gradient(W, moments);
    test::check_gradient(loss, test::scalars(conic), test::scalars(dL_dconic));

    sym2<double> dL_dcovariance = conic_backward(conic, dL_dconic);
    const auto loss_of_covariance = [&] {
        conic = inverse(covariance);
        return loss();
    };
    test::check_gradient(loss_of_covariance, test::scalars(covariance), test::scalars(dL_dcovariance));
    Projection<double> dL{};
    moments_backward(W, moments, dL);
    CHECK(dL.covariance.xx == doctest::Approx(dL_dcovariance.xx));
    CHECK(dL.covariance.xy == doctest::Approx(dL_dcovariance.xy));
    CHECK(dL.covariance.yy == doctest::Approx(dL_dcovariance.yy));
}

TEST_CASE("backward_to_screen, then project_backward, is backward") {
    using R = Rasterizer<cpu::Serial, double>;
    test::Rng rng(11);
    const auto scene = test::make_scene(rng, 40, 50, 37, 0.08);
    RasterParams<double> params;
    SUBCASE("plain") {}
    SUBCASE("compensated") { params.compensate_opacity = true; }
    const auto weights = test::random_weights(rng, scene.camera);
    cpu::Serial backend;
    const R rasterizer(backend, params);
    R::Cache cache;
    test::Rendering<double> out(scene.camera);
    const Background<double> background{scene.background, {}};
    rasterizer.forward(scene.camera, scene.view(), background, out.target(), cache);
    auto expected = scene.zeros();
    CameraGradient<double> expected_camera;
    vec3<double> expected_background(0), dL_dbackground(0);
    rasterizer.backward(scene.camera, scene.view(), background, weights.gradient(), cache, expected.gradient_view(),
                        Span<CameraGradient<double>>(&expected_camera, 1),
                        {.color = Span<vec3<double>>(&expected_background, 1)});

    Screen<double> screen(scene.size());
    rasterizer.backward_to_screen(background, weights.gradient(), cache, screen.view(false),
                                  {.color = Span<vec3<double>>(&dL_dbackground, 1)});
    auto found = scene.zeros();
    CameraGradient<double> camera;
    int visible = 0;
    for (std::size_t i = 0; i < scene.size(); ++i) {
        if (!cache.visible[i]) continue;
        ++visible;
        const Projection<double> p = project(scene.camera, scene.means[i], scene.covariances[i], params);
        const double det = determinant(p.covariance);
        const sym2<double> conic{p.covariance.yy / det, -p.covariance.xy / det, p.covariance.xx / det};
        Projection<double> dL{};
        dL.mean2d = screen.means2d[i], dL.depth = screen.depths[i];
        dL.covariance = conic_backward(conic, screen.conics[i]);
        dL.opacity_factor = screen.opacities[i] * scene.opacities[i];
        project_backward(scene.camera, scene.means[i], scene.covariances[i], params, dL, found.means[i],
                         found.covariances[i], &camera);
        found.opacities[i] = screen.opacities[i] * p.opacity_factor;
        found.colors[i] = screen.colors[i];
    }
    CHECK(visible > 20);
    const auto compare = [](Span<const double> a, Span<const double> b) {
        double largest = 0, difference = 0;
        for (std::size_t i = 0; i < a.size(); ++i) {
            largest = std::max(largest, std::abs(b[i]));
            difference = std::max(difference, std::abs(a[i] - b[i]));
        }
        CHECK(largest > 0);
        CHECK(difference <= 1e-10 * largest);
    };
    compare(test::scalars(found.means), test::scalars(expected.means));
    compare(test::scalars(found.covariances), test::scalars(expected.covariances));
    compare(test::scalars(found.opacities), test::scalars(expected.opacities));
    compare(test::scalars(found.colors), test::scalars(expected.colors));
    compare(test::scalars(camera), test::scalars(expected_camera));
    compare(test::scalars(dL_dbackground), test::scalars(expected_background));
}

TEST_CASE("absolute gradients are sums over pixels of absolute values") {
    test::Rng rng(12);
    const auto scene = test::make_scene(rng, 12, 20, 17, 0.1);
    const auto weights = test::random_weights(rng, scene.camera);
    cpu::Serial backend;
    const Screen<double> all = screen_gradient(backend, scene, {}, weights);
    std::vector<vec2<double>> expected(scene.size(), vec2<double>(0));
    for (std::size_t pixel = 0; pixel < weights.alpha.data.size(); ++pixel) {
        test::Rendering<double> one(scene.camera);
        const auto take = [&](const Image<double>& from, Image<double>& to) {
            for (std::size_t i = 0; i < to.data.size(); ++i)
                to.data[i] = i % weights.alpha.data.size() == pixel ? from.data[i] : 0;
        };
        take(weights.color, one.color), take(weights.alpha, one.alpha);
        take(weights.expected_depth, one.expected_depth), take(weights.median_depth, one.median_depth);
        const Screen<double> share = screen_gradient(backend, scene, {}, one);
        for (std::size_t i = 0; i < scene.size(); ++i)
            expected[i] += vec2<double>(std::abs(share.means2d[i].x), std::abs(share.means2d[i].y));
    }
    for (std::size_t i = 0; i < scene.size(); ++i) {
        CHECK(all.absolute[i].x == doctest::Approx(expected[i].x));
        CHECK(all.absolute[i].y == doctest::Approx(expected[i].y));
        CHECK(all.absolute[i].x >= std::abs(all.means2d[i].x));
    }
}

TEST_CASE_TEMPLATE("backward_to_screen: Threads are Serial bit for bit, and a second pass doubles", T, float, double) {
    test::Rng rng(13);
    const auto scene = test::make_scene(rng, 300, 90, 70, 0.05).template cast<T>();
    const auto weights = test::random_weights(rng, scene.camera);
    cpu::Serial serial;
    cpu::Threads threads(3);
    const auto expected = screen_gradient(serial, scene, {}, weights).numbers();
    CHECK(screen_gradient(threads, scene, {}, weights).numbers() == expected);
    const auto twice = screen_gradient(serial, scene, {}, weights, 2).numbers();
    for (std::size_t i = 0; i < expected.size(); ++i) CHECK(twice[i] == 2 * expected[i]);
}

TEST_CASE("backward_to_screen refuses what does not fit, with a name") {
    using R = Rasterizer<cpu::Serial, float>;
    test::Rng rng(14);
    const auto scene = test::make_scene(rng, 5, 20, 17, 0.1).cast<float>();
    const auto weights = test::random_weights(rng, scene.camera);
    cpu::Serial backend;
    const R rasterizer(backend);
    R::Cache cache;
    Screen<float> screen(4);
    const auto pass = [&](const ScreenGradient<float>& gradient) {
        rasterizer.backward_to_screen({}, weights.gradient(), cache, gradient);
    };
    CHECK_THROWS_WITH_AS(pass({}), doctest::Contains("the cache is not that of a forward pass"), ValueError);
    test::Rendering<float> out(scene.camera);
    rasterizer.forward(scene.camera, scene.view(), {}, out.target(), cache);
    CHECK_THROWS_WITH_AS(pass({.means2d = screen.means2d}),
                         doctest::Contains("dL_dscreen.means2d has 4 elements, expected 5"), ShapeError);
    CHECK_THROWS_WITH_AS(pass({.conics = screen.conics}), doctest::Contains("dL_dscreen.conics has 4"), ShapeError);
    CHECK_THROWS_WITH_AS(pass({.depths = screen.depths}), doctest::Contains("dL_dscreen.depths has 4"), ShapeError);
    CHECK_THROWS_WITH_AS(pass({.opacities = screen.opacities}), doctest::Contains("dL_dscreen.opacities has 4"),
                         ShapeError);
    CHECK_THROWS_WITH_AS(pass({.colors = screen.colors}), doctest::Contains("dL_dscreen.colors has 4"), ShapeError);
    CHECK_THROWS_WITH_AS(pass({.absolute_means2d = screen.absolute}),
                         doctest::Contains("dL_dscreen.absolute_means2d has 4"), ShapeError);
}
