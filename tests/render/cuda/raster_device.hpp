// SPDX-License-Identifier: Apache-2.0
/// @file  Both passes of the rasterizer on any backend, from and to host memory.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/cuda/rasterizer.cuh>
#include <gsh/render/rasterizer.hpp>

#include "support/device_arrays.hpp"
#include "support/raster_scene.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

namespace gsh::test::raster {

/// A buffer of the backend with the contents of a vector.
template <class B, class V>
typename B::template Buffer<V> to_backend(B& backend, const std::vector<V>& host) {
    typename B::template Buffer<V> buffer(host.size());
    backend.upload(Span<const V>(host), Span<V>(buffer));
    return buffer;
}
template <class B, class Buffer>
auto from_backend(B& backend, const Buffer& buffer) {
    using V = std::remove_cvref_t<decltype(*buffer.data())>;
    return downloaded(backend, Span<const V>(buffer.data(), buffer.size()));
}

/// What a run computes; by default everything.
struct Options {
    bool depth = true, alpha = true, background_image = false, camera = true, dL_dbackground = true;
    int backward_passes = 1;
};

/// All numbers that a run has produced.
template <class T>
struct Result {
    Rendering<T> images;
    RasterScene<T> gradient;
    std::vector<CameraGradient<T>> camera;
    std::vector<vec3<T>> background;
    Image<T> background_image;
    std::vector<T> norms, radii;
    std::vector<std::uint8_t> visible;
    RasterStatus status;
};

/// The images of a backend, as large as a rendering's, and its gradients of splats.
template <class B, class T>
struct Memory {
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    int width, height;
    Splats<B, T> splats, gradient;
    Buffer<T> color, alpha, expected_depth, median_depth, background, dL_dbackground;
    Buffer<T> w_color, w_alpha, w_expected_depth, w_median_depth;
    Buffer<CameraGradient<T>> camera;
    Buffer<vec3<T>> dL_dcolor;

    Memory(B& backend, const RasterScene<T>& scene, const Rendering<T>& weights, const Image<T>& back)
        : width(scene.camera.width), height(scene.camera.height) {
        splats.means = to_backend(backend, scene.means);
        splats.covariances = to_backend(backend, scene.covariances);
        splats.opacities = to_backend(backend, scene.opacities);
        splats.colors = to_backend(backend, scene.colors);
        gradient.resize(scene.size());
        const Rendering<T> empty(scene.camera); // all -1
        color = to_backend(backend, empty.color.data), alpha = to_backend(backend, empty.alpha.data);
        expected_depth = to_backend(backend, empty.alpha.data), median_depth = to_backend(backend, empty.alpha.data);
        background = to_backend(backend, back.data);
        dL_dbackground = to_backend(backend, std::vector<T>(back.data.size(), T(0)));
        w_color = to_backend(backend, weights.color.data), w_alpha = to_backend(backend, weights.alpha.data);
        w_expected_depth = to_backend(backend, weights.expected_depth.data);
        w_median_depth = to_backend(backend, weights.median_depth.data);
        camera = to_backend(backend, std::vector<CameraGradient<T>>(1));
        dL_dcolor = to_backend(backend, std::vector<vec3<T>>(1, vec3<T>(T(0))));
        fill_zero(backend, gradient.view());
    }
    [[nodiscard]] ImageView<T> image(Buffer<T>& buffer, int channels, bool wanted = true) const {
        return wanted ? ImageView<T>{buffer, channels, height, width} : ImageView<T>{};
    }
    [[nodiscard]] ImageView<const T> image(const Buffer<T>& buffer, int channels, bool wanted = true) const {
        return wanted ? ImageView<const T>{buffer, channels, height, width} : ImageView<const T>{};
    }
    [[nodiscard]] RenderTarget<T> target(const Options& o) {
        return {image(color, 3), image(alpha, 1, o.alpha), image(expected_depth, 1, o.depth),
                image(median_depth, 1, o.depth)};
    }
    [[nodiscard]] RenderGradient<T> weights(const Options& o) const {
        return {image(w_color, 3), image(w_alpha, 1, o.alpha), image(w_expected_depth, 1, o.depth),
                image(w_median_depth, 1, o.depth)};
    }
    [[nodiscard]] Background<T> behind(const RasterScene<T>& scene, const Options& o) const {
        return {scene.background, image(background, 3, o.background_image)};
    }
    [[nodiscard]] BackgroundGradient<T> dL_dbehind(const Options& o) {
        return {o.dL_dbackground ? Span<vec3<T>>(dL_dcolor) : Span<vec3<T>>{},
                image(dL_dbackground, 3, o.dL_dbackground)};
    }
};

/// Runs both passes: the loss is the images times the weights.
template <class B, std::floating_point T>
Result<T> run(B& backend, const RasterScene<T>& scene, const Rendering<T>& weights, const Image<T>& background,
              const RasterParams<T>& params = {}, const Options& options = {}) {
    using R = Rasterizer<B, T>;
    typename R::Cache cache;
    Memory<B, T> m(backend, scene, weights, background);
    const R rasterizer(backend, params);
    const SplatView<const T> splats = m.splats.view();
    rasterizer.forward(scene.camera, splats, m.behind(scene, options), m.target(options), cache);
    for (int i = 0; i < options.backward_passes; ++i)
        rasterizer.backward(
            scene.camera, splats, m.behind(scene, options), m.weights(options), cache, m.gradient.view(),
            options.camera ? Span<CameraGradient<T>>(m.camera) : Span<CameraGradient<T>>{}, m.dL_dbehind(options));
    Result<T> result{Rendering<T>(scene.camera), scene.zeros(), {}, {}, background, {}, {}, {}, {}};
    const auto get = [&](const auto& buffer) { return from_backend(backend, buffer); };
    result.images.color.data = get(m.color), result.images.alpha.data = get(m.alpha);
    result.images.expected_depth.data = get(m.expected_depth), result.images.median_depth.data = get(m.median_depth);
    result.gradient.means = get(m.gradient.means), result.gradient.covariances = get(m.gradient.covariances);
    result.gradient.opacities = get(m.gradient.opacities), result.gradient.colors = get(m.gradient.colors);
    result.camera = get(m.camera), result.background = get(m.dL_dcolor);
    result.background_image.data = get(m.dL_dbackground);
    result.norms = get(cache.screen_gradient_norms), result.radii = get(cache.screen_radii);
    result.visible = get(cache.visible);
    result.status = get(cache.status)[0];
    return result;
}

/// |a - b| / |b| of two arrays of numbers of type T and U.
template <class T, class U, class A, class B>
[[nodiscard]] double relative_difference(const std::vector<A>& a, const std::vector<B>& b) {
    return relative_distance(numbers<T>(a), numbers<U>(b));
}

template <class T>
Image<T> random_image(Rng& rng, const Camera<T>& camera) {
    Image<T> image(3, camera.height, camera.width);
    for (T& v : image.data) v = static_cast<T>(rng.uniform());
    return image;
}

/// Splats that are long and thin.
inline RasterScene<double> make_needles(Rng& rng, std::size_t count, int width, int height, double length,
                                        double radius) {
    RasterScene<double> scene = make_scene(rng, count, width, height, 0.05);
    for (auto& covariance : scene.covariances) {
        mat3<double> axes = rotation_matrix(normalize(rng.quat()));
        axes[0] *= length, axes[1] *= radius, axes[2] *= radius;
        covariance = gram(axes);
    }
    return scene;
}

inline double largest_difference(const Image<double>& a, const Image<double>& b) {
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
void check_gradients(const Result<T>& a, const Result<U>& b, double tolerance) {
    CHECK(relative_difference<T, U>(a.gradient.means, b.gradient.means) <= tolerance);
    CHECK(relative_difference<T, U>(a.gradient.covariances, b.gradient.covariances) <= tolerance);
    CHECK(relative_difference<T, U>(a.gradient.opacities, b.gradient.opacities) <= tolerance);
    CHECK(relative_difference<T, U>(a.gradient.colors, b.gradient.colors) <= tolerance);
    CHECK(relative_difference<T, U>(a.camera, b.camera) <= tolerance);
    CHECK(relative_difference<T, U>(a.background, b.background) <= tolerance);
    CHECK(relative_difference<T, U>(a.background_image.data, b.background_image.data) <= tolerance);
    CHECK(relative_difference<T, U>(a.norms, b.norms) <= tolerance);
    CHECK(relative_difference<T, U>(a.radii, b.radii) <= tolerance);
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
template <class T>
bool same_bits(const Result<T>& a, const Result<T>& b) {
    return same_bits(a.images.color.data, b.images.color.data) && same_bits(a.images.alpha.data, b.images.alpha.data) &&
           same_bits(a.images.expected_depth.data, b.images.expected_depth.data) &&
           same_bits(a.images.median_depth.data, b.images.median_depth.data) &&
           same_bits(a.gradient.means, b.gradient.means) && same_bits(a.gradient.covariances, b.gradient.covariances) &&
           same_bits(a.gradient.opacities, b.gradient.opacities) && same_bits(a.gradient.colors, b.gradient.colors) &&
           same_bits(a.camera, b.camera) && same_bits(a.background, b.background) &&
           same_bits(a.background_image.data, b.background_image.data) && same_bits(a.norms, b.norms) &&
           same_bits(a.radii, b.radii) && same_bits(a.visible, b.visible);
}

} // namespace gsh::test::raster
