// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians on capsules as a load of rasterizers: a person of small opaque ones, and many transparent layers.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace gsh::bench {

struct Capsule {
    vec3<double> from, to;
    double radius;
    double area() const { return 2 * std::numbers::pi * radius * (length(to - from) + 2 * radius); }
};

/// Points on the surfaces of capsules, evenly by area, in order along each capsule's axis. Neighbours in memory are
/// therefore near each other, as in a trained avatar.
struct CapsuleLoad {
    std::vector<vec3<float>> means, colors;
    std::vector<sym3<float>> covariances;
    std::vector<float> opacities;
    std::size_t count;
    Rng rng{1};

    explicit CapsuleLoad(std::size_t gaussians) : count(gaussians) {}

    SplatView<const float> view() const { return {means, covariances, opacities, colors}; }

    template <class Visit>
    void sample(const std::vector<Capsule>& body, const Visit& visit) {
        double total = 0, before = 0;
        for (const Capsule& capsule : body) total += capsule.area();
        std::size_t done = 0;
        for (const Capsule& capsule : body) {
            before += capsule.area();
            const auto end = static_cast<std::size_t>(before / total * static_cast<double>(count) + 0.5);
            const std::size_t begin = done;
            const vec3<double> axis = normalize(capsule.to - capsule.from);
            const vec3<double> side = normalize(cross(axis, vec3<double>(0.3, 0.2, 0.9))), other = cross(axis, side);
            const double r = capsule.radius, share = static_cast<double>(end - begin);
            const double span = length(capsule.to - capsule.from) + 2 * r; // along it, equal steps have equal areas
            for (; done < end; ++done) {
                const double h = span * (static_cast<double>(done - begin) + rng.uniform()) / share - r;
                const double angle = rng.uniform(0, 2 * std::numbers::pi);
                const double beyond = h < 0 ? h : std::max(0.0, h - (span - 2 * r)); // depth in a cap
                const double across = std::sqrt(std::max(0.0, r * r - beyond * beyond)) / r;
                const vec3<double> normal =
                    normalize((side * std::cos(angle) + other * std::sin(angle)) * across + axis * (beyond / r));
                visit(capsule.from + axis * (h - beyond) + normal * r, normal);
            }
        }
    }
    void add(const vec3<double>& mean, const mat3<double>& axes, double opacity) {
        const sym3<double> c = gram(axes);
        const double red = rng.uniform(), green = rng.uniform(), blue = rng.uniform();
        means.push_back(vec3<float>(mean)), opacities.push_back(static_cast<float>(opacity));
        covariances.push_back({float(c.xx), float(c.xy), float(c.xz), float(c.yy), float(c.yz), float(c.zz)});
        colors.push_back(vec3<float>(float(red), float(green), float(blue)));
    }
};

/// A person of capsules, 1.7 m tall. Flat Gaussians on the surface have 0.6 of their spacing as size; most are opaque.
inline CapsuleLoad make_person(std::size_t count) {
    const std::vector<Capsule> body = {{{0, -0.62, 0}, {0, -0.76, 0}, 0.10},
                                       {{0, -0.40, 0}, {0, 0.0, 0}, 0.15},
                                       {{0.18, -0.42, 0}, {0.36, -0.05, 0.05}, 0.045},
                                       {{0.36, -0.05, 0.05}, {0.44, 0.25, 0}, 0.04},
                                       {{-0.18, -0.42, 0}, {-0.36, -0.05, 0.05}, 0.045},
                                       {{-0.36, -0.05, 0.05}, {-0.44, 0.25, 0}, 0.04},
                                       {{0.09, 0.08, 0}, {0.13, 0.45, -0.02}, 0.075},
                                       {{0.13, 0.45, -0.02}, {0.14, 0.80, 0}, 0.055},
                                       {{-0.09, 0.08, 0}, {-0.13, 0.45, -0.02}, 0.075},
                                       {{-0.13, 0.45, -0.02}, {-0.14, 0.80, 0}, 0.055}};
    double area = 0;
    for (const Capsule& capsule : body) area += capsule.area();
    const double size = 0.6 * std::sqrt(area / static_cast<double>(count));
    CapsuleLoad load(count);
    load.sample(body, [&](const vec3<double>& p, const vec3<double>& normal) {
        const vec3<double> a = normalize(cross(normal, vec3<double>(0.41, 0.77, 0.49))), b = cross(normal, a);
        const double s0 = size * std::exp(0.4 * load.rng.normal()), s1 = size * std::exp(0.4 * load.rng.normal());
        const double opacity = load.rng.uniform() < 0.7 ? load.rng.uniform(0.9, 1) : load.rng.uniform(0.05, 0.9);
        load.add(p, mat3<double>(a * s0, b * s1, normal * (0.3 * size)), opacity);
    });
    return load;
}

/// One thick capsule with jitter. The Gaussians have all directions, a median size of 4 mm, and form many transparent
/// layers.
inline CapsuleLoad make_layers(std::size_t count) {
    CapsuleLoad load(count);
    load.sample({{{0, -0.6, 0}, {0, 0.6, 0}, 0.25}}, [&](const vec3<double>& p, const vec3<double>& normal) {
        Rng& rng = load.rng;
        const quat<double> q{rng.normal(), rng.normal(), rng.normal(), rng.normal()}; // braces: evaluated in order
        mat3<double> axes = rotation_matrix(normalize(q));
        for (int k = 0; k < 3; ++k) axes[k] *= 0.004 * std::exp(0.5 * rng.normal());
        const vec3<double> mean = p + normal * (0.002 * rng.normal());
        load.add(mean, axes, rng.uniform(0.1, 0.9));
    });
    return load;
}

/// A room of 8 x 4 x 8 m, seen from the inside: Gaussians along its walls and on things in it. One in a hundred is
/// large, some hundreds of pixels wide, as in trained scenes.
inline CapsuleLoad make_room(std::size_t count) {
    CapsuleLoad load(count);
    Rng& rng = load.rng;
    for (std::size_t i = 0; i < count; ++i) {
        vec3<double> p(rng.uniform(-4, 4), rng.uniform(-2, 2), rng.uniform(-4, 4));
        const int axis = static_cast<int>(rng.below(3));
        const bool on_wall = rng.uniform() < 0.7;
        if (on_wall) p[axis] = (rng.uniform() < 0.5 ? -1 : 1) * (axis == 1 ? 2 : 4) + 0.01 * rng.normal();
        const quat<double> q{rng.normal(), rng.normal(), rng.normal(), rng.normal()};
        mat3<double> axes = rotation_matrix(normalize(q));
        const double size = on_wall && rng.uniform() < 0.015 ? 0.25 : 0.008;
        for (int k = 0; k < 3; ++k) axes[k] *= size * std::exp(0.5 * rng.normal());
        load.add(p, axes, rng.uniform(0.1, 0.95));
    }
    return load;
}

/// A camera 2.5 m in front of the person, on a circle of `views` places. 1.7 m cover 90% of the image's height.
inline Camera<float> make_camera(int size, int view = 0, int views = 8) {
    Camera<float> camera;
    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(view) / static_cast<float>(views);
    camera.R = mat3<float>(vec3<float>(std::cos(angle), 0, std::sin(angle)), vec3<float>(0, 1, 0),
                           vec3<float>(-std::sin(angle), 0, std::cos(angle)));
    camera.t = vec3<float>(0, 0, 2.5f);
    camera.fx = camera.fy = 0.9f * static_cast<float>(size) * 2.5f / 1.7f;
    camera.cx = camera.cy = 0.5f * static_cast<float>(size);
    camera.width = camera.height = size;
    return camera;
}

} // namespace gsh::bench
