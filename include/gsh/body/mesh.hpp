// SPDX-License-Identifier: Apache-2.0
/// @file  Small questions asked of a triangle mesh: normals, and which part of a triangle is nearest to a corner.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// Unit normals [V], the area-weighted mean over the triangles at each vertex; outward where triangles are
/// counter-clockwise seen from outside. A vertex of no triangle, or of degenerate ones only, gets zero.
[[nodiscard]] inline std::vector<vec3<double>> vertex_normals(Span<const vec3<double>> vertices,
                                                              Span<const std::array<int, 3>> faces) {
    std::vector<vec3<double>> normals(vertices.size(), vec3<double>(0));
    for (const auto& face : faces) {
        const vec3<double>& a = vertices[static_cast<std::size_t>(face[0])];
        const vec3<double> normal = cross(vertices[static_cast<std::size_t>(face[1])] - a,
                                          vertices[static_cast<std::size_t>(face[2])] - a);
        for (const int v : face) normals[static_cast<std::size_t>(v)] += normal;
    }
    for (auto& normal : normals)
        if (const double size = length(normal); size > 0) normal *= 1 / size;
    return normals;
}

/// The part of a triangle that is nearer to its first corner than to the other two: a convex polygon, given by
/// barycentric coordinates. Exact for obtuse triangles too, where the bisectors meet outside.
struct CornerRegion {
    std::array<vec3<double>, 6> points; ///< barycentric coordinates with respect to (a, b, c); the first is a
    std::size_t count = 0;              ///< at least 3; 5 suffice but for a rounding error on the boundary

    CornerRegion(const vec3<double>& a, const vec3<double>& b, const vec3<double>& c) {
        points = {vec3<double>(1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1), {}, {}, {}};
        count = 3;
        // Nearer to a than to b: 0 <= |x - b|² - |x - a|², which is linear in x; its values at the corners.
        const auto squared = [](const vec3<double>& v) { return dot(v, v); };
        clip({squared(a - b), -squared(a - b), squared(c - b) - squared(c - a)});
        clip({squared(a - c), squared(b - c) - squared(b - a), -squared(a - c)});
    }

    /// Share of the triangle's area: an affine map takes barycentric coordinates to any triangle.
    [[nodiscard]] double fraction() const {
        double sum = 0;
        for (std::size_t k = 2; k < count; ++k) sum += fan_fraction(k);
        return sum;
    }

    /// The point at (u, v) of the unit square, area-uniform in the region for uniform u, v.
    [[nodiscard]] vec3<double> at(double u, double v) const {
        double left = u * fraction();
        std::size_t k = 2;
        for (; k + 1 < count && left > fan_fraction(k); ++k) left -= fan_fraction(k);
        const double area = fan_fraction(k), s = area > 0 ? std::sqrt(std::clamp(left / area, 0.0, 1.0)) : 0;
        return points[0] * (1 - s) + points[k - 1] * (s * (1 - v)) + points[k] * (s * v);
    }

private:
    /// Area of triangle (0, k - 1, k) of the fan, as a share of the whole triangle.
    [[nodiscard]] double fan_fraction(std::size_t k) const {
        const vec3<double> p = points[k - 1] - points[0], q = points[k] - points[0];
        return std::abs(p.y * q.z - p.z * q.y);
    }

    /// Keeps the side where the linear function with these corner values is not negative.
    void clip(const vec3<double>& corner_values) {
        std::array<vec3<double>, 6> kept{};
        std::size_t n = 0;
        const auto keep = [&](const vec3<double>& p) {
            if (n < kept.size()) kept[n++] = p;
        };
        for (std::size_t k = 0; k < count; ++k) {
            const vec3<double>&p = points[k], &q = points[(k + 1) % count];
            const double at_p = dot(corner_values, p), at_q = dot(corner_values, q);
            if (at_p >= 0) keep(p);
            if ((at_p < 0) != (at_q < 0)) keep(p + (q - p) * (at_p / (at_p - at_q)));
        }
        points = kept, count = n;
    }
};

} // namespace gsh
