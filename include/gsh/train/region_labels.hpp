// SPDX-License-Identifier: Apache-2.0
/// @file  Which part of a posed body each pixel of a view shows, so that faces and hands can be judged apart.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A part of a mesh: the triangles all of whose corners are listed.
struct MeshRegion {
    std::string name;          ///< "face"
    std::vector<int> vertices; ///< in any order
};

/// Region of each triangle, [F]: the first whose list holds all three corners, -1 if there is none.
/// Errors  ValueError for a vertex or a corner out of range.
[[nodiscard]] inline std::vector<int> triangle_regions(std::size_t vertex_count, Span<const std::array<int, 3>> faces,
                                                       Span<const MeshRegion> regions) {
    constexpr std::string_view where = "triangle_regions";
    const auto check_vertex = [&](int v, const std::string& owner) {
        check_value(v >= 0 && static_cast<std::size_t>(v) < vertex_count, where,
                    owner + " names vertex " + std::to_string(v) + ", expected an index below " +
                        std::to_string(vertex_count));
    };
    for (std::size_t f = 0; f < faces.size(); ++f)
        for (const int v : faces[f]) check_vertex(v, "faces[" + std::to_string(f) + "]");
    std::vector<int> result(faces.size(), -1);
    std::vector<bool> inside(vertex_count);
    for (std::size_t r = 0; r < regions.size(); ++r) {
        inside.assign(vertex_count, false);
        for (const int v : regions[r].vertices) {
            check_vertex(v, "region '" + regions[r].name + "'");
            inside[static_cast<std::size_t>(v)] = true;
        }
        const auto holds = [&](int v) { return inside[static_cast<std::size_t>(v)]; };
        for (std::size_t f = 0; f < faces.size(); ++f)
            if (result[f] < 0 && holds(faces[f][0]) && holds(faces[f][1]) && holds(faces[f][2]))
                result[f] = static_cast<int>(r);
    }
    return result;
}

/// What each pixel of a view shows.
struct RegionLabels {
    static constexpr int nothing = -2; ///< no body there
    static constexpr int rest = -1;    ///< the body, but none of the regions

    int height = 0, width = 0;
    std::vector<int> labels; // [height, width] index of a region, or one of the above

    /// 1 where the pixel shows `region`, else 0: a mask for loss/metrics.hpp.
    [[nodiscard]] Image<std::uint8_t> mask(int region) const {
        Image<std::uint8_t> result(1, height, width);
        for (std::size_t i = 0; i < labels.size(); ++i) result.data[i] = labels[i] == region;
        return result;
    }
    /// 1 where `person`, a photograph's alpha, exceeds 1/2 and no region is seen: trunk and limbs, clothed or not.
    /// Shapes  person [1, height, width].
    template <class T>
    [[nodiscard]] Image<std::uint8_t> remainder(const ImageView<T>& person) const {
        check_image("RegionLabels::remainder", "person", person, 1, height, width);
        Image<std::uint8_t> result(1, height, width);
        for (std::size_t i = 0; i < labels.size(); ++i)
            result.data[i] = labels[i] < 0 && static_cast<double>(person.data[i]) > 0.5;
        return result;
    }
};

/// Labels a view by the nearest triangle at each pixel's centre: a hand behind the back, or behind another body in the
/// same mesh, has no pixels.
///
/// Shapes  vertices [V] posed, as of pose_body; faces [F].
/// Errors  as rasterize_mesh and triangle_regions.
template <CpuBackend B>
[[nodiscard]] RegionLabels region_labels(B& backend, Span<const vec3<double>> vertices,
                                         Span<const std::array<int, 3>> faces, const Camera<double>& camera,
                                         Span<const MeshRegion> regions) {
    const std::vector<int> region_of = triangle_regions(vertices.size(), faces, regions);
    const MeshImage seen = rasterize_mesh(backend, vertices, faces, camera);
    RegionLabels result{seen.height, seen.width, std::vector<int>(seen.size(), RegionLabels::nothing)};
    for (std::size_t i = 0; i < seen.size(); ++i)
        if (seen.covers(i)) result.labels[i] = region_of[static_cast<std::size_t>(seen.triangle[i])];
    return result;
}

} // namespace gsh
