// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer on a GPU beside cpu::Serial, whose own test has the reference and the central differences.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/rasterizer.cuh>

#include <doctest/doctest.h>

#include "render/cuda/raster_device.hpp"
#include "support/cuda_device.hpp"
#include "support/reference_rasterizer.hpp"
#include "support/splat_scene.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

using namespace gsh;

namespace {

using cpu::Serial;
using cuda::Device;
using test::RunOptions;
using test::RunResult;
using test::SplatScene;

template <class T>
Image<T> random_image(test::Rng& rng, const Camera<T>& camera) {
    Image<T> image(3, camera.height, camera.width);
    for (T& v : image.data) v = static_cast<T>(rng.uniform());
    return image;
}

/// Splats that are long and thin.
SplatScene<double> make_needles(test::Rng& rng, std::size_t count, int width, int height, double length, double radius) {
    SplatScene<double> scene = test::make_scene(rng, count, width, height, 0.05);
    for (auto& covariance : scene.covariances) {
        mat3<double> axes = rotation_matrix(normalize(rng.quat()));
        axes[0] *= length, axes[1] *= radius, axes[2] *= radius;
        covariance = gram(axes);
    }
    return scene;
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

/// Each gradient, relative to its own size.
template <class T, class U>
void check_gradients(const RunResult<T>& a, const RunResult<U>& b, double tolerance) {
    CHECK(test::relative_difference<T, U>(a.gradient.means, b.gradient.means) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.gradient.covariances, b.gradient.covariances) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.gradient.opacities, b.gradient.opacities) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.gradient.colors, b.gradient.colors) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.camera, b.camera) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.background, b.background) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.background_image.data, b.background_image.data) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.norms, b.norms) <= tolerance);
    CHECK(test::relative_difference<T, U>(a.radii, b.radii) <= tolerance);
}

/// In double, everything that Serial computes.
void check_double(const SplatScene<double>& scene, const RasterParams<double>& params = {},
                  const RunOptions& options = {}) {
    test::Rng rng(99);
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = random_image(rng, scene.camera);
    Serial serial;
    Device device;
    const auto expected = test::run(serial, scene, weights, background, params, options);
    const auto found = test::run(device, scene, weights, background, params, options);
    CHECK(found.status.pairs == expected.status.pairs);
    CHECK(found.status.visible == expected.status.visible);
    CHECK(found.visible == expected.visible);
    CHECK(largest_difference(found.images.color, expected.images.color) <= 1e-10);
    CHECK(largest_difference(found.images.alpha, expected.images.alpha) <= 1e-10);
    CHECK(largest_difference(found.images.expected_depth, expected.images.expected_depth) <= 1e-10);
    CHECK(largest_difference(found.images.median_depth, expected.images.median_depth) <= 1e-10);
    check_gradients(found, expected, 1e-10);
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
template <class T>
bool same_bits(const RunResult<T>& a, const RunResult<T>& b) {
    return same_bits(a.images.color.data, b.images.color.data) && same_bits(a.images.alpha.data, b.images.alpha.data) &&
           same_bits(a.images.expected_depth.data, b.images.expected_depth.data) &&
           same_bits(a.images.median_depth.data, b.images.median_depth.data) &&
           same_bits(a.gradient.means, b.gradient.means) &&
           same_bits(a.gradient.covariances, b.gradient.covariances) &&
           same_bits(a.gradient.opacities, b.gradient.opacities) &&
           same_bits(a.gradient.colors, b.gradient.colors) && same_bits(a.camera, b.camera) &&
           same_bits(a.background, b.background) && same_bits(a.background_image.data, b.background_image.data) &&
           same_bits(a.norms, b.norms) && same_bits(a.radii, b.radii) && same_bits(a.visible, b.visible);
}

} // namespace

TEST_CASE("In double, images and gradients are those of Serial") {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    SUBCASE("small Gaussians") { check_double(test::make_scene(rng, 400, 70, 50, 0.01)); }
    SUBCASE("Gaussians as large as tiles") { check_double(test::make_scene(rng, 60, 61, 47, 0.1)); }
    SUBCASE("Gaussians larger than the image") { check_double(test::make_scene(rng, 20, 33, 17, 2.0)); }
    SUBCASE("many tiles, so that covers need no mask") { check_double(test::make_scene(rng, 30, 200, 150, 0.3)); }
    SUBCASE("more rows of tiles than a warp has lanes") { check_double(test::make_scene(rng, 5, 40, 560, 2.0)); }
    SUBCASE("many layers, so that pixels stop and lists exceed a batch") {
        auto scene = test::make_scene(rng, 700, 40, 40, 0.05);
        for (double& opacity : scene.opacities) opacity = 0.3 + 0.7 * opacity; // some saturate
        check_double(scene);
    }
    SUBCASE("needles") { check_double(make_needles(rng, 60, 90, 70, 0.5, 1e-3)); }
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
    SUBCASE("only the colour, over an image") {
        const RunOptions options{.depth = false, .alpha = false, .background_image = true, .camera = false};
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
    }
    for (const int size : {1, 2, 15, 16, 17, 32, 33}) {
        CAPTURE(size);
        check_double(test::make_scene(rng, 40, size, 34 - size, 0.1));
        check_double(test::make_scene(rng, 40, size, size, 0.03));
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

TEST_CASE("In float, images are those of Serial but where a decision hangs by a thread, and so are gradients") {
    if (test::skip_without_device()) return;
    test::Rng rng(4);
    const auto check = [&](const SplatScene<double>& made, const RasterParams<float>& params = {}) {
        const SplatScene<float> scene = made.cast<float>();
        const auto weights = test::random_weights(rng, scene.camera);
        const auto background = random_image(rng, scene.camera);
        Serial serial;
        Device device;
        const auto expected = test::run(serial, scene, weights, background, params);
        const auto found = test::run(device, scene, weights, background, params);
        const SplatScene<double> exact = scene.cast<double>(); // the same numbers
        test::ReferenceOptions options;
        options.compensate_opacity = params.compensate_opacity;
        const test::Reference reference =
            test::reference_rasterize(exact.camera, exact.view(), exact.background, {}, options);
        int outside = 0;
        double largest = 0;
        for (int y = 0; y < scene.camera.height; ++y)
            for (int x = 0; x < scene.camera.width; ++x) {
                double difference = 0;
                const auto compare = [&](const Image<float>& a, const Image<float>& b, int c) {
                    const double d = std::abs(static_cast<double>(a.at(c, y, x)) - static_cast<double>(b.at(c, y, x)));
                    difference = d <= difference ? difference : d;
                };
                for (int c = 0; c < 3; ++c) compare(found.images.color, expected.images.color, c);
                compare(found.images.alpha, expected.images.alpha, 0);
                compare(found.images.expected_depth, expected.images.expected_depth, 0);
                if (difference <= 1e-4) {
                    largest = std::max(largest, difference);
                    continue;
                }
                ++outside;
                INFO("pixel " << x << ", " << y << " differs by " << difference << "; margins "
                              << reference.cut_margin.at(0, y, x) << ", " << reference.depth_gap.at(0, y, x));
                CHECK((reference.cut_margin.at(0, y, x) < 1e-4 || reference.depth_gap.at(0, y, x) < 1e-6));
            }
        MESSAGE("largest difference elsewhere " << largest << ", outside " << outside << " of " << scene.camera.width * scene.camera.height);
        MESSAGE("gradients " << test::relative_difference<float, float>(found.gradient.means, expected.gradient.means) << " "<< test::relative_difference<float, float>(found.gradient.covariances, expected.gradient.covariances)<< " "<< test::relative_difference<float, float>(found.gradient.opacities, expected.gradient.opacities)<< " "<< test::relative_difference<float, float>(found.gradient.colors, expected.gradient.colors)<< " "<< test::relative_difference<float, float>(found.camera, expected.camera)<< " "<< test::relative_difference<float, float>(found.norms, expected.norms)<< " "<< test::relative_difference<float, float>(found.radii, expected.radii));
        CHECK(outside <= scene.camera.width * scene.camera.height / 1000);
        check_gradients(found, expected, 1e-4);
    };
    SUBCASE("small Gaussians") { check(test::make_scene(rng, 1500, 150, 133, 0.012)); }
    SUBCASE("small Gaussians in a wide image, where positions have many digits") {
        check(test::make_scene(rng, 1500, 1920, 40, 0.004, 0.3));
    }
    SUBCASE("large ones") { check(test::make_scene(rng, 150, 200, 150, 0.1)); }
    SUBCASE("needles across the image") { check(make_needles(rng, 200, 300, 100, 0.1, 2e-3)); }
    SUBCASE("thinner needles across a wide image") { check(make_needles(rng, 100, 1920, 40, 0.1, 1e-4)); }
    SUBCASE("compensated opacities") {
        RasterParams<float> params;
        params.compensate_opacity = true;
        check(test::make_scene(rng, 1500, 150, 133, 0.012), params);
    }
}
