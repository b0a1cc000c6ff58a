// SPDX-License-Identifier: Apache-2.0
/// @file  A sphere as a mesh with normals, for tests of shadows.
#pragma once

#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <vector>

namespace gsh::test {

/// A mesh with normals, which casts shadows and receives them.
template <class T>
struct LitMesh {
    std::vector<vec3<T>> vertices, normals;
    std::vector<vec3<std::uint32_t>> triangles;

    [[nodiscard]] ShadowCaster<T> caster() const { return {vertices, triangles}; }
    void move(const vec3<T>& by) {
        for (auto& v : vertices) v += by;
    }
};

template <class T>
LitMesh<T> sphere(const vec3<T>& center, double radius, std::size_t rings = 60) {
    LitMesh<T> mesh;
    const std::size_t sides = 2 * rings;
    for (std::size_t r = 0; r <= rings; ++r)
        for (std::size_t s = 0; s < sides; ++s) {
            const double theta = std::numbers::pi * double(r) / double(rings),
                         phi = 2 * std::numbers::pi * double(s) / double(sides);
            const vec3<double> n(std::sin(theta) * std::cos(phi), std::cos(theta), -std::sin(theta) * std::sin(phi));
            mesh.normals.push_back(vec3<T>(n));
            mesh.vertices.push_back(center + vec3<T>(n * radius));
        }
    const auto at = [&](std::size_t r, std::size_t s) { return static_cast<std::uint32_t>(r * sides + s % sides); };
    for (std::size_t r = 0; r < rings; ++r)
        for (std::size_t s = 0; s < sides; ++s) {
            mesh.triangles.push_back({at(r, s), at(r + 1, s), at(r + 1, s + 1)});
            mesh.triangles.push_back({at(r, s), at(r + 1, s + 1), at(r, s + 1)});
        }
    return mesh;
}

} // namespace gsh::test
