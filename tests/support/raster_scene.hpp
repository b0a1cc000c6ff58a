// SPDX-License-Identifier: Apache-2.0
/// @file  Scenes of random splats, and the images that a rasterizer makes of them, in host memory.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/render/target.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh::test {

/// Splats in host memory, as in the buffers of the CPU backends.
template <class T>
struct RasterScene {
    Camera<T> camera;
    std::vector<vec3<T>> means, colors;
    std::vector<sym3<T>> covariances;
    std::vector<T> opacities;
    vec3<T> background = vec3<T>(T(0.2), T(0.5), T(0.9));

    SplatView<const T> view() const { return {means, covariances, opacities, colors}; }
    SplatView<T> gradient_view() { return {means, covariances, opacities, colors}; }
    std::size_t size() const { return means.size(); }
    void add(const vec3<T>& mean, const sym3<T>& covariance, T opacity, const vec3<T>& color) {
        means.push_back(mean), covariances.push_back(covariance), opacities.push_back(opacity), colors.push_back(color);
    }
    RasterScene zeros() const {
        RasterScene z = *this;
        std::fill(z.means.begin(), z.means.end(), vec3<T>(0));
        std::fill(z.colors.begin(), z.colors.end(), vec3<T>(0));
        std::fill(z.covariances.begin(), z.covariances.end(), sym3<T>{});
        std::fill(z.opacities.begin(), z.opacities.end(), T(0));
        return z;
    }
    template <class U>
    RasterScene<U> cast() const {
        RasterScene<U> s;
        s.camera = camera.template cast<U>();
        s.background = vec3<U>(background);
        for (std::size_t i = 0; i < size(); ++i) {
            const sym3<T>& c = covariances[i];
            s.add(vec3<U>(means[i]), {U(c.xx), U(c.xy), U(c.xz), U(c.yy), U(c.yz), U(c.zz)}, U(opacities[i]),
                  vec3<U>(colors[i]));
        }
        return s;
    }
};

inline Camera<double> make_camera(int width, int height) {
    Camera<double> camera;
    camera.R = rotation_matrix(normalize(quat<double>{1, 0.05, -0.08, 0.03}));
    camera.t = vec3<double>(0.02, -0.03, 2);
    camera.fx = 1.1 * width, camera.fy = 1.15 * width;
    camera.cx = 0.47 * width, camera.cy = 0.55 * height;
    camera.width = width, camera.height = height;
    return camera;
}

/// Ellipsoids with axes of about `size` metres within half a metre of the origin, their depths apart.
inline RasterScene<double> make_scene(Rng& rng, std::size_t count, int width, int height, double size,
                                      double spread = 0.4) {
    RasterScene<double> scene;
    scene.camera = make_camera(width, height);
    for (std::size_t i = 0; i < count; ++i) {
        const mat3<double> R = rotation_matrix(normalize(rng.quat()));
        mat3<double> axes = R;
        for (int k = 0; k < 3; ++k) axes[k] *= size * std::exp(rng.uniform(-1, 1));
        const double z = -0.4 + 0.8 * (static_cast<double>(i) + rng.uniform(0.2, 0.8)) / static_cast<double>(count);
        const double x = rng.uniform(-spread, spread), y = rng.uniform(-spread, spread);
        const vec3<double> p(x, y, z);
        // In separate statements, because the order of evaluation of arguments is not defined.
        const double opacity = rng.uniform(0.1, 0.95);
        scene.add(transposed_times(scene.camera.R, p), gram(axes), opacity, rng.vec(0, 1));
    }
    // The order in memory differs from the order of depth.
    for (std::size_t i = count; i-- > 1;) {
        const std::size_t j = rng.below(i + 1);
        std::swap(scene.means[i], scene.means[j]);
    }
    return scene;
}

template <class T>
struct Rendering {
    Image<T> color, alpha, expected_depth, median_depth;
    explicit Rendering(const Camera<T>& c)
        : color(3, c.height, c.width, T(-1)), alpha(1, c.height, c.width, T(-1)),
          expected_depth(1, c.height, c.width, T(-1)), median_depth(1, c.height, c.width, T(-1)) {}
    RenderTarget<T> target() { return {color.view(), alpha.view(), expected_depth.view(), median_depth.view()}; }
    /// As a gradient: the weights of a linear loss.
    RenderGradient<T> gradient() const {
        return {color.view(), alpha.view(), expected_depth.view(), median_depth.view()};
    }
};

template <class T>
Rendering<T> random_weights(Rng& rng, const Camera<T>& camera) {
    Rendering<T> w(camera);
    for (Image<T>* image : {&w.color, &w.alpha, &w.expected_depth, &w.median_depth})
        for (T& v : image->data) v = static_cast<T>(rng.uniform(-1, 1));
    return w;
}

[[nodiscard]] inline sym3<double> ball(double radius) {
    return {radius * radius, 0, 0, radius * radius, 0, radius * radius};
}

} // namespace gsh::test
