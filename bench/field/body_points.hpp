// SPDX-License-Identifier: Apache-2.0
/// @file  Points on a human body of capsules in the unit cube, in Morton order, as inputs of an avatar's field.
#pragma once

#include <gsh/core/rng.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

namespace gsh::bench {

inline std::uint64_t morton(const vec3<float>& p) {
    std::uint64_t code = 0;
    for (int axis = 0; axis < 3; ++axis)
        for (int bit = 0; bit < 16; ++bit)
            code |= (static_cast<std::uint64_t>(p[axis] * 65535) >> bit & 1) << (3 * bit + axis);
    return code;
}

inline std::vector<vec3<float>> body_points(std::size_t count) {
    struct Capsule {
        vec3<double> from, to; // metres, relative to the body's centre
        double radius, share;
    };
    const Capsule parts[] = {{{0, -.1, 0}, {0, .45, 0}, .16, .36},      {{0, .65, 0}, {0, .72, 0}, .1, .1},
                             {{.2, .45, 0}, {.75, .45, 0}, .05, .12},   {{-.2, .45, 0}, {-.75, .45, 0}, .05, .12},
                             {{.1, -.1, 0}, {.12, -.85, 0}, .07, .15},  {{-.1, -.1, 0}, {-.12, -.85, 0}, .07, .15}};
    Rng rng(1);
    std::vector<vec3<float>> points;
    while (points.size() < count) {
        double pick = rng.uniform();
        const Capsule* part = parts;
        while (pick > part->share && part + 1 < std::end(parts)) pick -= part++->share;
        const vec3<double> axis = part->to - part->from, along = part->from + axis * rng.uniform();
        const double angle = rng.uniform(0, 2 * std::numbers::pi);
        const vec3<double> u = normalize(cross(axis, vec3<double>(.3, .1, 1))), v = normalize(cross(axis, u));
        const vec3<double> p = along + (u * std::cos(angle) + v * std::sin(angle)) * part->radius;
        points.push_back(vec3<float>(p / 1.75 + vec3<double>(.5)));
    }
    std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return morton(a) < morton(b); });
    return points;
}

} // namespace gsh::bench
