// SPDX-License-Identifier: Apache-2.0
/// @file  Meshes with known depth and normals, views of analytic surfaces, and a backend for tests.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/prior_view.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace gsh::test {

inline cpu::Serial serial;

struct Mesh {
    std::vector<vec3<double>> vertices;
    std::vector<std::array<int, 3>> faces;

    void add(Mesh other) { // a copy, so that a mesh may add itself
        const int first = static_cast<int>(vertices.size());
        vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
        for (const auto& f : other.faces) faces.push_back({f[0] + first, f[1] + first, f[2] + first});
    }
};

/// A box. Faces are counter-clockwise from outside. Corners are shared, so smooth normals are diagonal.
inline Mesh box(const vec3<double>& low, const vec3<double>& high) {
    Mesh mesh;
    for (int i = 0; i < 8; ++i)
        mesh.vertices.push_back({i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z});
    for (const auto& q :
         {std::array{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}) {
        mesh.faces.push_back({q[0], q[1], q[2]});
        mesh.faces.push_back({q[0], q[2], q[3]});
    }
    return mesh;
}

inline Mesh sphere(const vec3<double>& center, double radius, int rings, int sides) {
    Mesh mesh;
    for (int r = 1; r < rings; ++r)
        for (int s = 0; s < sides; ++s) {
            const double a = std::numbers::pi * r / rings, b = 2 * std::numbers::pi * s / sides;
            mesh.vertices.push_back(center + vec3<double>(std::sin(a) * std::sin(b), std::cos(a),
                                                          std::sin(a) * std::cos(b)) * radius);
        }
    const int north = static_cast<int>(mesh.vertices.size()), south = north + 1;
    mesh.vertices.push_back(center + vec3<double>(0, radius, 0));
    mesh.vertices.push_back(center - vec3<double>(0, radius, 0));
    for (int s = 0; s < sides; ++s) {
        const int t = (s + 1) % sides, last = (rings - 2) * sides;
        mesh.faces.push_back({north, s, t});
        mesh.faces.push_back({south, last + t, last + s});
        for (int r = 0; r + 2 < rings; ++r) {
            const int i = r * sides + s, right = r * sides + t;
            mesh.faces.push_back({i, i + sides, right});
            mesh.faces.push_back({right, i + sides, right + sides});
        }
    }
    return mesh;
}

/// A camera at the origin that looks along z, with a square image whose middle is on the axis.
inline OrthographicCamera square_camera(int size, double pixels_per_metre) {
    OrthographicCamera camera;
    camera.scale = pixels_per_metre, camera.cx = camera.cy = size / 2.0;
    camera.width = camera.height = size;
    return camera;
}

} // namespace gsh::test
