// SPDX-License-Identifier: Apache-2.0
/// @file  A coarser mesh over some of a mesh's own vertices, which therefore follows it in every pose.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <queue>
#include <utility>
#include <vector>

namespace gsh {

/// A mesh over a part of the vertices of another.
struct CoarseMesh {
    std::vector<std::uint32_t> picked;     // [C] indices into the vertices of the other mesh
    std::vector<std::array<int, 3>> faces; // indices below C
};

/// Picks vertices at least `spacing` apart such that each vertex has a picked one within `spacing`, and joins those
/// whose regions touch. The region of a picked vertex is what is nearer to it than to the others. Distances are along
/// the edges of the mesh, so fingers that lie side by side stay apart. A face becomes the face of the regions of its
/// corners and is dropped where two of them agree. A closed mesh stays closed, in the sense that the directed edges of
/// its faces cancel; orientation stays.
///
/// Units   metres.
/// Errors  ValueError for a spacing that is not positive, or an index out of range.
[[nodiscard]] inline CoarseMesh coarse_mesh(Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                                            double spacing) {
    check_value(spacing > 0, "coarse_mesh", "the spacing must be positive");
    std::vector<std::vector<std::uint32_t>> neighbours(vertices.size());
    for (const auto& face : faces)
        for (std::size_t k = 0; k < 3; ++k) {
            const int a = face[k], b = face[(k + 1) % 3];
            check_value(a >= 0 && static_cast<std::size_t>(a) < vertices.size(), "coarse_mesh",
                        "a face names a vertex that the mesh does not have");
            if (b >= 0 && static_cast<std::size_t>(b) < vertices.size())
                neighbours[static_cast<std::size_t>(a)].push_back(static_cast<std::uint32_t>(b)),
                    neighbours[static_cast<std::size_t>(b)].push_back(static_cast<std::uint32_t>(a));
        }

    CoarseMesh mesh;
    std::vector<double> nearest(vertices.size(), std::numeric_limits<double>::infinity());
    std::vector<int> region(vertices.size(), -1);
    using Arrival = std::pair<double, std::uint32_t>;
    for (std::uint32_t start = 0; start < vertices.size(); ++start) {
        if (neighbours[start].empty() || nearest[start] <= spacing) continue;
        const int here = static_cast<int>(mesh.picked.size());
        mesh.picked.push_back(start);
        // Dijkstra's algorithm, as far as this vertex is nearer than those picked before.
        std::priority_queue<Arrival, std::vector<Arrival>, std::greater<>> open;
        nearest[start] = 0, region[start] = here, open.push({0, start});
        while (!open.empty()) {
            const auto [distance, v] = open.top();
            open.pop();
            if (distance > nearest[v]) continue;
            for (const std::uint32_t u : neighbours[v])
                if (const double next = distance + length(vertices[u] - vertices[v]); next < nearest[u])
                    nearest[u] = next, region[u] = here, open.push({next, u});
        }
    }
    for (const auto& face : faces) {
        const std::array<int, 3> f{region[static_cast<std::size_t>(face[0])], region[static_cast<std::size_t>(face[1])],
                                   region[static_cast<std::size_t>(face[2])]};
        if (f[0] != f[1] && f[1] != f[2] && f[2] != f[0]) mesh.faces.push_back(f);
    }
    return mesh;
}

} // namespace gsh
