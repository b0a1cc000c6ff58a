// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer on a GPU beside cpu::Serial, whose own test has the reference and the central differences.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/rasterizer.cuh>

#include <doctest/doctest.h>

#include "render/cuda/raster_device.hpp"
#include "support/cuda_device.hpp"
#include "support/raster_scene.hpp"
#include "support/reference_rasterizer.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

namespace cuda_rasterizer { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cpu::Serial;
using cuda::Device;
namespace raster = test::raster;
using test::RasterScene;

/// In double, everything that Serial computes.
void check_double(const RasterScene<double>& scene, const RasterParams<double>& params = {},
                  const raster::Options& options = {}) {
    test::Rng rng(99);
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = raster::random_image(rng, scene.camera);
    Serial serial;
    Device device;
    const auto expected = raster::run(serial, scene, weights, background, params, options);
    const auto found = raster::run(device, scene, weights, background, params, options);
    CHECK(found.status.pairs == expected.status.pairs);
    CHECK(found.status.visible == expected.status.visible);
    CHECK(found.visible == expected.visible);
    CHECK(raster::largest_difference(found.images.color, expected.images.color) <= 1e-10);
    CHECK(raster::largest_difference(found.images.alpha, expected.images.alpha) <= 1e-10);
    CHECK(raster::largest_difference(found.images.expected_depth, expected.images.expected_depth) <= 1e-10);
    CHECK(raster::largest_difference(found.images.median_depth, expected.images.median_depth) <= 1e-10);
    raster::check_gradients(found, expected, 1e-10);
}

/// In float, images but where a decision hangs by a thread, and all gradients.
void check_float(test::Rng& rng, const RasterScene<double>& made, const RasterParams<float>& params = {}) {
    const RasterScene<float> scene = made.cast<float>();
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = raster::random_image(rng, scene.camera);
    Serial serial;
    Device device;
    const auto expected = raster::run(serial, scene, weights, background, params);
    const auto found = raster::run(device, scene, weights, background, params);
    test::Reference reference; // of the same numbers
    const auto make_reference = [&] {
        const RasterScene<double> exact = scene.cast<double>();
        test::ReferenceOptions options;
        options.compensate_opacity = params.compensate_opacity;
        reference = test::reference_rasterize(exact.camera, exact.view(), exact.background, {}, options);
    };
    int outside = 0;
    double largest = 0; // of the other pixels
    for (int y = 0; y < scene.camera.height; ++y)
        for (int x = 0; x < scene.camera.width; ++x) {
            const auto distance = [&](const Image<float>& a, const Image<float>& b, int c) {
                return std::abs(static_cast<double>(a.at(c, y, x)) - static_cast<double>(b.at(c, y, x)));
            };
            double difference = 0;
            const auto compare = [&](const Image<float>& a, const Image<float>& b, int c) {
                const double d = distance(a, b, c);
                difference = d <= difference ? difference : d;
            };
            for (int c = 0; c < 3; ++c) compare(found.images.color, expected.images.color, c);
            compare(found.images.alpha, expected.images.alpha, 0);
            compare(found.images.expected_depth, expected.images.expected_depth, 0);
            const double median = distance(found.images.median_depth, expected.images.median_depth, 0);
            if (difference <= 1e-4 && median <= 1e-4) {
                largest = std::max({largest, difference, median});
                continue;
            }
            if (outside++ == 0) make_reference();
            const double cut = reference.cut_margin.at(0, y, x), gap = reference.depth_gap.at(0, y, x),
                         half = reference.half_margin.at(0, y, x);
            INFO("pixel " << x << ", " << y << " differs by " << difference << ", its median depth by " << median
                          << "; margins " << cut << ", " << gap << ", " << half);
            CHECK((cut < 1e-4 || gap < 1e-6 || (difference <= 1e-4 && half < 1e-5)));
        }
    CAPTURE(largest);
    CHECK(outside <= scene.camera.width * scene.camera.height / 1000);
    raster::check_gradients(found, expected, 1e-4);
}

TEST_CASE("In double, images and gradients are those of Serial") {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    SUBCASE("small Gaussians") {
        check_double(test::make_scene(rng, 400, 70, 50, 0.01));
    }
    SUBCASE("Gaussians as large as tiles") {
        check_double(test::make_scene(rng, 60, 61, 47, 0.1));
    }
    SUBCASE("Gaussians larger than the image") {
        check_double(test::make_scene(rng, 20, 33, 17, 2.0));
    }
    SUBCASE("many tiles, so that covers need no mask") {
        check_double(test::make_scene(rng, 30, 200, 150, 0.3));
    }
    SUBCASE("more rows of tiles than a warp has lanes") {
        check_double(test::make_scene(rng, 5, 40, 560, 2.0));
    }
    SUBCASE("many layers, so that pixels stop and lists exceed a batch") {
        auto scene = test::make_scene(rng, 700, 40, 40, 0.05);
        for (double& opacity : scene.opacities) opacity = 0.3 + 0.7 * opacity; // some saturate
        check_double(scene);
    }
    SUBCASE("needles") {
        check_double(raster::make_needles(rng, 60, 90, 70, 0.5, 1e-3));
    }
    SUBCASE("compensated opacities") {
        RasterParams<double> params;
        params.compensate_opacity = true;
        check_double(test::make_scene(rng, 300, 60, 45, 0.01), params);
    }
    SUBCASE("some behind the camera, some before the near plane, many beyond the image's sides") {
        auto scene = test::make_scene(rng, 200, 50, 37, 0.1);
        for (auto& mean : scene.means) mean = rng.vec(-4, 4);
        check_double(scene);
    }
    SUBCASE("other thresholds and a sharper lens") {
        RasterParams<double> params;
        params.alpha_min = 0.02, params.alpha_max = 0.8, params.transmittance_min = 0.05;
        params.dilation = 0.05, params.near_plane = 2.1, params.jacobian_margin = 0;
        check_double(test::make_scene(rng, 300, 50, 50, 0.05), params);
    }
    SUBCASE("pixels that never stop") {
        RasterParams<double> params;
        params.alpha_min = 1e-13, params.transmittance_min = 0;
        check_double(test::make_scene(rng, 60, 33, 17, 0.08), params);
    }
    SUBCASE("no gradient for what little light reaches") {
        RasterParams<double> params;
        params.gradient_transmittance_min = 0.2;
        auto scene = test::make_scene(rng, 200, 40, 40, 0.05);
        for (double& opacity : scene.opacities) opacity = 0.3 + 0.7 * opacity;
        check_double(scene, params);
    }
    SUBCASE("only the colour, over an image") {
        const raster::Options options{.depth = false, .alpha = false, .background_image = true, .camera = false};
        check_double(test::make_scene(rng, 100, 37, 35, 0.05), {}, options);
    }
    SUBCASE("neither camera nor background") {
        check_double(test::make_scene(rng, 100, 37, 35, 0.05), {}, {.camera = false, .dL_dbackground = false});
    }
}

TEST_CASE("Any number of Gaussians and any size of image") {
    if (test::skip_without_device()) return;
    test::Rng rng(2);
    for (const std::size_t n : {0u, 1u, 31u, 32u, 33u, 127u, 128u, 129u, 257u}) {
        CAPTURE(n);
        check_double(test::make_scene(rng, n, 20, 18, 0.1));
        check_float(rng, test::make_scene(rng, n, 20, 18, 0.1));
    }
    for (const int size : {1, 2, 15, 16, 17, 32, 33}) {
        CAPTURE(size);
        check_double(test::make_scene(rng, 40, size, 34 - size, 0.1));
        check_double(test::make_scene(rng, 40, size, size, 0.03));
        check_float(rng, test::make_scene(rng, 40, size, 34 - size, 0.1));
    }
}

TEST_CASE("Lists longer than what a thread block sorts") {
    if (test::skip_without_device()) return;
    test::Rng rng(3);
    for (const std::size_t n : {2304u, 2305u, 7100u}) {
        CAPTURE(n);
        auto scene = test::make_scene(rng, n, 20, 12, 0.3); // each reaches both tiles
        for (double& opacity : scene.opacities) opacity *= 0.02;
        for (std::size_t i = 0; i < n; i += 3) scene.means[i] = scene.means[0]; // equal depths: in the order of index
        check_double(scene);
    }
}

TEST_CASE("Lists longer than what a thread block blends: pixels stop in the first segment, in a later one, or never") {
    if (test::skip_without_device()) return;
    test::Rng rng(5);
    for (const std::size_t n : {1024u, 1025u, 2048u, 2049u, 3300u}) {
        CAPTURE(n);
        auto scene = test::make_scene(rng, n, 16, 16, 0.15);
        for (std::size_t i = 0; i < n; ++i) {
            const double x = scene.means[i].x;
            scene.opacities[i] *= x < -0.1 ? 0.004 : x < 0.1 ? 0.03 : 0.2;
        }
        RasterParams<double> params;
        params.alpha_min = 1e-4;
        check_double(scene, params);
        params.gradient_transmittance_min = 0.05;
        check_double(scene, params, {.depth = false, .alpha = false, .background_image = true, .camera = false});

        Device device; // the scene must do what this test is for
        const auto found = raster::run(device, scene, test::random_weights(rng, scene.camera),
                                       raster::random_image(rng, scene.camera), params);
        const auto& alpha = found.images.alpha;
        const auto [least, most] = std::minmax_element(alpha.data.begin(), alpha.data.end());
        CHECK(found.status.pairs > n - n / 16); // one tile's list
        CHECK(*least < 0.5);
        CHECK(*most > 0.999);
    }
}

TEST_CASE("In float, images are those of Serial but where a decision hangs by a thread, and so are gradients") {
    if (test::skip_without_device()) return;
    test::Rng rng(4);
    SUBCASE("small Gaussians") {
        check_float(rng, test::make_scene(rng, 1500, 150, 133, 0.012));
    }
    SUBCASE("small Gaussians in a wide image, where positions have many digits") {
        check_float(rng, test::make_scene(rng, 1500, 1920, 40, 0.004, 0.3));
    }
    SUBCASE("large ones") {
        check_float(rng, test::make_scene(rng, 150, 200, 150, 0.1));
    }
    SUBCASE("needles across the image") {
        check_float(rng, raster::make_needles(rng, 200, 300, 100, 0.1, 2e-3));
    }
    SUBCASE("thinner needles across a wide image") {
        check_float(rng, raster::make_needles(rng, 100, 1920, 40, 0.1, 1e-4));
    }
    SUBCASE("compensated opacities") {
        RasterParams<float> params;
        params.compensate_opacity = true;
        check_float(rng, test::make_scene(rng, 1500, 150, 133, 0.012), params);
    }
}

TEST_CASE("Gradients are the central differences of what the device draws") {
    if (test::skip_without_device()) return;
    test::Rng rng(7);
    auto scene = test::make_scene(rng, 4, 17, 9, 0.1);
    RasterParams<double> params; // no kinks: no splat is skipped, no pixel stops
    params.alpha_min = 1e-13, params.transmittance_min = 0;
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = raster::random_image(rng, scene.camera);
    Device device;
    auto gradient = raster::run(device, scene, weights, background, params);
    const auto loss = [&] {
        const auto found = raster::run(device, scene, weights, background, params, {.backward_passes = 0});
        double sum = 0;
        const auto add = [&](const Image<double>& image, const Image<double>& weight) {
            sum += test::inner(image.data, weight.data);
        };
        add(found.images.color, weights.color), add(found.images.alpha, weights.alpha);
        add(found.images.expected_depth, weights.expected_depth);
        add(found.images.median_depth, weights.median_depth);
        return sum;
    };
    test::GradientCheck options{.tolerance = 5e-6};
    const auto check = [&](const std::string& name, auto& x, auto& dL_dx) {
        INFO(name);
        test::check_gradient(loss, test::scalars(x), test::scalars(dL_dx), options);
    };
    check("means", scene.means, gradient.gradient.means);
    check("opacities", scene.opacities, gradient.gradient.opacities);
    check("background", scene.background, gradient.background);
    CameraGradient<double>& camera = gradient.camera[0];
    check("R", scene.camera.R, camera.dL_dR);
    check("t", scene.camera.t, camera.dL_dt);
    check("fx", scene.camera.fx, camera.dL_dfx), check("fy", scene.camera.fy, camera.dL_dfy);
    check("cx", scene.camera.cx, camera.dL_dcx), check("cy", scene.camera.cy, camera.dL_dcy);
    options.stride = 5; // odd, so that all channels occur
    check("colors", scene.colors, gradient.gradient.colors);
    options.stride = 1, options.step = 3e-7; // covariances are small numbers of square metres
    check("covariances", scene.covariances, gradient.gradient.covariances);
}

} // namespace cuda_rasterizer
