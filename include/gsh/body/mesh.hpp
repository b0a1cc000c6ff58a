// SPDX-License-Identifier: Apache-2.0
/// @file  Operations on a triangle mesh: vertex normals, and the part of a triangle nearest to each corner.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh {

/// Faces as unsigned indices, for upload to a backend. No index may be negative.
[[nodiscard]] inline std::vector<vec3<std::uint32_t>> triangle_indices(Span<const std::array<int, 3>> faces) {
    std::vector<vec3<std::uint32_t>> triangles;
    triangles.reserve(faces.size());
    for (const auto& face : faces)
        triangles.push_back({static_cast<std::uint32_t>(face[0]), static_cast<std::uint32_t>(face[1]),
                             static_cast<std::uint32_t>(face[2])});
    return triangles;
}

/// Unit normals [V], the area-weighted mean over the triangles at each vertex. They point outward if triangles are
/// counter-clockwise seen from outside. A vertex without triangles, or with degenerate ones only, has normal zero.
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

/// The part of a triangle that is nearer to its first corner than to the other two: a convex polygon in barycentric
/// coordinates. It is also exact for obtuse triangles, whose bisectors meet outside.
struct CornerRegion {
    std::array<vec3<double>, 6> points; ///< barycentric coordinates with respect to (a, b, c); the first is a
    std::size_t count = 0;              ///< at least 3; at most 5, or 6 after a rounding error on the boundary

    CornerRegion(const vec3<double>& a, const vec3<double>& b, const vec3<double>& c) {
        points = {vec3<double>(1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1), {}, {}, {}};
        count = 3;
        // Nearer to a than to b: 0 <= |x - b|² - |x - a|², which is linear in x. The arguments are its values at the
        // corners.
        const auto squared = [](const vec3<double>& v) { return dot(v, v); };
        clip({squared(a - b), -squared(a - b), squared(c - b) - squared(c - a)});
        clip({squared(a - c), squared(b - c) - squared(b - a), -squared(a - c)});
    }

    /// Fraction of the triangle's area. It is the same for every triangle with the same barycentric polygon.
    [[nodiscard]] double fraction() const {
        double sum = 0;
        for (std::size_t k = 2; k < count; ++k) sum += fan_fraction(k);
        return sum;
    }

    /// The point at (u, v) of the unit square. Uniform u, v give points uniform by area.
    [[nodiscard]] vec3<double> at(double u, double v) const {
        double left = u * fraction();
        std::size_t k = 2;
        for (; k + 1 < count && left > fan_fraction(k); ++k) left -= fan_fraction(k);
        const double area = fan_fraction(k), s = area > 0 ? std::sqrt(std::clamp(left / area, 0.0, 1.0)) : 0;
        return points[0] * (1 - s) + points[k - 1] * (s * (1 - v)) + points[k] * (s * v);
    }

private:
    /// Area of triangle (0, k - 1, k) of the fan, as a fraction of the whole triangle.
    [[nodiscard]] double fan_fraction(std::size_t k) const {
        const vec3<double> p = points[k - 1] - points[0], q = points[k] - points[0];
        return std::abs(p.y * q.z - p.z * q.y);
    }

    /// Clips the polygon to the half-plane in which the linear function with these corner values is not negative.
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
