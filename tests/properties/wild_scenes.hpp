// SPDX-License-Identifier: Apache-2.0
/// @file  Wild but valid scenes of splats, and the pictures and gradients that a backend makes of them.
#pragma once

#include "properties/properties.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/covariance.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <string>
#include <vector>

namespace gsh::test {

/// A splat by its place in the camera's frame, its axes, and the lengths along them.
struct WildSplat {
    vec3<double> place, color;
    quat<double> turn;
    vec3<double> lengths;
    double opacity = 0;
};

/// What a scene may hold. Properties that compare pictures within a tolerance leave out what makes a picture jump: a
/// splat within rounding of the near plane, or two at the same depth, whose order rounding would then decide.
enum class Wildness { everything, no_jumps };

[[nodiscard]] inline WildSplat wild_splat(Wildness wildness) {
    WildSplat s;
    double z = around(2, 1.6);
    if (rarely(4)) z = one_of({2.0, 0.2, 0.201, -1.0, 0.0, 1e3, 1e6});
    // In units of the depth, so that about two thirds are in the picture.
    s.place = vec3<double>(around(0, 0.8), around(0, 0.8), 1) * z;
    if (rarely(8)) s.place = {one_of({0.0, 3.0, -50.0, 1e5}), one_of({0.0, -3.0, 50.0, 1e5}), z};
    s.turn = any_quat();
    for (int k = 0; k < 3; ++k) s.lengths[k] = 0.1 * std::exp(around(0, 2));
    if (rarely(4)) s.lengths[int(below(3))] = one_of({1e-3, 1e-6, 0.0, 1e-12, 1e-19, 30.0, 1e3, 1e9});
    if (rarely(8)) s.lengths = vec3<double>(one_of({1e-3, 1e-19, 10.0, 1e9}));
    s.opacity = around(0.5, 0.48);
    if (rarely(4)) s.opacity = one_of({1.0, 0.0, 0.99, 1e-3, 1e-30, 1.0 / 255});
    s.color = around(vec3<double>(0.5), 0.5);
    if (rarely(8)) s.color = {one_of({0.0, 1e3}), one_of({0.0, -2.0}), 1e-30};
    if (wildness == Wildness::no_jumps) {
        if (std::abs(s.opacity * 255 - 1) < 1e-6) s.opacity *= 1.01;
        if (s.opacity == 1e-3) s.opacity = 0.3;
    }
    return s;
}

/// Splats in host memory with a camera and settings. They have covariances, or factors of them.
template <class T>
struct WildScene {
    Camera<T> camera;
    std::vector<vec3<T>> means, colors;
    std::vector<sym3<T>> covariances;
    std::vector<mat3<T>> factors;
    std::vector<T> opacities;
    vec3<T> background = vec3<T>(T(0));
    RasterParams<T> params;

    [[nodiscard]] std::size_t size() const { return means.size(); }
    [[nodiscard]] SplatView<const T> view() const { return {means, covariances, opacities, colors, factors}; }
    [[nodiscard]] SplatView<T> view() { return {means, covariances, opacities, colors, factors}; }
    [[nodiscard]] WildScene zeros() const {
        WildScene z = *this;
        for (auto& v : z.means) v = vec3<T>(T(0));
        for (auto& v : z.colors) v = vec3<T>(T(0));
        for (auto& v : z.covariances) v = {};
        for (auto& v : z.factors) v = mat3<T>(T(0));
        for (auto& v : z.opacities) v = T(0);
        return z;
    }
    /// Splat i of another scene of the same kind, at index `to`.
    void insert(std::size_t to, const WildScene& from, std::size_t i) {
        const auto place = [&](auto& own, const auto& other) {
            if (!other.empty()) own.insert(own.begin() + static_cast<std::ptrdiff_t>(to), other[i]);
        };
        place(means, from.means), place(colors, from.colors), place(covariances, from.covariances);
        place(factors, from.factors), place(opacities, from.opacities);
    }
    /// The camera's z of splat i, in double.
    [[nodiscard]] double depth(std::size_t i) const {
        return to_camera(camera.template cast<double>(), vec3<double>(means[i])).z;
    }
};

/// The numbers of a scene, for messages.
template <class T>
[[nodiscard]] std::string text_of(const WildScene<T>& scene) {
    std::string text = "camera";
    const auto add = [&](const char* name, const auto&... numbers) {
        text += std::string(" ") + name;
        ((text += " " + digits(double(numbers))), ...);
    };
    const auto add_vec = [&](const char* name, const vec3<T>& v) { add(name, v.x, v.y, v.z); };
    const Camera<T>& c = scene.camera;
    add("dilation", scene.params.dilation, scene.params.compensate_opacity), add_vec("background", scene.background);
    add("size", c.width, c.height), add("f", c.fx, c.fy), add("c", c.cx, c.cy), add_vec("t", c.t);
    for (int k = 0; k < 3; ++k) add_vec("R", c.R[k]);
    for (std::size_t i = 0; i < scene.size(); ++i) {
        text += "\nsplat, depth " + digits(scene.depth(i));
        add_vec("mean", scene.means[i]), add("opacity", scene.opacities[i]), add_vec("color", scene.colors[i]);
        if (!scene.factors.empty())
            for (int k = 0; k < 3; ++k) add_vec("F", scene.factors[i][k]);
        else {
            const sym3<T>& s = scene.covariances[i];
            add("covariance", s.xx, s.xy, s.xz, s.yy, s.yz, s.zz);
        }
    }
    return text;
}

/// A camera with a picture of 1 x 1 to 40 x 40 pixels, odd sizes included.
[[nodiscard]] inline Camera<double> wild_camera() {
    Camera<double> camera;
    camera.width = static_cast<int>(one_of({17, 1, 2, 16, 33, 40})),
    camera.height = static_cast<int>(one_of({15, 1, 16, 31}));
    camera.R = any_rotation();
    camera.t = around(vec3<double>(0), one_of({1.0, 0.0, 100.0}));
    const double zoom = one_of({1.0, 0.3, 5.0});
    camera.fx = zoom * camera.width * around(1, 0.2), camera.fy = zoom * camera.height * around(1, 0.2);
    camera.cx = camera.width * around(0.5, 0.3), camera.cy = camera.height * around(0.5, 0.3);
    return camera;
}

/// Moves splats apart in depth by at least 1e-6 of it, and away from the near plane.
inline void separate_depths(std::vector<WildSplat>& splats, double near_plane) {
    std::vector<double> taken{near_plane};
    for (WildSplat& s : splats) {
        double z = s.place.z;
        const auto near_one = [&](double other) { return std::abs(z - other) <= 1e-6 * std::abs(z) + 1e-9; };
        while (std::ranges::any_of(taken, near_one)) z += 3e-6 * std::abs(z) + 3e-9;
        s.place.z = z;
        taken.push_back(z);
    }
}

[[nodiscard]] inline mat3<double> factor_of(const WildSplat& s) {
    return scaled_rotation(s.turn, s.lengths);
}

[[nodiscard]] inline WildScene<double> scene_of(const Camera<double>& camera, const std::vector<WildSplat>& splats,
                                                bool factored) {
    WildScene<double> scene;
    scene.camera = camera;
    for (const WildSplat& s : splats) {
        scene.means.push_back(transposed_times(camera.R, s.place - camera.t));
        const mat3<double> F = factor_of(s);
        if (factored)
            scene.factors.push_back(F);
        else
            scene.covariances.push_back(gram(F));
        scene.opacities.push_back(s.opacity);
        scene.colors.push_back(s.color);
    }
    return scene;
}

/// A scene of up to 60 splats. Without jumps, splats have factors: where a covariance is far longer than it is thin,
/// its numbers do not hold the thin axis, and the picture is that of the rounding.
[[nodiscard]] inline WildScene<double> wild_scene(Wildness wildness, int most = 60) {
    const Camera<double> camera = wild_camera();
    std::vector<WildSplat> splats = list_of(most, [wildness] { return wild_splat(wildness); });
    RasterParams<double> params;
    params.compensate_opacity = rarely(3);
    if (rarely(3)) params.dilation = one_of({0.0, 0.1, 2.0});
    if (wildness == Wildness::no_jumps) {
        separate_depths(splats, params.near_plane);
        params.dilation = std::max(params.dilation, 0.1);
    }
    WildScene<double> scene = scene_of(camera, splats, wildness == Wildness::no_jumps || rarely(2));
    scene.params = params;
    scene.background = around(vec3<double>(0.5), 0.5);
    return scene;
}

/// The scene in single precision.
[[nodiscard]] inline WildScene<float> in_float(const WildScene<double>& scene) {
    WildScene<float> s;
    s.camera = scene.camera.cast<float>();
    for (const auto& v : scene.means) s.means.emplace_back(v);
    for (const auto& v : scene.colors) s.colors.emplace_back(v);
    for (const auto& c : scene.covariances)
        s.covariances.push_back({float(c.xx), float(c.xy), float(c.xz), float(c.yy), float(c.yz), float(c.zz)});
    for (const auto& F : scene.factors) s.factors.emplace_back(F);
    for (const double o : scene.opacities) s.opacities.push_back(float(o));
    s.background = vec3<float>(scene.background);
    s.params.dilation = float(scene.params.dilation);
    s.params.compensate_opacity = scene.params.compensate_opacity;
    return s;
}

template <class T>
struct WildPicture {
    Image<T> color, alpha, expected_depth, median_depth;

    explicit WildPicture(const Camera<T>& c)
        : color(3, c.height, c.width), alpha(1, c.height, c.width), expected_depth(1, c.height, c.width),
          median_depth(1, c.height, c.width) {}
    [[nodiscard]] RenderTarget<T> target() {
        return {color.view(), alpha.view(), expected_depth.view(), median_depth.view()};
    }
    [[nodiscard]] RenderGradient<T> gradient() const {
        return {color.view(), alpha.view(), expected_depth.view(), median_depth.view()};
    }
    [[nodiscard]] std::vector<T> numbers() const {
        std::vector<T> all = color.data;
        for (const auto* image : {&alpha, &expected_depth, &median_depth})
            all.insert(all.end(), image->data.begin(), image->data.end());
        return all;
    }
};

/// Weights of a linear loss over all four images.
template <class T>
[[nodiscard]] WildPicture<T> wild_weights(const Camera<T>& camera) {
    WildPicture<T> w(camera);
    const double phase = around(1, 0.9);
    double at = 0;
    for (Image<T>* image : {&w.color, &w.alpha, &w.expected_depth, &w.median_depth})
        for (T& v : image->data) v = T(std::sin(at += phase + 1));
    return w;
}

template <class T>
struct WildGradient {
    WildScene<T> splats;
    CameraGradient<T> camera = {};
    vec3<T> background = vec3<T>(T(0));
};

[[nodiscard]] inline cpu::Serial& one_thread() {
    static cpu::Serial backend;
    return backend;
}
[[nodiscard]] inline cpu::Threads& three_threads() {
    static cpu::Threads backend(3);
    return backend;
}

template <class B, class T>
[[nodiscard]] WildPicture<T> draw_wild(B& backend, const WildScene<T>& scene, typename Rasterizer<B, T>::Cache& cache) {
    const Rasterizer<B, T> rasterizer(backend, scene.params);
    WildPicture<T> picture(scene.camera);
    rasterizer.forward(scene.camera, scene.view(), Background<T>{scene.background}, picture.target(), cache);
    return picture;
}
template <class B, class T>
[[nodiscard]] WildPicture<T> draw_wild(B& backend, const WildScene<T>& scene) {
    typename Rasterizer<B, T>::Cache cache;
    return draw_wild(backend, scene, cache);
}

/// The picture of a scene, and the gradient of the loss with the given weights.
template <class B, class T>
[[nodiscard]] WildPicture<T> draw_wild(B& backend, const WildScene<T>& scene, const WildPicture<T>& weights,
                                       WildGradient<T>& gradient) {
    typename Rasterizer<B, T>::Cache cache;
    const WildPicture<T> picture = draw_wild(backend, scene, cache);
    const Rasterizer<B, T> rasterizer(backend, scene.params);
    gradient = {.splats = scene.zeros()};
    rasterizer.backward(scene.camera, scene.view(), Background<T>{scene.background}, weights.gradient(), cache,
                        gradient.splats.view(), Span<CameraGradient<T>>(&gradient.camera, 1),
                        {.color = Span<vec3<T>>(&gradient.background, 1)});
    return picture;
}

/// Whether all bytes of two lists of numbers are the same.
template <class T>
[[nodiscard]] bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

/// The first number in which two pictures differ by more than a tolerance, as text; empty if there is none.
template <class T>
[[nodiscard]] std::string difference(const std::vector<T>& found, const std::vector<T>& expected, double tolerance) {
    for (std::size_t i = 0; i < expected.size(); ++i) {
        const double f = double(found[i]), e = double(expected[i]);
        if (!(std::abs(f - e) <= tolerance * std::max(1.0, std::abs(e))) && !(f == e))
            return "number " + std::to_string(i) + " is " + digits(f) + ", expected " + digits(e);
    }
    return found.size() == expected.size() ? "" : "sizes differ";
}

} // namespace gsh::test
