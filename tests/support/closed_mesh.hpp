// SPDX-License-Identifier: Apache-2.0
/// @file  Properties of closed triangle meshes.
#pragma once

#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

namespace gsh::test {

using Faces = std::vector<std::array<int, 3>>;

/// Number of directed edges without exactly one opposite edge. A closed, oriented manifold has none.
inline std::size_t open_edges(const Faces& faces) {
    std::map<std::pair<int, int>, int> count;
    for (const auto& f : faces)
        for (std::size_t k = 0; k < 3; ++k) ++count[{f[k], f[(k + 1) % 3]}];
    std::size_t bad = 0;
    for (const auto& [edge, times] : count) {
        const auto twin = count.find({edge.second, edge.first});
        bad += times != 1 || twin == count.end() || twin->second != 1;
    }
    return bad;
}

inline double volume(const std::vector<vec3<double>>& vertices, const Faces& faces) {
    double sum = 0;
    const auto at = [&](int v) { return vertices[static_cast<std::size_t>(v)]; };
    for (const auto& f : faces) sum += dot(at(f[0]), cross(at(f[1]), at(f[2]))) / 6;
    return sum;
}

/// Number of connected components of the vertices that `keep` accepts.
template <class Keep>
std::size_t pieces(std::size_t vertex_count, const Faces& faces, const Keep& keep) {
    std::vector<std::size_t> parent(vertex_count);
    std::iota(parent.begin(), parent.end(), std::size_t(0));
    const auto find = [&](std::size_t v) {
        while (parent[v] != v) v = parent[v] = parent[parent[v]];
        return v;
    };
    for (const auto& f : faces)
        for (std::size_t k = 0; k < 3; ++k) {
            const auto a = static_cast<std::size_t>(f[k]), b = static_cast<std::size_t>(f[(k + 1) % 3]);
            if (keep(a) && keep(b)) parent[find(a)] = find(b);
        }
    std::size_t roots = 0;
    for (std::size_t v = 0; v < vertex_count; ++v) roots += keep(v) && find(v) == v;
    return roots;
}

/// V - E + F: 2 for a sphere, 2 less for each handle.
inline long euler_characteristic(std::size_t vertex_count, const Faces& faces) {
    return static_cast<long>(vertex_count) - static_cast<long>(faces.size()) / 2; // E = 3 F / 2
}

} // namespace gsh::test
